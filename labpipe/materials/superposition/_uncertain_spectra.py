"""The uncertainty of a material from a master curve, as a few solids that differ by one standard uncertainty each.

A stored master curve holds independent changes of curve and shifts (modes). Each becomes an admissible solid (no weight
below zero) for a prediction. Outside the covered window, of which the data say nothing, the loss goes on as it ends.
"""

import numpy as np
import xarray as xr
from scipy import optimize
from scipy.linalg import block_diag

from labpipe.arrays import Floats
from labpipe.materials.prony import Prony
from labpipe.materials.spectrum import NNLS_STEPS_PER_COLUMN, moduli_of_terms

_LN10 = float(np.log(10.0))
_EVERYWHERE = 0.95  # of the variance of the curve at every frequency that counts, in the spectra handed out
_MOST_USED = 10
_RIDGE = 0.1
"""Share of the uncertainty of the curve: a weight whose effect on it is smaller is not changed by more than itself."""
_TO_EITHER_SIDE = 3.0  # a time tells of frequencies and relaxations about it
_BEYOND = np.arange(1.0, 4.0)  # decades outside the window at which the loss goes on
_SLOPE_DECADES = 2.0  # at the slow end, over which the loss tells how it goes on
_MOST_OF_RELAXED = 0.5  # the share of the relaxed modulus that may still relax


def uncertain_spectra(
    master: xr.Dataset, solid: Prony, temperature: float, times: tuple[float, float], a_T: float
) -> dict[str, Prony]:
    """Return the independent uncertainties of a material at a temperature, each as a solid.

    Parameters
    ----------
    master : Dataset
        A stored master curve with its modes.
    solid : Prony
        Its material at the reference temperature.
    temperature : float [degC]
        Where the material is. Shifts between the reference and there are taken together with the
        curve; beyond the isotherms, those of the last one count.
    times : (float, float) [s]
        Shortest and longest time on which the prediction depends, at that temperature.
    a_T : float
        Shift factor of that temperature.

    Returns
    -------
    dict of str to Prony
        Solids at the reference temperature, each changed by one standard uncertainty, by the name of the change, the
        largest first; then losses that may go on beyond either end of the window.
    """
    frequency = master["mode_frequency"].values
    order = np.argsort(master["mode_temperature"].values)
    isotherms = master["mode_temperature"].values[order]

    def at(name: str) -> Floats:
        return np.array([np.interp(temperature, isotherms, row[order]) for row in master[name].values])

    modulus = solid.complex_modulus(2.0 * np.pi * frequency)
    value = np.concatenate([modulus.real, modulus.imag])
    halves = (modulus.real, modulus.imag)
    along = np.concatenate([_LN10 * np.gradient(part, np.log(frequency)) for part in halves]) / value
    changes = np.hstack([master["mode_storage"].values, master["mode_loss"].values])
    if temperature != float(master["T_ref"]):
        changes = changes + np.outer(at("mode_shift"), along)
        changes += at("mode_vertical")[:, None]
    # Hat functions (term + 1, hat), one a decade, change the weights; the last is the relaxed modulus.
    place = np.log10(solid.rho)
    nodes = np.linspace(place.min(), place.max(), max(int(np.ceil(np.ptp(place))), 1) + 1)
    hats = block_diag(np.array([np.interp(place, nodes, row) for row in np.eye(nodes.size)]).T, 1.0)
    by_terms = moduli_of_terms(np.log(2.0 * np.pi * frequency), np.log(solid.rho))
    design = (by_terms * np.append(solid.E, solid.E_relaxed)) @ hats / value[:, None]
    ridge = _RIDGE * np.sqrt(np.mean(np.sum(changes**2, axis=0))) * np.eye(design.shape[1])
    steps = NNLS_STEPS_PER_COLUMN * hats.shape[1]
    shown, wanted = np.vstack([design, ridge]), np.vstack([changes.T, np.zeros((len(ridge), len(changes)))])
    fast, slow = _TO_EITHER_SIDE * a_T / times[0], a_T / times[1] / _TO_EITHER_SIDE
    omega = np.tile(2.0 * np.pi * frequency, 2)
    counts = (omega <= fast) & (omega >= slow)
    if not counts.any():  # all outside: the nearest end
        counts = omega == omega[np.argmin(np.abs(np.log(omega * times[0] / a_T)))]
    effect = (design @ np.linalg.lstsq(shown, wanted, rcond=None)[0])[counts]
    _, _, turned = np.linalg.svd(effect, full_matrices=False)
    share = np.cumsum((effect @ turned.T) ** 2, axis=1) / np.sum(effect**2, axis=1)[:, None]
    enough = np.flatnonzero((share >= _EVERYWHERE).all(axis=0))
    used = min(int(enough[0]) + 1 if enough.size else turned.shape[0], _MOST_USED)
    found = {}
    for number in range(used):
        # a weight that would fall below zero leaves its part to the others
        factor = hats @ optimize.nnls(shown, wanted @ turned[number] + shown.sum(axis=1), maxiter=steps)[0]
        changed = Prony(solid.E_relaxed * factor[-1], solid.E * factor[:-1], solid.rho, nu=solid.nu)
        found[f"DMA, mode {number + 1}"] = changed
    return found | _beyond(solid, frequency, times[0] / a_T, times[1] / a_T)


def _beyond(solid: Prony, frequency: Floats, shortest: float, longest: float) -> dict[str, Prony]:
    """Return the material whose loss goes on beyond an end of the window, where a prediction reaches it."""
    omega = 2.0 * np.pi * frequency
    loss = solid.complex_modulus(omega).imag
    near = omega <= omega[0] * 10.0**_SLOPE_DECADES
    power = float(np.polyfit(np.log(omega[near]), np.log(loss[near]), 1)[0])
    most = _MOST_OF_RELAXED * solid.E_relaxed
    # A loss that falls as the power m of frequency belongs to a fall of the storage modulus by
    # E″ cot(m π/2) beyond the end (Kramers and Kronig); one that does not fall ends nowhere.
    falls = most if power <= 0.0 else min(most, float(loss[0]) / np.tan(0.5 * np.pi * min(power, 1.0)))
    # A constant loss goes with a storage modulus that rises by (2/π) E″ per unit of ln ω.
    rises = float(loss[-1]) * 2.0 / np.pi * _LN10
    slow = np.full(len(_BEYOND), max(falls, 0.0) / np.sqrt(3.0) / len(_BEYOND))
    fast = np.full(len(_BEYOND), rises / np.sqrt(3.0))
    later, sooner = 10.0**_BEYOND / omega[0], 10.0**-_BEYOND / omega[-1]
    slow *= longest * omega[0] > 1.0 / _TO_EITHER_SIDE
    fast *= shortest * omega[-1] < _TO_EITHER_SIDE
    both = (
        ("DMA, slower than its sweeps", solid.E_relaxed - float(slow.sum()), slow, later),
        ("DMA, faster than its sweeps", solid.E_relaxed, fast, sooner),
    )
    return {
        name: Prony(relaxed, np.append(solid.E, more), np.append(solid.rho, times), nu=solid.nu)
        for name, relaxed, more, times in both
        if more[0] > 0.0
    }

"""What a master curve leaves uncertain of the material, as few independent changes of its spectrum.

The covariance of a fit is that of some thirty weights and twenty outer parameters. A prediction
needs it in a form that a simulation can take: independent *modes*, each one standard uncertainty
of the whole material, admissible as a solid (no weight below zero). The changes of weights, shifts,
vertical law and delay belong together, so a mode holds what it does to the curve and to the shifts
of all isotherms; at another temperature than the reference they partly cancel.

Outside the covered window the data say nothing. There a mode lets the loss go on as it ends.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy import optimize

from labpipe.arrays import Floats
from labpipe.materials.prony import Prony
from labpipe.materials.spectrum import maxwell_shapes, solve_normal
from labpipe.materials.superposition._anchoring import Anchor
from labpipe.materials.superposition._joint_fit import Fit, Points, sensitivity
from labpipe.materials.superposition._reweighting import Superposition
from labpipe.variables import variable

_LN10 = float(np.log(10.0))
_POINTS_PER_DECADE = 4
_KEPT = 0.999999  # of the variance of curve and shifts, in the modes that are stored
_EVERYWHERE = 0.95  # of the variance of the curve at every frequency that counts, in the spectra handed out
_MOST_STORED, _MOST_USED = 60, 10
_NODE_DECADES = 1.0  # spacing of the hat functions that change a spectrum
_STEPS_PER_HAT = 100  # of the solver, at most
_RIDGE = 0.1
"""Of what is uncertain of the curve: a weight that shows by less than that in it is not changed by more than itself."""
_TO_EITHER_SIDE = 3.0  # a time tells of frequencies about its inverse
_REACHES = 0.3  # a relaxation so much faster or slower than a prediction's times is no part of it
_RECTANGULAR = 1.0 / np.sqrt(3.0)
_BEYOND = (1.0, 2.0, 3.0)  # decades outside the window at which the loss goes on
_SLOPE_DECADES = 2.0  # at the slow end, over which the loss tells how it goes on
_MOST_OF_RELAXED = 0.5  # the share of the relaxed modulus that may still relax


class UncertainSpectrum(NamedTuple):
    """One independent change of a material by its standard uncertainty: its name, and the solid."""

    name: str
    solid: Prony


def modes_of(
    points: Points, found: Superposition, anchor: Anchor, window: tuple[float, float], possible: list[tuple[float, Fit]]
) -> xr.Dataset:
    """Return the modes of a converged superposition.

    ``anchor`` says where the reference lies, ``window`` [Hz] which frequencies are covered there, and ``possible`` are
    (share, fit) of other smoothing that may be right. Over ``mode`` are ``mode_storage`` and ``mode_loss`` (relative,
    over ``mode_frequency``), ``mode_shift`` (log10 a_T) and ``mode_vertical`` (ln b_T) of every isotherm
    (``mode_temperature``).
    """
    decades = np.log10(window[1] / window[0])
    frequency = np.geomspace(window[0], window[1], int(np.ceil(decades * _POINTS_PER_DECADE)) + 2)
    ln_omega = np.log(2.0 * np.pi * frequency) + _LN10 * anchor.offset
    isotherms, model = found.model.temperature.size, found.model
    columns = []
    value = _curve(found.fit, ln_omega) @ found.fit.solution.coefficient
    for share, fit in possible:
        design, active = _curve(fit, ln_omega), fit.solution.coefficient > 0
        spread = _root(np.asarray(np.linalg.pinv(fit.normal, hermitian=True), dtype=np.float64))
        moved = design @ fit.solution.coefficient - value
        both = np.column_stack([design[:, active] @ spread, moved]) * np.sqrt(share) / value[:, None]
        columns.append(np.vstack([both, np.zeros((2 * isotherms, both.shape[1]))]))
    if model.size:
        columns.append(_of_outer(points, found, anchor, ln_omega, value))
        moves, own = anchor.shift_by_parameter, anchor.by_own
        misplaced = _slope(value, ln_omega)[:, None] * (anchor.share * anchor.own) / value[:, None]
        columns.append(np.vstack([misplaced, own, np.zeros((isotherms, isotherms))]))
        known = moves @ found.covariance @ moves.T + own @ own.T
        rest = _root(np.asarray(anchor.covariance - known, dtype=np.float64))
        none = np.zeros((value.size, rest.shape[1]))
        columns.append(np.vstack([none, rest, np.zeros((isotherms, rest.shape[1]))]))
    left, size, _ = np.linalg.svd(np.column_stack(columns), full_matrices=False)
    kept = min(int(np.searchsorted(np.cumsum(size**2) / np.sum(size**2), _KEPT)) + 1, _MOST_STORED)
    made = (left[:, :kept] * size[:kept]).T
    half = frequency.size
    parts = {
        "mode_storage": (made[:, :half], "mode_frequency", "relative change of the storage modulus"),
        "mode_loss": (made[:, half : 2 * half], "mode_frequency", "relative change of the loss modulus"),
        "mode_shift": (made[:, 2 * half : 2 * half + isotherms], "mode_temperature", "change of log10 a_T"),
        "mode_vertical": (made[:, 2 * half + isotherms :], "mode_temperature", "change of ln b_T"),
    }
    return xr.Dataset(
        {name: variable(("mode", over), values, "1", text) for name, (values, over, text) in parts.items()},
        coords={
            "mode_frequency": variable("mode_frequency", frequency, "Hz", "frequency at the reference temperature"),
            "mode_temperature": variable("mode_temperature", model.temperature, "degC", "temperature of an isotherm"),
        },
    )


def _curve(fit: Fit, ln_omega: Floats) -> Floats:
    """Return storage and, below it, loss (2 frequency, column) per coefficient of the fit."""
    storage, loss = maxwell_shapes(ln_omega, fit.grid.ln_time)
    constant = np.ones((ln_omega.size, 1))
    return np.vstack([np.hstack([storage, constant]), np.hstack([loss, 0.0 * constant])]) * fit.grid.scale


def _root(covariance: Floats) -> Floats:
    """Return columns whose squares sum to a covariance; what rounding made negative is left out."""
    size, vectors = np.linalg.eigh(covariance)
    kept = size > 1e-12 * max(float(size[-1]), 0.0)
    return np.asarray(vectors[:, kept] * np.sqrt(size[kept]))


def _of_outer(points: Points, found: Superposition, anchor: Anchor, ln_omega: Floats, value: Floats) -> Floats:
    """Return the columns of shifts, vertical law and delay, the spectrum following them."""
    model, fit = found.model, found.fit
    active = fit.solution.coefficient > 0
    coupling = fit.rows.T @ sensitivity(points, fit, model)
    curve = -_curve(fit, ln_omega)[:, active] @ solve_normal(fit.normal, coupling)
    shift, vertical, _ = model.directions(fit.state)
    # The reference itself moves along the curve with the shifts that define it.
    curve += _slope(value, ln_omega)[:, None] * (anchor.share @ shift)
    return np.asarray(
        np.vstack([curve / value[:, None], anchor.shift_by_parameter, vertical]) @ _root(found.covariance)
    )


def _slope(value: Floats, ln_omega: Floats) -> Floats:
    """Return the change of storage and loss per decade of frequency."""
    return np.concatenate([_LN10 * np.gradient(part, ln_omega) for part in np.split(value, 2)])


def uncertain_spectra(
    master: xr.Dataset, solid: Prony, temperature: float, times: tuple[float, float], a_T: float
) -> list[UncertainSpectrum]:
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
    list of UncertainSpectrum
        Solids at the reference temperature, each changed by one standard uncertainty, the largest
        first; then what may go on beyond either end of the window.
    """
    frequency = master["mode_frequency"].values
    order = np.argsort(master["mode_temperature"].values)
    isotherms = master["mode_temperature"].values[order]

    def at(name: str) -> Floats:
        return np.array([np.interp(temperature, isotherms, row[order]) for row in master[name].values])

    modulus = solid.complex_modulus(2.0 * np.pi * frequency)
    value = np.concatenate([modulus.real, modulus.imag])
    along = _slope(value, np.log(frequency)) / value
    changes = np.hstack([master["mode_storage"].values, master["mode_loss"].values])
    if temperature != float(master["T_ref"]):
        changes = changes + np.outer(at("mode_shift"), along)
        changes += at("mode_vertical")[:, None]
    hats = _hats(solid)
    design = _by_hats(solid, frequency, hats) / value[:, None]
    ridge = _RIDGE * np.sqrt(np.mean(np.sum(changes**2, axis=0))) * np.eye(design.shape[1])
    steps = _STEPS_PER_HAT * hats.shape[1]
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
    found = []
    for number in range(used):
        # a weight that would fall below zero leaves its part to the others
        factor = hats @ optimize.nnls(shown, wanted @ turned[number] + shown.sum(axis=1), maxiter=steps)[0]
        changed = Prony(solid.E_relaxed * factor[-1], solid.E * factor[:-1], solid.rho, nu=solid.nu)
        found.append(UncertainSpectrum(f"DMA, mode {number + 1}", changed))
    return found + _beyond(solid, frequency, times[0] / a_T, times[1] / a_T)


def _hats(solid: Prony) -> Floats:
    """Return hat functions (term + 1, hat) over the logarithm of time; the last is the relaxed modulus."""
    place = np.log10(solid.rho)
    nodes = np.linspace(place.min(), place.max(), max(int(np.ceil(np.ptp(place) / _NODE_DECADES)), 1) + 1)
    hats = np.array([np.interp(place, nodes, row) for row in np.eye(nodes.size)]).T
    whole = np.zeros((place.size + 1, nodes.size + 1))
    whole[:-1, :-1], whole[-1, -1] = hats, 1.0
    return whole


def _by_hats(solid: Prony, frequency: Floats, hats: Floats) -> Floats:
    """Return the change of storage and loss with every hat function of relative weights."""
    storage, loss = maxwell_shapes(np.log(2.0 * np.pi * frequency), np.log(solid.rho))
    constant = np.full((frequency.size, 1), solid.E_relaxed)
    columns = np.vstack([np.hstack([storage * solid.E, constant]), np.hstack([loss * solid.E, 0.0 * constant])])
    return np.asarray(columns @ hats)


def _beyond(solid: Prony, frequency: Floats, shortest: float, longest: float) -> list[UncertainSpectrum]:
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
    slow = np.full(len(_BEYOND), max(falls, 0.0) * _RECTANGULAR / len(_BEYOND))
    fast = np.full(len(_BEYOND), rises * _RECTANGULAR)
    later = 10.0 ** np.array(_BEYOND) / omega[0]
    sooner = 10.0 ** -np.array(_BEYOND) / omega[-1]
    both = (
        (
            "DMA, slower than its sweeps",
            solid.E_relaxed - float(slow.sum()),
            slow * (longest * omega[0] > _REACHES),
            later,
        ),
        ("DMA, faster than its sweeps", solid.E_relaxed, fast * (shortest * omega[-1] < 1.0 / _REACHES), sooner),
    )
    return [
        UncertainSpectrum(name, Prony(relaxed, np.append(solid.E, more), np.append(solid.rho, times), nu=solid.nu))
        for name, relaxed, more, times in both
        if more[0] > 0.0
    ]

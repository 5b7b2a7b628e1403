"""Tables and curves of a converged superposition, with the independent changes that its uncertainty allows.

A prediction needs the covariance of a fit in a form that a simulation can take: independent *modes*, each one standard
uncertainty of the whole curve. A mode holds the change of the curve and of the shifts of all isotherms; at another
temperature than the reference they partly cancel.
"""

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.materials.prony import Prony
from labpipe.materials.spectrum import moduli_of_terms, solve_normal
from labpipe.materials.superposition._joint_fit import Fit, Points, sensitivity
from labpipe.materials.superposition._model_selection import Superposition
from labpipe.materials.superposition._points import SweepData
from labpipe.materials.superposition._reference import Reference, shared_decades
from labpipe.variables import described, variable

#: A step between neighbours known worse than this (decades) is called barely determined.
BARELY_DETERMINED = 0.15
_LN10 = float(np.log(10.0))
# Points per decade of the curve; of every third the modes are stored.
_CURVE_POINTS, _STORED = 12, 3
# Share of the variance in the modes that are stored, and their number at most.
_KEPT, _MOST_MODES = 0.999999, 60


def predictions(
    sweeps: xr.Dataset, data: SweepData, found: Superposition, reference: Reference, log10_aT: Floats
) -> xr.Dataset:
    """Return reduced moduli and residuals over (temperature, frequency).

    ``storage_reduced`` and ``loss_reduced`` are the measurement as it would have been at the
    reference temperature, the delay of the instrument taken out.
    """
    points = data.points
    half = points.omega.size
    undone = (points.storage + 1j * points.loss) * np.exp(-1j * points.omega * found.fit.state.delay)
    undone *= np.exp(reference.ln_bT - found.fit.state.ln_bT[points.isotherm])
    residual = found.fit.predicted / np.concatenate([points.storage, points.loss]) - 1.0
    at_reference = points.omega / (2.0 * np.pi) * 10.0 ** log10_aT[points.isotherm]
    columns = {
        "reduced_frequency": (at_reference, "Hz", "frequency at the reference temperature"),
        "storage_reduced": (undone.real, "Pa", "storage modulus at the reference temperature"),
        "loss_reduced": (undone.imag, "Pa", "loss modulus at the reference temperature"),
        "storage_residual": (residual[:half], "1", "fitted over measured storage modulus less one"),
        "loss_residual": (residual[half:], "1", "fitted over measured loss modulus less one"),
    }
    variables = {}
    for name, (values, units, text) in columns.items():
        full = np.full((sweeps.sizes["temperature"], sweeps.sizes["frequency"]), np.nan)
        full[data.row, data.column] = values
        variables[name] = variable(("temperature", "frequency"), full, units, text)
    return xr.Dataset(variables, coords={name: sweeps[name] for name in ("temperature", "frequency")})


def overlap_of_neighbours(data: SweepData, log10_aT: Floats, covariance: Floats) -> xr.Dataset:
    """Return step, uncertainty and overlap of every pair of neighbouring temperatures."""
    order = np.argsort(data.temperature, kind="stable")
    cold, warm = order[:-1], order[1:]
    squared = covariance[cold, cold] + covariance[warm, warm] - 2.0 * covariance[cold, warm]
    u_step = np.sqrt(np.maximum(squared, 0.0))
    shared = shared_decades(data.points, log10_aT, order)
    columns = {
        "colder": (data.temperature[cold], "degC", "colder temperature of the pair"),
        "warmer": (data.temperature[warm], "degC", "warmer temperature of the pair"),
        "step": (log10_aT[cold] - log10_aT[warm], "1", "step of log10 a_T in decades"),
        "u_step": (u_step, "1", "standard uncertainty of the step"),
        "overlap": (shared, "1", "common decades of reduced frequency, negative for a gap"),
        "determined": (u_step <= BARELY_DETERMINED, "1", "1 where the data determine the step"),
    }
    return xr.Dataset({name: variable("pair", values, units, text) for name, (values, units, text) in columns.items()})


def terms_of(prony: Prony, window: tuple[float, float]) -> xr.Dataset:
    """Return relaxation and creep terms side by side, those outside the covered window (Hz) marked."""
    C, tau = prony.creep_terms()
    low, high = (1.0 / (2.0 * np.pi * f) for f in reversed(window))
    outside = (prony.rho < low) | (prony.rho > high)
    return xr.Dataset(
        {
            "E": variable("term", prony.E, "Pa", "weight of the relaxation term"),
            "rho": variable("term", prony.rho, "s", "relaxation time"),
            "extrapolated": variable("term", outside, "1", "relaxation time outside the covered window"),
            "C": variable("creep_term", C, "1/Pa", "weight of the creep term"),
            "tau": variable("creep_term", tau, "s", "retardation time"),
        }
    )


def curve_and_modes(
    points: Points, found: Superposition, reference: Reference, window: tuple[float, float]
) -> tuple[xr.Dataset, xr.Dataset]:
    """Return the master curve over the covered window [Hz] with its uncertainty, and the modes of that.

    The uncertainty joins that of the spectrum, widened by the lack of fit, that of the shifts, vertical law and delay,
    and the error of the temperature of the sweeps at the reference.

    Over ``mode`` are ``mode_storage`` and ``mode_loss`` (relative, over ``mode_frequency``), ``mode_shift``
    (log10 a_T) and ``mode_vertical`` (ln b_T) of every isotherm (``mode_temperature``).
    """
    count = max(int(np.ceil(np.log10(window[1] / window[0]) * _CURVE_POINTS)), 1) + 1
    frequency = np.geomspace(window[0], window[1], count)
    ln_omega = np.log(2.0 * np.pi * frequency) + _LN10 * reference.log10_aT
    columns, value = _changes(points, found, reference, ln_omega)
    b_ref = float(np.exp(reference.ln_bT))
    squared = np.sum(columns[: 2 * count] ** 2, axis=1)
    variables = {}
    for name, part in (("storage", slice(count)), ("loss", slice(count, 2 * count))):
        size, u = b_ref * value[part], b_ref * value[part] * np.sqrt(squared[part])
        variables[name] = variable("reduced_frequency", size, "Pa", f"{name} modulus at the reference temperature")
        variables[f"u_{name}"] = variable("reduced_frequency", u, "Pa", f"standard uncertainty of the {name} modulus")
    words = "frequency at the reference temperature"
    curve = xr.Dataset(variables, coords={"reduced_frequency": variable("reduced_frequency", frequency, "Hz", words)})
    factor = curve["loss"] / curve["storage"]
    factor.attrs = described("1", "loss factor at the reference temperature")
    stored = np.unique(np.append(np.arange(0, count, _STORED), count - 1))
    rows = np.concatenate([stored, count + stored, np.arange(2 * count, columns.shape[0])])
    left, size, _ = np.linalg.svd(columns[rows], full_matrices=False)
    kept = min(int(np.searchsorted(np.cumsum(size**2) / np.sum(size**2), _KEPT)) + 1, _MOST_MODES)
    made, half, isotherms = (left[:, :kept] * size[:kept]).T, stored.size, found.model.temperature
    parts = {
        "mode_storage": (made[:, :half], "mode_frequency", "relative change of the storage modulus"),
        "mode_loss": (made[:, half : 2 * half], "mode_frequency", "relative change of the loss modulus"),
        "mode_shift": (made[:, 2 * half : 2 * half + isotherms.size], "mode_temperature", "change of log10 a_T"),
        "mode_vertical": (made[:, 2 * half + isotherms.size :], "mode_temperature", "change of ln b_T"),
    }
    modes = xr.Dataset(
        {name: variable(("mode", over), values, "1", text) for name, (values, over, text) in parts.items()},
        coords={
            "mode_frequency": variable("mode_frequency", frequency[stored], "Hz", words),
            "mode_temperature": variable("mode_temperature", isotherms, "degC", "temperature of an isotherm"),
        },
    )
    return curve.assign(loss_factor=factor), modes


def _changes(points: Points, found: Superposition, reference: Reference, ln_omega: Floats) -> tuple[Floats, Floats]:
    """Return independent changes by one standard uncertainty as columns, and the curve in the frame of the fit.

    Rows are the relative changes of storage and loss at every frequency, then those of log10 a_T and of ln b_T of
    every isotherm.
    """
    model, fit = found.model, found.fit
    isotherms = model.temperature.size
    value = _curve(fit, ln_omega) @ fit.solution.coefficient
    active = fit.solution.coefficient > 0
    spread = _root(found.lack_of_fit * np.asarray(np.linalg.pinv(fit.normal, hermitian=True), dtype=np.float64))
    own_of_spectrum = _curve(fit, ln_omega)[:, active] @ spread / value[:, None]
    columns = [np.vstack([own_of_spectrum, np.zeros((2 * isotherms, spread.shape[1]))])]
    if not model.size:
        return np.column_stack(columns), value
    per_decade = np.concatenate([_LN10 * np.gradient(part, ln_omega) for part in np.split(value, 2)]) / value
    # Shifts, vertical law and delay, the spectrum following them; the reference moves along the curve with
    # the shifts that define it.
    coupling = fit.rows.T @ sensitivity(points, fit, model)
    curve = -_curve(fit, ln_omega)[:, active] @ solve_normal(fit.normal, coupling) / value[:, None]
    curve += np.outer(per_decade, reference.shift_by_parameter) + reference.vertical_by_parameter
    shift, vertical, _ = model.directions(fit.state)
    shift, vertical = shift - reference.shift_by_parameter, vertical - reference.vertical_by_parameter
    columns.append(np.vstack([curve, shift, vertical]) @ _root(found.covariance))
    none = np.zeros((isotherms, isotherms))
    own = (np.eye(isotherms) - reference.share) * reference.own
    columns.append(np.vstack([np.outer(per_decade, reference.share * reference.own), own, none]))
    rest = _root(reference.covariance - shift @ found.covariance @ shift.T - own @ own.T)
    columns.append(np.vstack([np.zeros((value.size, rest.shape[1])), rest, none[:, : rest.shape[1]]]))
    return np.column_stack(columns), value


def _curve(fit: Fit, ln_omega: Floats) -> Floats:
    """Return storage and, below it, loss (2 frequency, column) per coefficient of the fit."""
    return moduli_of_terms(ln_omega, fit.grid.ln_time) * fit.grid.scale


def _root(covariance: Floats) -> Floats:
    """Return columns whose squares sum to a covariance; parts that rounding made negative are left out."""
    size, vectors = np.linalg.eigh(covariance)
    kept = size > 1e-12 * max(float(size[-1]), 0.0)
    return np.asarray(vectors[:, kept] * np.sqrt(size[kept]))

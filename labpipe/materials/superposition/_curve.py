"""Tables and curves of a converged superposition, with the independent changes that its uncertainty allows.

The covariance of a fit is that of some thirty weights and twenty outer parameters. A prediction
needs it in a form that a simulation can take: independent *modes*, each one standard uncertainty of the
whole curve. The changes of weights, shifts, vertical law and delay belong together, so a mode holds the
change of the curve and of the shifts of all isotherms; at another temperature than the reference they
partly cancel.
"""

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from labpipe.arrays import Complexes, Floats
from labpipe.materials.prony import Prony
from labpipe.materials.spectrum import moduli_of_terms, solve_normal
from labpipe.materials.superposition._joint_fit import Fit, Points, sensitivity
from labpipe.materials.superposition._model_selection import Superposition
from labpipe.materials.superposition._points import SweepData
from labpipe.materials.superposition._reference import Reference
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
    """Return measured, reduced and fitted moduli over (temperature, frequency).

    ``storage_reduced`` and ``loss_reduced`` are the measurement as it would have been at the
    reference temperature, the delay of the instrument taken out; ``storage_fitted`` and
    ``loss_fitted`` are the model in the frame of the measurement, delay included.
    """
    points = data.points
    half = points.omega.size
    undone = without_delay(points, found.fit) * np.exp(reference.ln_bT)
    fitted = found.fit.predicted
    residual = fitted / points.moduli - 1.0
    at_reference = points.omega / (2.0 * np.pi) * 10.0 ** log10_aT[points.isotherm]
    columns = {
        "reduced_frequency": (at_reference, "Hz", "frequency at the reference temperature"),
        "storage_reduced": (undone.real, "Pa", "storage modulus at the reference temperature"),
        "loss_reduced": (undone.imag, "Pa", "loss modulus at the reference temperature"),
        "storage_fitted": (fitted[:half], "Pa", "fitted storage modulus"),
        "loss_fitted": (fitted[half:], "Pa", "fitted loss modulus"),
        "storage_residual": (residual[:half], "1", "fitted over measured storage modulus less one"),
        "loss_residual": (residual[half:], "1", "fitted over measured loss modulus less one"),
    }
    variables = {}
    for name, (values, units, text) in columns.items():
        full = np.full((sweeps.sizes["temperature"], sweeps.sizes["frequency"]), np.nan)
        full[data.row, data.column] = values
        variables[name] = variable(("temperature", "frequency"), full, units, text)
    return xr.Dataset(variables, coords={name: sweeps[name] for name in ("temperature", "frequency")})


def without_delay(points: Points, fit: Fit) -> Complexes:
    """Return the complex moduli of points without delay and vertical factor."""
    undone = (points.storage + 1j * points.loss) * np.exp(-1j * points.omega * fit.state.delay)
    return np.asarray(undone / np.exp(fit.state.ln_bT[points.isotherm]))


def overlap_of_neighbours(data: SweepData, log10_aT: Floats, covariance: Floats) -> xr.Dataset:
    """Return step, uncertainty and overlap of every pair of neighbouring temperatures."""
    order = np.argsort(data.temperature, kind="stable")
    cold, warm = order[:-1], order[1:]
    low, high = data.points.reach(log10_aT)
    squared = covariance[cold, cold] + covariance[warm, warm] - 2.0 * covariance[cold, warm]
    u_step = np.sqrt(np.maximum(squared, 0.0))
    shared = np.minimum(high[cold], high[warm]) - np.maximum(low[cold], low[warm])
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
) -> tuple[xr.Dataset, xr.Dataset, Floats]:
    """Return the master curve over the covered window [Hz], the modes of its uncertainty, the covariance of log10 a_T.

    The uncertainty joins that of the spectrum, widened by the lack of fit, that of the shifts, vertical law and delay,
    and the error of the temperature of the sweeps at the reference.

    Over ``mode`` are ``mode_storage`` and ``mode_loss`` (relative, over ``mode_frequency``), ``mode_shift``
    (log10 a_T) and ``mode_vertical`` (ln b_T) of every isotherm (``mode_temperature``).
    """
    count = max(int(np.ceil(np.log10(window[1] / window[0]) * _CURVE_POINTS)), 1) + 1
    frequency = np.geomspace(window[0], window[1], count)
    columns, value = _changes(points, found, reference, np.log(2.0 * np.pi * frequency) + _LN10 * reference.log10_aT)
    isotherms, words = found.model.temperature, "frequency at the reference temperature"
    curve = xr.Dataset(coords={"reduced_frequency": variable("reduced_frequency", frequency, "Hz", words)})
    u = np.sqrt(np.sum(columns**2, axis=1))
    for name, part in (("storage", slice(count)), ("loss", slice(count, 2 * count))):
        size, text = float(np.exp(reference.ln_bT)) * value[part], f"{name} modulus at the reference temperature"
        curve[name] = variable("reduced_frequency", size, "Pa", text)
        curve[f"u_{name}"] = variable("reduced_frequency", size * u[part], "Pa", f"standard uncertainty of the {text}")
    factor = (curve["loss"] / curve["storage"]).variable
    factor.attrs = described("1", "loss factor at the reference temperature")
    stored = np.unique(np.append(np.arange(0, count, _STORED), count - 1))
    rows = np.concatenate([stored, count + stored, np.arange(2 * count, columns.shape[0])])
    left, size, _ = np.linalg.svd(columns[rows], full_matrices=False)
    kept = min(int(np.searchsorted(np.cumsum(size**2) / np.sum(size**2), _KEPT)) + 1, _MOST_MODES)
    ends = np.cumsum([stored.size, stored.size, isotherms.size])
    changes = np.split((left[:, :kept] * size[:kept]).T, ends, axis=1)
    names = (
        ("mode_storage", "mode_frequency", "relative change of the storage modulus"),
        ("mode_loss", "mode_frequency", "relative change of the loss modulus"),
        ("mode_shift", "mode_temperature", "change of log10 a_T"),
        ("mode_vertical", "mode_temperature", "change of ln b_T"),
    )
    modes = xr.Dataset(
        {n: variable(("mode", over), made, "1", text) for (n, over, text), made in zip(names, changes, strict=True)},
        coords={
            "mode_frequency": variable("mode_frequency", frequency[stored], "Hz", words),
            "mode_temperature": variable("mode_temperature", isotherms, "degC", "temperature of an isotherm"),
        },
    )
    by_shift = columns[2 * count : 2 * count + isotherms.size]
    return curve.assign(loss_factor=factor), modes, by_shift @ by_shift.T


def _changes(points: Points, found: Superposition, reference: Reference, ln_omega: Floats) -> tuple[Floats, Floats]:
    """Return independent changes by one standard uncertainty as columns, and the curve in the frame of the fit.

    Rows are the relative changes of storage and loss at every frequency, then those of log10 a_T and of ln b_T of
    every isotherm. They follow from the weights of the spectrum, from the outer parameters, which the spectrum
    follows, and from the sweeps' own errors; the reference moves along the curve with the shifts that define it.
    """
    model, fit = found.model, found.fit
    shapes, active = moduli_of_terms(ln_omega, fit.grid.ln_time) * fit.grid.scale, fit.solution.coefficient > 0
    value = shapes @ fit.solution.coefficient
    by_weight = shapes[:, active] / value[:, None]
    per_decade = np.concatenate([_LN10 * np.gradient(part, ln_omega) for part in np.split(value, 2)]) / value
    followed = solve_normal(fit.normal, fit.rows.T @ sensitivity(points, fit, model))
    by_outer = np.outer(per_decade, reference.shift_by_parameter) + reference.vertical_by_parameter
    shift, vertical, _ = model.directions(fit.state)
    none = np.zeros((shift.shape[0], by_weight.shape[1]))
    apart = np.eye(shift.shape[0]) - reference.share
    response = np.block(
        [
            [by_weight, by_outer - by_weight @ followed, np.outer(per_decade, reference.share)],
            [none, shift - reference.shift_by_parameter, apart],
            [none, vertical - reference.vertical_by_parameter, 0.0 * apart],
        ]
    )
    spectrum = found.lack_of_fit * np.asarray(np.linalg.pinv(fit.normal, hermitian=True))
    return response @ block_diag(_root(spectrum), _root(found.covariance), np.diag(reference.own)), value


def _root(covariance: Floats) -> Floats:
    """Return columns whose squares sum to a covariance; parts that rounding made negative are left out."""
    size, vectors = np.linalg.eigh(covariance)
    kept = size > 1e-12 * np.max(size, initial=0.0)
    return np.asarray(vectors[:, kept] * np.sqrt(size[kept]))

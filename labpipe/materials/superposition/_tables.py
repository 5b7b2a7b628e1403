"""Tables and curves of a converged superposition."""

import numpy as np
import xarray as xr

from labpipe.arrays import Complexes, Floats
from labpipe.materials.prony import Prony
from labpipe.materials.spectrum import maxwell_shapes, solve_normal
from labpipe.materials.superposition._anchoring import Anchor
from labpipe.materials.superposition._joint_fit import Fit, Points, evaluate, modelled, sensitivity
from labpipe.materials.superposition._limits import BARELY_DETERMINED
from labpipe.materials.superposition._reweighting import Superposition
from labpipe.materials.superposition._sweep_data import SweepData
from labpipe.uncertainty import propagated_variance
from labpipe.variables import described, variable

_LN10 = float(np.log(10.0))
# Points per decade of the drawn master curve.
_CURVE_POINTS = 12
# Strengths of the smoothing that may be the right one, in units of the chosen one.
_STRENGTHS = tuple(float(s) for s in np.logspace(-2.0, 2.0, 9))


def predictions(sweeps: xr.Dataset, data: SweepData, found: Superposition, log10_aT: Floats) -> xr.Dataset:
    """Return measured, reduced and fitted moduli over (temperature, frequency).

    ``storage_reduced`` and ``loss_reduced`` are the measurement as it would have been at the
    reference temperature, the delay of the instrument taken out; ``storage_fitted`` and
    ``loss_fitted`` are the model in the frame of the measurement, delay included.
    """
    points = data.readings
    half = points.omega.size
    undone = without_delay(points, found.fit)
    measured = np.concatenate([points.storage, points.loss])
    fitted = found.fit.predicted if points is data.points else modelled(points, found.fit)
    residual = fitted / measured - 1.0
    columns = {
        "reduced_frequency": (
            points.omega / (2.0 * np.pi) * 10.0 ** log10_aT[points.isotherm],
            "Hz",
            "frequency at the reference temperature",
        ),
        "storage_reduced": (undone.real, "Pa", "storage modulus at the reference temperature"),
        "loss_reduced": (undone.imag, "Pa", "loss modulus at the reference temperature"),
        "storage_fitted": (fitted[:half], "Pa", "fitted storage modulus"),
        "loss_fitted": (fitted[half:], "Pa", "fitted loss modulus"),
        "storage_residual": (residual[:half], "1", "fitted over measured storage modulus less one"),
        "loss_residual": (residual[half:], "1", "fitted over measured loss modulus less one"),
    }
    shape = (sweeps.sizes["temperature"], sweeps.sizes["frequency"])
    variables = {}
    for name, (values, units, text) in columns.items():
        full = np.full(shape, np.nan)
        full[data.row, data.column] = values
        variables[name] = variable(("temperature", "frequency"), full, units, text)
    coordinates = {name: sweeps[name] for name in ("temperature", "frequency")}
    return xr.Dataset(variables, coords=coordinates)


def without_delay(points: Points, fit: Fit) -> Complexes:
    """Return the complex moduli of points as they would have been at the reference temperature."""
    undone = (points.storage + 1j * points.loss) * np.exp(-1j * points.omega * fit.state.delay)
    return np.asarray(undone / np.exp(fit.state.ln_bT[points.isotherm]))


def overlap_of_neighbours(data: SweepData, log10_aT: Floats, covariance: Floats) -> xr.Dataset:
    """Return step, uncertainty and overlap of every pair of neighbouring temperatures."""
    order = np.argsort(data.temperature, kind="stable")
    cold, warm = order[:-1], order[1:]
    ln_omega = np.log10(data.points.omega) + log10_aT[data.points.isotherm]
    low = np.array([ln_omega[data.points.isotherm == k].min() for k in range(data.points.count)])
    high = np.array([ln_omega[data.points.isotherm == k].max() for k in range(data.points.count)])
    squared = covariance[cold, cold] + covariance[warm, warm] - 2.0 * covariance[cold, warm]
    u_step = np.sqrt(np.maximum(squared, 0.0))
    shared = np.minimum(high[cold], high[warm]) - np.maximum(low[cold], low[warm])
    columns = {
        "colder": (data.temperature[cold], "degC", "colder temperature of the pair"),
        "warmer": (data.temperature[warm], "degC", "warmer temperature of the pair"),
        "step": (log10_aT[cold] - log10_aT[warm], "1", "step of log10 a_T in decades"),
        "u_step": (u_step, "1", "standard uncertainty of the step"),
        "overlap": (shared, "1", "common decades of reduced frequency, negative for a gap"),
        "determined": (u_step <= BARELY_DETERMINED, "1", "whether the data determine the step"),
    }
    return xr.Dataset({name: variable("pair", values, units, text) for name, (values, units, text) in columns.items()})


def terms_of(prony: Prony, window: tuple[float, float]) -> xr.Dataset:
    """Return relaxation and creep terms side by side, those outside the window marked.

    Parameters
    ----------
    window : (float, float) [Hz]
        Lowest and highest covered reduced frequency.
    """
    C, tau = prony.creep_terms()
    low, high = (1.0 / (2.0 * np.pi * f) for f in reversed(window))
    outside = (prony.rho < low) | (prony.rho > high)
    variables = {
        "E": variable("term", prony.E, "Pa", "weight of the relaxation term"),
        "rho": variable("term", prony.rho, "s", "relaxation time"),
        "extrapolated": variable("term", outside, "1", "relaxation time outside the covered window"),
        "C": variable("creep_term", C, "1/Pa", "weight of the creep term"),
        "tau": variable("creep_term", tau, "s", "retardation time"),
    }
    return xr.Dataset(variables)


def bands(
    points: Points, found: Superposition, anchor: Anchor, window: tuple[float, float], possible: list[tuple[float, Fit]]
) -> xr.Dataset:
    """Return the master curve over the covered window with standard uncertainties.

    The uncertainty joins that of the spectrum, that of the shifts, vertical law and delay, and what
    repeats tell of the temperature of the sweeps at the reference. How
    much to smooth the spectrum is itself known from the data only: the variance is the mean over
    strengths of the smoothing, the curve's own change with them included, each weighed with
    exp(-C_p / 2) (Mallows' C_p; Burnham & Anderson, Model Selection, 2002, ch. 4). Taken at the
    chosen strength alone it was too small where that happened to be too strong.
    """
    decades = np.log10(window[1] / window[0])
    count = max(int(np.ceil(decades * _CURVE_POINTS)), 1) + 1
    frequency = np.geomspace(window[0], window[1], count)
    ln_omega = np.log(2.0 * np.pi * frequency) + _LN10 * anchor.offset
    fit = found.fit
    shapes = maxwell_shapes(ln_omega, fit.grid.ln_time)
    constant = np.ones(count)
    designs = [
        np.column_stack([shapes[0], constant]) * fit.grid.scale,
        np.column_stack([shapes[1], 0.0 * constant]) * fit.grid.scale,
    ]
    active = fit.solution.coefficient > 0
    variables = {}
    for name, design in zip(("storage", "loss"), designs, strict=True):
        value = design @ fit.solution.coefficient
        squared = sum(share * _from_spectrum(one, design, value) for share, one in possible)
        squared += _from_outer(points, found, anchor, design, frequency, design[:, active])
        squared += float(np.sum((anchor.share * anchor.own) ** 2)) * _per_decade(value, frequency) ** 2
        variables[name] = (value, f"{name} modulus at the reference temperature")
        variables[f"u_{name}"] = (np.sqrt(np.maximum(squared, 0.0)), f"standard uncertainty of the {name} modulus")
    dimension, words = "reduced_frequency", "frequency at the reference temperature"
    named = {name: variable(dimension, values, "Pa", text) for name, (values, text) in variables.items()}
    dataset = xr.Dataset(named, coords={dimension: variable(dimension, frequency, "Hz", words)})
    factor = dataset["loss"] / dataset["storage"]
    factor.attrs = described("1", "loss factor at the reference temperature")
    return dataset.assign(loss_factor=factor)


def possible_spectra(points: Points, found: Superposition) -> list[tuple[float, Fit]]:
    """Return the fit and those of other smoothing at its shifts, with their shares."""
    fit, length = found.fit, found.run_length
    weight = fit.by_vertical / fit.predicted / np.sqrt(length)
    chosen = fit.solution.strength / length
    fits = [evaluate(points, weight, fit.grid, fit.state, chosen * factor) for factor in _STRENGTHS]
    price = np.array([one.solution.misfit + 2.0 * one.solution.freedom for one in fits])
    share = np.exp(-0.5 * (price - price.min()))
    return list(zip((share / share.sum()).tolist(), fits, strict=True))


def _from_spectrum(fit: Fit, design: Floats, value: Floats) -> Floats:
    """Variance of the curve ``value`` if this fit's smoothing were the right one."""
    used = design[:, fit.solution.coefficient > 0]
    covariance = np.linalg.pinv(fit.normal, hermitian=True)
    moved = design @ fit.solution.coefficient - value
    return propagated_variance(used, covariance) + moved**2


def _from_outer(
    points: Points, found: Superposition, anchor: Anchor, design: Floats, frequency: Floats, used: Floats
) -> Floats:
    """Variance of the curve from the outer parameters, the spectrum following them."""
    model, fit = found.model, found.fit
    if not model.size:
        return np.zeros(frequency.size)
    coupling = fit.rows.T @ sensitivity(points, fit, model)
    by_parameter = -used @ solve_normal(fit.normal, coupling)
    # The reference itself moves along the curve with the shifts that define it.
    value = design @ fit.solution.coefficient
    reference = anchor.share @ model.directions(fit.state)[0]
    by_parameter += _per_decade(value, frequency)[:, None] * reference
    return propagated_variance(by_parameter, found.covariance)


def _per_decade(value: Floats, frequency: Floats) -> Floats:
    """Return the change of a curve per decade of frequency."""
    return np.asarray(np.gradient(value, np.log10(frequency))) if frequency.size > 1 else np.zeros(1)

"""The glass transition in a temperature sweep at one frequency: peak of tan δ, drop of E′."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.uncertainty import propagated_u
from labpipe.variables import variable

FEWEST = 9  # points of a temperature sweep in which a transition is looked for
_HALF_WINDOW = 6.0  # K to either side in which a slope is fitted
_MEAN_OF = 5  # points of the moving mean that finds a maximum
_CREST = 0.75  # of a maximum's height above the lowest value; a cubic fits the part above
_LEAST_IN_WINDOW, _LEAST_ON_A_SIDE = 5, 2
_LEAST_DROP = 2.0  # a storage modulus that falls by less over the sweep shows no glass transition
_SIGNIFICANT = 3.0  # standard uncertainties by which a peak must stand out of its ends


@dataclass(frozen=True, slots=True)
class Ramp:
    """One temperature sweep in tension: frequency [Hz], temperatures [degC], moduli [Pa]."""

    frequency: float
    temperature: Floats
    storage: Floats
    loss: Floats


def transitions(ramps: Sequence[Ramp]) -> xr.Dataset:
    """Return the readings of all ramps in one row, and the transition of every ramp.

    Over ``point`` these are ``temperature``, ``storage``, ``loss``, ``loss_factor``, ``ramp_of``; over ``ramp``:
    ``frequency``, ``T_peak`` (maximum of tan δ), ``T_loss`` (maximum of E″), ``T_drop`` (steepest fall of ln E′), each
    with its uncertainty, NaN where there is none.
    """
    ordered = [_ascending(ramp) for ramp in ramps]
    counts = [r.temperature.size for r in ordered]
    columns = {
        "ramp_of": (np.repeat(np.arange(len(ordered)), counts), "1", "number of the ramp"),
        "temperature": (_joined(ordered, "temperature"), "degC", "measured temperature"),
        "storage": (_joined(ordered, "storage"), "Pa", "storage modulus, tension"),
        "loss": (_joined(ordered, "loss"), "Pa", "loss modulus, tension"),
        "loss_factor": (_joined(ordered, "loss") / _joined(ordered, "storage"), "1", "loss factor"),
    }
    found = [_transition(r) for r in ordered]
    texts = {
        "T_peak": "glass transition: maximum of the loss factor",
        "T_loss": "glass transition: maximum of the loss modulus",
        "T_drop": "glass transition: steepest fall of the storage modulus",
    }
    variables = {name: variable("point", values, units, text) for name, (values, units, text) in columns.items()}
    for i, (name, text) in enumerate(texts.items()):
        values = [f[i] for f in found]
        variables[name] = variable("ramp", np.array([v for v, _ in values]), "degC", text)
        variables[f"u_{name}"] = variable(
            "ramp", np.array([u for _, u in values]), "K", f"standard uncertainty: {text}"
        )
    drop = np.array([float(r.storage[0] / r.storage[-1]) for r in ordered])
    variables["drop"] = variable("ramp", drop, "1", "storage modulus, cold end over warm end")
    variables["frequency"] = variable("ramp", np.array([r.frequency for r in ordered]), "Hz", "frequency of the sweep")
    work = {"temperature_sweeps": len(ordered), "points": int(sum(counts))}
    return xr.Dataset(variables, attrs={"work": json.dumps(work)})


def _ascending(ramp: Ramp) -> Ramp:
    order = np.argsort(ramp.temperature, kind="stable")
    return Ramp(ramp.frequency, ramp.temperature[order], ramp.storage[order], ramp.loss[order])


def _joined(ramps: Sequence[Ramp], name: str) -> Floats:
    return np.concatenate([getattr(r, name) for r in ramps])


def _transition(ramp: Ramp) -> list[tuple[float, float]]:
    """Return maximum of tan δ, maximum of E″ and steepest fall of ln E′, each with its u."""
    T = ramp.temperature
    if ramp.storage[0] / ramp.storage[-1] < _LEAST_DROP or np.any(ramp.storage <= 0):
        return [(np.nan, np.nan)] * 3
    slope = -_smooth_slope(T, np.log(ramp.storage))
    return [peak(T, ramp.loss / ramp.storage), peak(T, ramp.loss), _of_slope(T, slope)]


def _of_slope(T: Floats, slope: Floats) -> tuple[float, float]:
    """Return the steepest fall; neighbouring slopes share readings, so their noise is common."""
    where, u = peak(T, slope)
    shared = 2 * _HALF_WINDOW / max(float(np.median(np.diff(T))), 1e-3)
    return where, u * float(np.sqrt(max(shared, 1.0)))


def _smooth_slope(T: Floats, y: Floats) -> Floats:
    """Return dy/dT by parabolas through the neighbourhood of every point."""
    slope = np.full(T.size, np.nan)
    for i, centre in enumerate(T):
        near = np.abs(T - centre) <= _HALF_WINDOW
        is_inside = min(centre - T[0], T[-1] - centre) >= _HALF_WINDOW
        if is_inside and near.sum() >= _LEAST_IN_WINDOW:
            slope[i] = np.polyfit(T[near] - centre, y[near], 2)[1]
    return slope


def peak(T: Floats, y: Floats) -> tuple[float, float]:
    """Return where a curve has its maximum, by a cubic about it, with the uncertainty.

    NaN when the maximum lies at an end of the sweep or does not stand out.

    Examples
    --------
    >>> T = np.arange(0.0, 41.0, 2.0)
    >>> where, u = peak(T, 5.0 - 0.01 * (T - 21.0) ** 2)
    >>> round(where, 6)
    21.0
    """
    good = np.isfinite(y)
    T, y = T[good], y[good]
    if T.size < FEWEST:
        return np.nan, np.nan
    smooth = np.convolve(y, np.ones(_MEAN_OF) / _MEAN_OF, mode="valid")
    edge = _MEAN_OF // 2
    top = int(np.argmax(smooth)) + edge
    centre = float(T[top])
    near = _crest(T, smooth, top - edge, edge)
    below, above = int((T[near] - centre < 0).sum()), int((T[near] - centre > 0).sum())
    if near.sum() < _LEAST_IN_WINDOW or min(below, above) < _LEAST_ON_A_SIDE:
        return np.nan, np.nan  # the maximum lies at an end of the sweep, or beyond
    cubic, parabola = (_summit(T[near] - centre, y[near], degree) for degree in (3, 2))
    if cubic is None or parabola is None:
        return np.nan, np.nan
    # What the form of the curve contributes: half the difference between both.
    return centre + cubic[0], float(np.hypot(cubic[1], 0.5 * (cubic[0] - parabola[0])))


def _summit(x: Floats, y: Floats, degree: int) -> tuple[float, float] | None:
    """Return where a fitted polynomial has its maximum, with its uncertainty from the noise."""
    design = np.vander(x, degree + 1)
    coefficient, *_ = np.linalg.lstsq(design, y, rcond=None)
    slope = np.polyder(coefficient)
    bend = np.polyder(slope)
    roots = [float(r.real) for r in np.roots(slope) if abs(r.imag) < 1e-9]
    tops = [r for r in roots if np.polyval(bend, r) < 0 and x.min() <= r <= x.max()]
    if not tops:
        return None
    top = min(tops, key=abs)
    residual = y - design @ coefficient
    freedom = max(x.size - degree - 1, 1)
    covariance = np.linalg.inv(design.T @ design) * float(residual @ residual) / freedom
    # The slope at the top is zero, so its uncertainty over the bend is that of the place.
    gradient = np.array([k * top ** (k - 1) if k else 0.0 for k in range(degree, -1, -1)])
    curvature = float(np.polyval(bend, top))
    rows = np.array([k * (k - 1) * top ** max(k - 2, 0) for k in range(degree, -1, -1)])
    if abs(curvature) < _SIGNIFICANT * propagated_u(rows, covariance):
        return None
    return top, float(propagated_u(gradient, covariance)) / abs(curvature)


def _crest(T: Floats, smooth: Floats, top: int, edge: int) -> NDArray[np.bool_]:
    """Return the points about a maximum that lie above the share ``_CREST`` of its height."""
    height = smooth[top]
    base = min(float(smooth.min()), float(height))
    is_high = smooth >= base + _CREST * (height - base)
    first, last = top, top
    while first > 0 and is_high[first - 1]:
        first -= 1
    while last < smooth.size - 1 and is_high[last + 1]:
        last += 1
    near = np.zeros(T.size, dtype=bool)
    # The moving mean does not reach the ends of the sweep; a crest that does goes on to them.
    begin = 0 if first == 0 else first + edge
    end = T.size if last == smooth.size - 1 else last + edge + 1
    near[begin:end] = True
    return near

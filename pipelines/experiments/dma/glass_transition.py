"""The glass transition in a temperature sweep at one frequency: peak of tan δ, drop of E′."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

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
    ordered = []
    for ramp in ramps:
        order = np.argsort(ramp.temperature, kind="stable")
        ordered.append(Ramp(ramp.frequency, ramp.temperature[order], ramp.storage[order], ramp.loss[order]))
    T, storage, loss = (np.concatenate([getattr(r, n) for r in ordered]) for n in ("temperature", "storage", "loss"))
    counts = [r.temperature.size for r in ordered]
    variables = {
        "ramp_of": variable("point", np.repeat(np.arange(len(ordered)), counts), "1", "number of the ramp"),
        "temperature": variable("point", T, "degC", "measured temperature"),
        "storage": variable("point", storage, "Pa", "storage modulus, tension"),
        "loss": variable("point", loss, "Pa", "loss modulus, tension"),
        "loss_factor": variable("point", loss / storage, "1", "loss factor"),
    }
    found = np.array([_transition(r) for r in ordered])
    texts = {
        "T_peak": "glass transition: maximum of the loss factor",
        "T_loss": "glass transition: maximum of the loss modulus",
        "T_drop": "glass transition: steepest fall of the storage modulus",
    }
    for i, (name, text) in enumerate(texts.items()):
        variables[name] = variable("ramp", found[:, i, 0], "degC", text)
        variables[f"u_{name}"] = variable("ramp", found[:, i, 1], "K", f"standard uncertainty: {text}")
    drop = np.array([float(r.storage[0] / r.storage[-1]) for r in ordered])
    variables["drop"] = variable("ramp", drop, "1", "storage modulus, cold end over warm end")
    variables["frequency"] = variable("ramp", np.array([r.frequency for r in ordered]), "Hz", "frequency of the sweep")
    work = {"temperature_sweeps": len(ordered), "points": int(sum(counts))}
    return xr.Dataset(variables, attrs={"work": json.dumps(work)})


def _transition(ramp: Ramp) -> list[tuple[float, float]]:
    """Return maximum of tan δ, maximum of E″ and steepest fall of ln E′, each with its u."""
    T = ramp.temperature
    if ramp.storage[0] / ramp.storage[-1] < _LEAST_DROP or np.any(ramp.storage <= 0):
        return [(np.nan, np.nan)] * 3
    where, u = peak(T, -_smooth_slope(T, np.log(ramp.storage)))
    # neighbouring slopes share readings, so their noise is common
    shared = max(2 * _HALF_WINDOW / max(float(np.median(np.diff(T))), 1e-3), 1.0)
    return [peak(T, ramp.loss / ramp.storage), peak(T, ramp.loss), (where, u * float(np.sqrt(shared)))]


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
    height, base = smooth[top - edge], float(smooth.min())
    low = np.flatnonzero(smooth < base + _CREST * (height - base))
    first, last = low[low < top - edge][-1:] + 1, low[low > top - edge][:1] - 1
    # the moving mean does not reach the ends of the sweep; a crest that does goes on to them
    begin = int(first[0]) + edge if first.size else 0
    near = slice(begin, int(last[0]) + edge + 1 if last.size else T.size)
    below, above = int((T[near] < centre).sum()), int((T[near] > centre).sum())
    if T[near].size < _LEAST_IN_WINDOW or min(below, above) < _LEAST_ON_A_SIDE:
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

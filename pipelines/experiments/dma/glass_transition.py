"""The glass transition: in a temperature sweep at one frequency, and by the shifts over all frequencies."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL
from labpipe.uncertainty import propagated_u
from labpipe.variables import variable, with_u

MEAN_OF = 5
"""Points of the moving mean that finds a maximum; twice as many make a sweep in which one is looked for."""
_LEAST_DROP = 2.0  # a storage modulus that falls by less over the sweep shows no glass transition


def transitions(ramps: Sequence[tuple[float, Floats]], half_window: float = 6.0) -> xr.Dataset:
    """Return the readings of all temperature sweeps in one row, and the transition of every one.

    ``ramps`` are frequency [Hz] and (column, point) of each: temperature [degC], storage and loss modulus in tension
    [Pa]. Over ``point`` these are ``temperature``, ``storage``, ``loss``, ``loss_factor``, ``ramp_of``; over ``ramp``:
    ``frequency``, ``T_peak`` (maximum of tan δ) and ``T_drop`` (steepest fall of ln E′), each with its uncertainty, NaN
    where there is none; a slope is fitted over the ``half_window`` [K] to either side. The attribute ``reasons`` (JSON)
    says why there is no maximum, ramp by ramp.
    """
    columns = [one[:, np.argsort(one[0], kind="stable")] for _, one in ramps]
    T, storage, loss = np.concatenate(columns, axis=1)
    numbers = np.repeat(np.arange(len(ramps)), [one.shape[1] for one in columns])
    variables = {
        "ramp_of": variable("point", numbers, "1", "number of the ramp"),
        "temperature": variable("point", T, "degC", "measured temperature"),
        "storage": variable("point", storage, "Pa", "storage modulus, tension"),
        "loss": variable("point", loss, "Pa", "loss modulus, tension"),
        "loss_factor": variable("point", loss / storage, "1", "loss factor"),
        "frequency": variable("ramp", [frequency for frequency, _ in ramps], "Hz", "frequency of the sweep"),
    }
    found = np.full((len(ramps), 2, 2), np.nan)  # by tan δ and by ln E′, each with its u
    for i, (T_of, E, E_loss) in enumerate(columns):
        if E[0] / E[-1] >= _LEAST_DROP and not np.any(E <= 0):
            slope = np.full(T_of.size, np.nan)  # of ln E′, by parabolas through the neighbourhood of every point
            for j, centre in enumerate(T_of):
                near = np.abs(T_of - centre) <= half_window
                is_inside = min(centre - T_of[0], T_of[-1] - centre) >= half_window
                if is_inside and near.sum() >= MEAN_OF:
                    slope[j] = np.polyfit(T_of[near] - centre, np.log(E[near]), 2)[1]
            where, u = peak(T_of, -slope)
            # neighbouring slopes share readings, so their noise is common
            shared = max(2 * half_window / max(float(np.median(np.diff(T_of))), 1e-3), 1.0)
            found[i] = peak(T_of, E_loss / E), (where, u * float(np.sqrt(shared)))
    texts = ("maximum of the loss factor", "steepest fall of the storage modulus")
    for (at, u), name, text in zip(np.moveaxis(found, 0, 2), ("T_peak", "T_drop"), texts, strict=True):
        variables |= with_u(name, "ramp", at, u, "degC", f"glass transition: {text}")
    work = {"temperature_sweeps": len(ramps), "points": int(T.size)}
    reasons = [_why_none(T, E, loss / E) for T, E, loss in columns]
    said = {"work": json.dumps(work), "reasons": json.dumps(reasons, ensure_ascii=False)}
    return xr.Dataset(variables, attrs=said)


def _why_none(T: Floats, storage: Floats, y: Floats) -> str:
    """Say why a sweep (or, over the shifted isotherms, a master curve) shows no maximum."""
    fall = float(storage.max() / storage[np.isfinite(storage)][-1])
    ends = f"{T[0]:.0f} to {T[-1]:.0f} °C".replace("-", "\N{MINUS SIGN}")
    if fall < _LEAST_DROP:
        return f"E′ falls by a factor of {fall:.2g} only from {ends}: no glass transition lies there"
    top = int(np.nanargmax(y))
    if top == y.size - 1:
        return f"it still rises at the warm end ({T[-1]:.0f} °C): the maximum lies above"
    return f"the largest value, near the {'warm' if 2 * top > y.size else 'cold'} end, has too few readings beyond it"


def over_frequency(curve: xr.Dataset, half_decades: float = 0.5) -> tuple[xr.Dataset, str]:
    """Return the glass transition over frequency, θ_g(f), by the shifts of a master curve.

    By E(ω, T) = b_T E(a_T ω, T_ref), tan δ at a frequency f has its maximum over temperature where a_T f is the
    frequency of the maximum of the master curve: that of a parabola over the ``half_decades`` to either side.

    Returns
    -------
    transitions : Dataset
        ``T_peak`` [degC] with its uncertainty over ``transition_frequency``, whole decades [Hz] from the slowest of
        the sweeps on at which the transition is among the isotherms.
    reason : str
        Why there is none.
    """
    T, shifts = (curve[name].values for name in ("temperature", "log10_aT"))
    known = np.flatnonzero(np.isfinite(shifts))[np.argsort(T[np.isfinite(shifts)], kind="stable")]
    T, falling = T[known], np.minimum.accumulate(shifts[known])
    x, order = np.log10(curve["reduced_frequency"].values), np.argsort(curve["mode_temperature"].values)
    near_T, near_x = curve["mode_temperature"].values[order], np.log10(curve["mode_frequency"].values)
    moved = np.array([np.interp(T, near_T, row[order]) for row in curve["mode_shift"].values])
    storage, y, dims = curve["master_storage"].values[::-1], curve["master_loss_factor"].values, "transition_frequency"
    change = curve["mode_loss"].values - curve["mode_storage"].values
    near = np.abs(x - x[np.argmax(y)]) <= half_decades
    middle = x[near].mean()
    is_inside = min(x[np.argmax(y)] - x[0], x[-1] - x[np.argmax(y)]) >= half_decades
    lines = np.log(y[near]) + np.vstack([0 * x[near], [np.interp(x[near], near_x, row) for row in change]])
    bend, slope, _ = np.polyfit(x[near] - middle, lines.T, 2)
    if storage.max() / storage[-1] < _LEAST_DROP or not is_inside or np.any(bend >= 0.0):
        return xr.Dataset(), _why_none(T, storage, y[::-1])
    top = middle - 0.5 * slope / bend
    decades = np.arange(np.floor(np.log10(curve["frequency"].values.min()) + 1e-9), x[-1] - falling[-1])
    values = np.interp(decades - top[0], -falling, T, left=np.nan, right=np.nan)
    if not np.isfinite(values).any():
        return xr.Dataset(), "at the frequencies of the sweeps and faster ones it lies beyond the isotherms"
    at = [np.interp(decades - t, -f, T) for t, f in zip(top, [falling, *(falling + moved)], strict=True)]
    u = np.where(np.isfinite(values), np.linalg.norm(np.array(at[1:]) - at[0], axis=0), np.nan)
    made: dict[str, Any] = {dims: variable(dims, 10.0**decades, "Hz", "frequency of a measurement")}
    made |= with_u("T_peak", dims, values, u, "degC", "glass transition: maximum of the loss factor over frequency")
    return xr.Dataset(made).dropna(dims, how="all"), ""


def peak(T: Floats, y: Floats, crest: float = 0.75) -> tuple[float, float]:
    """Return where a curve has its maximum, by a cubic about it, with the uncertainty.

    The cubic fits what exceeds a part, the ``crest``, of the maximum's height above the lowest value. NaN when the
    maximum is at an end of the sweep or its bend is no clear one.

    Examples
    --------
    >>> T = np.arange(0.0, 41.0, 2.0)
    >>> where, u = peak(T, 5.0 - 0.01 * (T - 21.0) ** 2)
    >>> round(where, 6)
    21.0
    """
    T, y = T[np.isfinite(y)], y[np.isfinite(y)]
    if T.size < 2 * MEAN_OF:
        return np.nan, np.nan
    smooth, edge = np.convolve(y, np.ones(MEAN_OF) / MEAN_OF, mode="valid"), MEAN_OF // 2
    top = int(np.argmax(smooth))
    centre, base = float(T[top + edge]), float(smooth.min())
    low = np.flatnonzero(smooth < base + crest * (smooth[top] - base))
    # the moving mean does not reach the ends of the sweep; a crest that does goes on to them
    begin, end = low[low < top][-1:] + edge + 1, low[low > top][:1] + edge
    near = slice(int(begin[0]) if begin.size else 0, int(end[0]) if end.size else T.size)
    x, y = T[near] - centre, y[near]
    if x.size < MEAN_OF or min((x < 0).sum(), (x > 0).sum()) < edge:
        return np.nan, np.nan  # the maximum lies at an end of the sweep, or beyond
    found = []
    for degree in (3, 2):
        coefficient, covariance = np.polyfit(x, y, degree, cov=True)
        slope, powers = np.polyder(coefficient), np.eye(degree + 1)
        roots = [float(r.real) for r in np.roots(slope) if abs(r.imag) < 1e-9]
        tops = [r for r in roots if np.polyval(np.polyder(slope), r) < 0 and x.min() <= r <= x.max()]
        if not tops:
            return np.nan, np.nan
        place = min(tops, key=abs)
        # The slope at the top is zero, so its uncertainty over the bend is that of the place.
        first, second = (np.array([np.polyval(np.polyder(one, m), place) for one in powers]) for m in (1, 2))
        bend = abs(float(second @ coefficient))
        if bend < DOUBTFUL * propagated_u(second, covariance):
            return np.nan, np.nan
        found.append((place, float(propagated_u(first, covariance)) / bend))
    (cubic, u), (parabola, _) = found
    return centre + cubic, float(np.hypot(u, 0.5 * (cubic - parabola)))

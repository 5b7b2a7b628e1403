"""Velocity from displacement, with its uncertainty; the noise is estimated from the record.

Three estimators: ``"spline"`` (see :mod:`._smoothing_spline`), ``"thesis"`` (central differences and a moving average,
eq. 3.11-3.14) and ``"difference"`` (3.11-3.13 alone).
"""

from __future__ import annotations

import json
import warnings
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy import sparse

from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError
from labpipe.signals._hum import Hum
from labpipe.signals._noise import Noise, estimate_noise
from labpipe.signals._noise_spectrum import u_of_rate
from labpipe.signals._outliers import outliers
from labpipe.signals._readings import checked_times, refuse_infinite
from labpipe.signals._smoothing_spline import Cuts, smooth
from labpipe.units import Measure, si
from labpipe.variables import described

Method = Literal["spline", "thesis", "difference"]

_FEWEST_FOR_SPLINE = 12  # below, noise and motion cannot be distinguished


def velocity(
    displacement: xr.Dataset | xr.DataArray,
    method: Method = "spline",
    *,
    events: xr.Dataset | None = None,
    breaks: ArrayLike | None = None,
    releases: ArrayLike | None = None,
    noise: Measure | None = None,
    window: int = 5,
) -> xr.DataArray:
    """Differentiate a displacement record.

    Parameters
    ----------
    displacement : Dataset with ``displacement`` or DataArray, over time [m]
        Coordinate ``time`` in s, strictly increasing, evenly spaced or not; NaN is left out. An attribute ``hum`` of
        the Dataset says which hum was taken out of it already.
    method : {"spline", "thesis", "difference"}
        ``"spline"``: adaptive quintic smoothing spline, which finds impacts by itself. ``"thesis"``: central
        differences, one-sided at the ends (3.11-3.13), then a moving average of ``window`` samples that shortens
        symmetrically towards the ends (3.14). ``"difference"``: without the moving average.
    events : Dataset, optional
        Spline only: of :func:`labpipe.signals.bounces`. The hum found there is taken out, and touches and lift-offs
        are breaks.
    breaks, releases : array (k,), optional [s]
        Spline only: times of touch and lift-off, at which the third derivative may jump, and times at which the
        acceleration itself may (a release, a hard stop).
    noise : float or text with a unit, optional [m]
        Standard deviation of the samples' white noise. Default: estimated from the record.
    window : int
        Thesis only: number of samples, by default that of ``smooth(v)``, as the thesis does not print it; an even
        number is reduced by one, as ``smooth`` does.

    Returns
    -------
    DataArray (time,) [m/s]
        Named ``velocity``, with the coordinate ``u_velocity`` (time,) [m/s], the standard uncertainty; NaN where the
        displacement is. Attributes: ``method``; ``noise`` (m), ``noise_block`` (samples over which the noise is
        correlated), ``quantisation`` (m); ``n_spikes`` (outliers given no weight); ``work`` (JSON counts).

    Raises
    ------
    InputError
        No displacement over increasing times in m, fewer than two readings (12 for the spline), infinite values, a
        negative noise, breaks that are not finite, or a window below 1 or longer than the record.

    Warns
    -----
    UserWarning
        Outliers left out (:func:`labpipe.signals.outliers`).

    Notes
    -----
    For the spline ``u_velocity`` is the posterior standard deviation and includes the expected smoothing error, and
    noise that is not white as far as the record has stretches of rest or flight that show it. It cannot include motion
    that stays below the noise over its whole life, such as the last cycles of a decaying vibration, nor the
    smoothing of a computed curve: up to 1e-3 of the largest velocity where there is no noise. For the two
    difference schemes it is the propagated noise alone: their blunting of an impact is not in it.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 201)
    >>> fall = xr.DataArray(-4.9 * time**2, {"time": time}, attrs={"units": "m"})
    >>> round(float(velocity(fall).sel(time=0.5)), 6)
    -4.9
    """
    record = _displacement_of(displacement)
    time, values = checked_record(record)
    if events is not None and method == "spline":
        hum = Hum.of_text(events.attrs.get("hum"))
        taken = Hum.of_text(displacement.attrs.get("hum")) if isinstance(displacement, xr.Dataset) else None
        for sign, line in ((1.0, taken), (-1.0, hum)):
            values = values if line is None else values + sign * line.at(time)
        edges = np.concatenate([events["touch_time"].values, events["liftoff_time"].values])
        breaks = np.sort(edges[np.isfinite(edges)]) if breaks is None else breaks
    is_read = np.isfinite(values)
    t, y = time[is_read], values[is_read]
    known = estimate_noise(y - y[0], t)
    if noise is not None:
        sigma = si(noise, "m", "noise")
        if not (np.isfinite(sigma) and sigma >= 0.0):
            raise InputError(f"noise must be a standard deviation in m, >= 0; found {sigma}")
        known = Noise(max(sigma, known.step / np.sqrt(12.0)), known.step, 1)
    if method == "spline":
        if len(t) < _FEWEST_FOR_SPLINE:
            raise InputError(
                f"a spline needs {_FEWEST_FOR_SPLINE} readings, found {len(t)}; for differences, say "
                'method="difference" and give the noise'
            )
        cuts = (_times(breaks, "breaks"), _times(releases, "releases"))
        v, u, attributes = _spline(t, y, known.sigma, cuts)
    elif method in ("thesis", "difference"):
        if method == "thesis" and not 1 <= window <= len(t):
            raise InputError(f"window must be from 1 to the {len(t)} readings; found {window}")
        span = window - 1 + window % 2 if method == "thesis" else 1
        v, u = _differences(t, y, known.sigma, span)
        attributes = {"window": span, "n_spikes": 0, "work": json.dumps({"samples": len(t)})}
    else:
        raise InputError(f'method must be "spline", "thesis" or "difference"; found "{method}"')
    if not is_read.all():
        v, u = (np.insert(each, np.searchsorted(t, time[~is_read]), np.nan) for each in (v, u))
    u_velocity = ("time", u, described("m/s", "standard uncertainty of velocity"))
    attributes |= {"noise": known.sigma, "noise_block": known.block, "quantisation": known.step}
    attributes |= described("m/s", "velocity") | {"method": method}
    coordinates = {"time": record["time"].variable, "u_velocity": u_velocity}
    return xr.DataArray(v, coordinates, ["time"], "velocity", attributes)


def _displacement_of(given: object) -> xr.DataArray:
    """Return the record that :func:`velocity` was given, or say how to make one of another argument."""
    if isinstance(given, xr.DataArray):
        return given
    if not isinstance(given, xr.Dataset):
        raise InputError(
            f"velocity takes a DataArray or Dataset over time, found {type(given).__name__}; make one of numbers by "
            'xr.DataArray(values, {"time": times}, attrs={"units": "m"}), and of a film by labpipe.track'
        )
    if "displacement" not in given:
        lengths = [str(name) for name, record in given.data_vars.items() if record.attrs.get("units") == "m"]
        remedy = f'pass one of its lengths, such as readings["{lengths[0]}"]' if lengths else "none of them is a length"
        raise InputError(
            f'the Dataset has no variable "displacement" but {", ".join(map(str, given.data_vars))}; {remedy}'
        )
    return given["displacement"]


def checked_record(displacement: xr.DataArray) -> tuple[Floats, Floats]:
    """Time and values of a displacement record as float64 copies, or say why it is none."""
    if displacement.dims != ("time",) or "time" not in displacement.coords:
        raise InputError(
            f"displacement must have the one dimension time with its coordinate; found dimensions {displacement.dims}"
        )
    unit = displacement.attrs.get("units", "m")
    if unit != "m":
        raise InputError(f'displacement must be in "m"; found "{unit}": convert it first')
    time = checked_times(displacement["time"].values)
    values = np.array(displacement.values, dtype=float)
    refuse_infinite(values, "displacement")
    if np.isfinite(values).sum() < 2:
        raise InputError(f"a velocity needs two readings; found {int(np.isfinite(values).sum())}")
    return time, values


def _times(times: ArrayLike | None, name: str) -> list[float]:
    found = np.asarray([] if times is None else times, float).ravel()
    if not np.isfinite(found).all():
        raise InputError(f"{name} must be finite times in s; found {found[~np.isfinite(found)][0]}")
    return [float(time) for time in found]


def _spline(t: Floats, y: Floats, sigma: float, cuts: Cuts) -> tuple[Floats, Floats, dict[str, Any]]:
    """Velocity, uncertainty and attributes of the smoothing spline."""
    if sigma <= 0.0:
        # All readings are exactly equal (after their mean): nothing moves, nothing to fit.
        return np.zeros(len(t)), np.zeros(len(t)), {"n_spikes": 0, "work": json.dumps({"samples": len(t)})}
    wild = outliers(y, t, noise=sigma)
    n_spikes = int(wild.flags.sum())
    if n_spikes:
        warnings.warn(wild.message(t), UserWarning, stacklevel=3)
    kept: Flags | slice = ~wild.flags if n_spikes else slice(None)
    fit = smooth(t[kept], y[kept], sigma, 1, cuts, t)
    (_, v), (u_level, u) = fit.value, fit.u
    u[kept] = u_of_rate(y[kept], sigma, u_level[kept], (v[kept], u[kept]))
    counts = {"samples": len(t), "coefficients": fit.n_coefficients, "band_solves": fit.n_solves}
    return v, u, {"n_spikes": n_spikes, "work": json.dumps(counts)}


def _differences(t: Floats, y: Floats, sigma: float, window: int) -> tuple[Floats, Floats]:
    """Thesis (3.11)-(3.14): the scheme is linear, so its noise follows exactly."""
    n = len(t)
    rows = np.arange(n)
    left, right = np.maximum(rows - 1, 0), np.minimum(rows + 1, n - 1)
    weight = 1.0 / (t[right] - t[left])
    scheme = sparse.csr_array(
        (np.concatenate([weight, -weight]), (np.concatenate([rows, rows]), np.concatenate([right, left]))), shape=(n, n)
    )
    half = np.minimum(np.minimum(rows, n - 1 - rows), window // 2)
    size = 2 * half + 1
    columns = np.repeat(rows - half, size) + (np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size))
    average = sparse.csr_array((np.repeat(1.0 / size, size), (np.repeat(rows, size), columns)), shape=(n, n))
    combined = (average @ scheme).tocsr()
    u = sigma * np.sqrt(np.asarray(combined.multiply(combined).sum(axis=1)).ravel())
    return np.asarray(combined @ (y - y.mean())), u

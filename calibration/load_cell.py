"""Load cell: compression-positive force, tare, and the lag of the instrument's low-pass filter.

A six-axis cell counts compression negative, a single-axis cell positive; the reader of the
instrument says which in ``compression_sign``. The files are not tared, and the force in them has
passed a low-pass that the position has not.
"""

import json
import math
from collections.abc import Mapping
from datetime import date
from functools import cache
from typing import Any, NamedTuple, cast

import numpy as np
import xarray as xr

from calibration import _quiet
from calibration.record import LoadCellRecord, LoadCellValues, Record, require
from labpipe.arrays import Complexes
from labpipe.errors import CalibrationError, InputError
from labpipe.uncertainty import Source, budget_rows, combined_uncertainty
from labpipe.units import Quantity
from labpipe.variables import variable, with_u

__all__ = ["FilterLag", "declared_filter", "filter_lag", "force"]

#: The factor that the instrument has applied; without a record nobody knows how good it is.
_UNKNOWN = Quantity(1.0, math.nan, "1")


def force(
    readings: xr.Dataset,
    record: Record | None = None,
    *,
    zero: _quiet.Zero | None = None,
    compression_sign: int | None = None,
    measured: str | date | None = None,
) -> xr.Dataset:
    """Make a compression-positive, tared force with uncertainty.

    Parameters
    ----------
    readings : Dataset
        Over ``time`` (one block) or ``sample`` (a file of several blocks), with ``force_z`` [N].
    record : Record, optional
        Of the kind ``load_cell``; without one the factor that the instrument applied is kept,
        ``u_gain`` is NaN, and the budget holds only the scatter of the readings themselves.
    zero : "start" or (float, float) or Quantity or float, optional
        Where the force is zero: the quiet beginning of the (first) block, a window of it in s,
        or a reading [N]. By default nothing is subtracted: a block may begin under load.
    compression_sign : {1, -1}, optional
        Where the file does not state the type of its load cell.
    measured
        See :func:`calibration.record.require`.

    Returns
    -------
    Dataset
        ``force`` [N] with its random ``u_force``, ``force_raw`` (as in the file), ``valid``;
        scalars ``tare`` [N, in the sign of the file] and ``gain``, each with ``u_``. Attributes
        ``budget`` (JSON rows, for the largest force), ``filter`` (JSON), ``calibration``.

    Raises
    ------
    CalibrationError
        The record does not belong to the readings, the sign is not known, or a block that should
        give the tare begins in motion.
    InputError
        There is no such force.
    """
    name = "force_z"
    if name not in readings:
        raise InputError(f'the readings have no "{name}"')
    if isinstance(zero, str) and zero != "start":
        raise InputError(f'zero must be "start", a window, a force or None, found "{zero}"')
    if isinstance(zero, Quantity) and zero.si != "N":
        raise InputError(f"the zero is in {zero.si}, expected a force in N")
    if compression_sign not in (None, 1, -1):
        raise InputError(f"compression_sign must be 1 or -1, found {compression_sign}")
    sign = int(readings.attrs.get("compression_sign", 0)) if compression_sign is None else compression_sign
    if sign == 0:
        raise CalibrationError(
            "the file does not state whether compression is positive (single-axis cell) or "
            "negative (six-axis cell); give compression_sign=1 or compression_sign=-1"
        )
    checked: dict[str, Any] | str = "no record: the factor of the instrument, uncertainty unknown"
    values: LoadCellValues | None = None
    if record is not None:
        names = {(block["load_cell"] or {}).get("name") or "" for block in _blocks(readings.attrs)}
        attrs = readings.attrs | {"sensor": names.pop() if len(names) == 1 else ""}
        checked = require(record, "load_cell", attrs, measured=measured)
        values = cast("LoadCellRecord", record).values
    gain = values.scale if values else _UNKNOWN
    raw = np.asarray(readings[name].values, dtype=float)
    is_valid = np.isfinite(raw)
    if values and values.capacity:
        is_valid &= np.abs(np.nan_to_num(raw)) <= values.capacity.value
    used = np.where(is_valid, raw, np.nan)
    step = _quiet.resolution_of(used, None)
    time, first = readings["time"].values, slice(None)
    if "block" in readings.coords and "sample" in readings.dims and time.size:
        first = slice(0, int(np.sum(readings["block"].values == readings["block"].values[0])))
    at_rest = _quiet.of_zero(time, used, 0.0 if zero is None else zero, resolution=step, first=first)
    pressed = sign * gain.value * (used - at_rest.level) + 0.0  # no negative zeros
    spread = np.where(is_valid, gain.value * at_rest.noise, np.nan)
    sources = at_rest.sources("tare", "rounding to the cell's step", step, "N", sign * gain.value)
    if values:
        sources.append(Source.of("gain", gain, _quiet.largest(pressed) / gain.value))
    if values and values.linearity:
        sources.append(Source("linearity", 0.0, values.linearity.u, "N", 1.0, "systematic"))
    dimension = str(readings[name].dims[0])
    result = xr.Dataset(
        {
            "force": variable(dimension, pressed, "N", "force, compression positive"),
            "u_force": variable(dimension, spread, "N", "random standard uncertainty"),
            "force_raw": variable(dimension, raw, "N", "force as in the file"),
            "valid": variable(dimension, is_valid, "1", "whether there is a reading"),
        },
        coords=readings[name].coords,
        attrs={
            **{key: readings.attrs[key] for key in _KEPT if key in readings.attrs},
            "compression_sign": sign,
            "noise": at_rest.noise,
            "resolution": step,
            "tared": int(zero is not None),
            "u_largest": combined_uncertainty(sources),
            "budget": json.dumps(budget_rows(sources)),
            "filter": json.dumps(declared_filter(readings.attrs)),
            "calibration": json.dumps(checked, ensure_ascii=False),
        },
    )
    return result.assign(
        with_u("tare", (), at_rest.level, at_rest.u_level, "N", "reading at no force")
        | with_u("gain", (), gain.value, gain.u, "1", "true over displayed force")
    )


_KEPT = ("source", "start", "header", "function", "block_number", "work")


def _blocks(attrs: Mapping[str, Any]) -> list[dict[str, Any]]:
    if "block" in attrs:
        return [json.loads(attrs["block"])]
    return list(json.loads(attrs.get("blocks", "[]")))


class FilterLag(NamedTuple):
    """Effect of a low-pass on a sinusoid.

    Attributes
    ----------
    gain, u_gain : float
        Amplitude after over before: divide the measured amplitude by it.
    phase, u_phase : float [rad]
        By which the force comes late: add it to the measured phase of the force.
    delay : float [s]
        The same as a time.
    note : str
        The assumption.
    """

    gain: float
    u_gain: float
    phase: float
    u_phase: float
    delay: float
    note: str


_NOTE = (
    "causal Butterworth assumed; the header declares order and cutoff but not the type. The uncertainty spans Bessel "
    "and equal real poles of the same cutoff. Were the software to compensate the delay, there would be none: "
    "calibrate with an elastic reference before quoting a loss angle"
)


def filter_lag(frequency: float, order: int = 3, cutoff: float = 20.0) -> FilterLag:
    """Return amplitude and lag of the load cell's low-pass at one frequency.

    Parameters
    ----------
    frequency : float [Hz]
        Of the oscillation.
    order : int
        As declared.
    cutoff : float [Hz]
        Where the amplitude is 1/√2, as declared.

    Raises
    ------
    InputError
        A parameter is not positive.

    Notes
    -----
    Standard uncertainties are those of a rectangle from the smallest to the largest of the three
    types, taken about the Butterworth value that is returned.

    Examples
    --------
    >>> lag = filter_lag(2.0)
    >>> round(lag.delay * 1e3, 1), round(math.degrees(lag.phase), 1)
    (15.9, 11.5)
    """
    if frequency <= 0 or order < 1 or cutoff <= 0:
        raise InputError(f"expected positive numbers, found {frequency} Hz, order {order}, {cutoff} Hz")
    factors = [poles / (poles - 1j * frequency / cutoff) for poles in _poles(order)]
    gain, u_gain = _range([float(np.prod(np.abs(each))) for each in factors])
    # summed over poles the lag has no jumps
    phase, u_phase = _range([float(-np.sum(np.angle(each))) for each in factors])
    return FilterLag(gain, u_gain, phase, u_phase, phase / (2 * math.pi * frequency), _NOTE)


@cache
def _poles(order: int) -> list[Complexes]:
    """Poles of Butterworth, Bessel and equal real poles, all 1/√2 at the angular frequency 1."""
    from scipy import signal  # loads SciPy's statistics, which a comparison of stored results does not need

    # n equal real poles have amplitude 1/√2 at the cutoff when each is this much higher.
    higher = 1.0 / math.sqrt(2.0 ** (1.0 / order) - 1.0)
    return [signal.buttap(order)[1], signal.besselap(order, norm="mag")[1], np.full(order, -higher, dtype=complex)]


def _range(every: list[float]) -> tuple[float, float]:
    """Return the first value, and the standard deviation about it of a rectangle over all values."""
    low, high = min(every), max(every)
    return every[0], math.hypot((high - low) / math.sqrt(12), (low + high) / 2 - every[0])


def declared_filter(attrs: Mapping[str, Any]) -> dict[str, float] | None:
    """Return ``order`` and ``cutoff`` [Hz] that readings declare; None without a filter, or when blocks differ."""
    declared = [block.get("filter") for block in _blocks(attrs)]
    return declared[0] if declared and all(each == declared[0] for each in declared) else None

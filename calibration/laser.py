"""Laser displacement: vertical motion from readings along an inclined line of sight.

The sensor looks along a line at the angle θ to the motion, so a motion d changes the reading by
d cos θ. With the gain g of the sensor, its zero z and the direction s = ±1 in which it counts,

    d = s g (r - z) / cos θ,        u(d)/d from θ: tan θ · u(θ).

A hum of the mains that the quiet beginning shows beyond doubt is taken out of the whole record: a
body at rest does not swing, so it is the sensor's.

Noise and rounding differ from sample to sample (``u_displacement``); inclination, gain and zero
are the same for a whole record and are kept apart, because averaging over samples does not reduce
them, while averaging over sensors or mounts does.
"""

import json
import math
from dataclasses import replace
from datetime import date
from typing import cast

import numpy as np
import xarray as xr

from calibration import _quiet
from calibration._time_base import corrected, time_base
from calibration.record import LaserRecord, LaserValues, Record, require
from labpipe.arrays import Floats
from labpipe.errors import CalibrationError, InputError
from labpipe.uncertainty import Source, budget_rows, combined_uncertainty
from labpipe.units import Quantity
from labpipe.variables import variable, with_u

__all__ = ["displacement", "inclination_from_drop"]

_VALID = 0  # the state of a reading that is one
_KEPT = ("source", "start", "sampling_interval", "averaging", "header", "layout", "work")
_TOLERANCE = 3.0  # standard uncertainties by which a travel may exceed the height it fell


def displacement(
    readings: xr.Dataset,
    record: Record,
    *,
    output: str = "out1",
    zero: _quiet.Zero | None = None,
    direction: int = 1,
    inclination: Quantity | None = None,
    averaging: int | None = None,
    measured: str | date | None = None,
) -> xr.Dataset:
    """Calibrate the readings of a laser displacement sensor.

    Parameters
    ----------
    readings : Dataset (time,)
        As :func:`instruments.read` returns: ``out1`` [m or V], ``status1``, attributes.
    record : Record
        Of the kind ``laser``.
    output : str
        Which output to use.
    zero : (float, float) or Quantity or float, optional
        A quiet window in s, or the reading [SI] that is zero; by default the quiet beginning. Of readings
        in volts a length is the one that the sensor displays.
    direction : {1, -1}
        1 when the reading grows with the displacement that is wanted positive.
    inclination : Quantity [rad], optional
        Instead of the record's, for example from :func:`inclination_from_drop`.
    averaging : int, optional
        Samples of the moving average, where the file does not say it.
    measured : date or ISO text, optional
        Day of the measurement, where the file does not say it.

    Returns
    -------
    Dataset (time,)
        ``displacement`` [m] with its random ``u_displacement``, ``displacement_raw`` [m]
        (zeroed and in the same direction, but along the line of sight and with the sensor's own
        gain), ``valid``; scalars ``inclination`` [rad], ``gain`` [1], ``zero`` [SI of the
        reading], each with ``u_``. Attributes ``budget`` (JSON rows, for the largest
        displacement), ``u_inclination_relative``, ``u_systematic_relative``, ``time_base``,
        ``calibration``, and ``hum`` (:meth:`labpipe.signals.Hum.to_text`, in m of ``displacement``)
        where one was taken out. ``time`` is free of the delay of the moving average.

    Raises
    ------
    CalibrationError
        The record does not belong to the readings, a voltage has no scale, or there is no zero.
    InputError
        The output or the direction does not exist, or the zero is in another unit.

    Examples
    --------
    >>> moved = displacement(readings, load_record("laser.toml"))  # doctest: +SKIP
    """
    if direction not in (1, -1):
        raise InputError(f"direction must be 1 or -1, found {direction}")
    checked = require(record, "laser", readings.attrs, measured=measured)
    values = cast("LaserRecord", record).values
    raw, stated_step, gain = _raw(readings, output, values)
    angle = inclination or values.inclination
    base = time_base(readings.attrs, values.time_base, averaging)
    unit_of_reading = str(readings[output].attrs["units"])
    is_valid = np.isfinite(raw)
    if (state := output.replace("out", "status")) in readings:
        is_valid &= readings[state].values == _VALID
    if values.measuring_range is not None:
        to_length = gain.value if unit_of_reading == "V" else 1.0
        is_valid &= np.abs(np.nan_to_num(raw)) * to_length <= values.measuring_range.value
    used = np.where(is_valid, raw, np.nan)
    step = _quiet.resolution_of(used, stated_step)
    time = readings["time"].values
    start = "start" if zero is None else _as_read(zero, unit_of_reading, values)
    at_rest = _quiet.of_zero(time, used, start, resolution=step, correlated=base.averaging)
    factor = direction * gain.value / math.cos(angle.value)
    moved = factor * (used - at_rest.level - (0.0 if at_rest.hum is None else at_rest.hum.at(time)))
    spread = abs(factor) * at_rest.noise
    largest, u_inclination = _quiet.largest(moved), math.tan(angle.value) * angle.u
    sources = [
        *at_rest.sources("zero", "rounding of the display", step, unit_of_reading, factor),
        Source.of("inclination", angle, largest * math.tan(angle.value)),
        Source.of("gain", gain, largest / gain.value),
    ]
    if values.linearity is not None:
        along_sight = 1.0 / math.cos(angle.value)
        sources.append(Source("linearity", 0.0, values.linearity.u, "m", along_sight, "systematic"))
    # Volts become a length along the line of sight; a length is left as the sensor displayed it.
    to_length = values.volt_scale.value if unit_of_reading == "V" and values.volt_scale else 1.0
    along = direction * (raw - at_rest.level) * to_length
    window = None if at_rest.n == 0 else {"start": at_rest.start, "stop": at_rest.stop}
    found = {
        **{key: readings.attrs[key] for key in _KEPT if key in readings.attrs},
        "output": output,
        "direction": direction,
        "noise": at_rest.noise,
        "resolution": step,
        "zero_window": json.dumps(window),
        "u_inclination_relative": u_inclination,
        "u_systematic_relative": math.hypot(u_inclination, gain.u / gain.value),
        "u_largest": combined_uncertainty(sources),
        "budget": json.dumps(budget_rows(sources)),
        "time_base": json.dumps(base._asdict()),
        "calibration": json.dumps(checked, ensure_ascii=False),
    }
    delayed = corrected(time, base, float(readings.attrs["sampling_interval"]))
    if at_rest.hum is not None:
        hum = at_rest.hum.scaled(factor)
        found["hum"] = replace(hum, epoch=hum.epoch + float(delayed[0] - time[0])).to_text()
    return xr.Dataset(
        {
            "displacement": variable("time", moved, "m", "displacement along the motion"),
            "u_displacement": variable("time", np.where(is_valid, spread, np.nan), "m", "random standard uncertainty"),
            "displacement_raw": variable("time", along, "m", "displacement along the line of sight"),
            "valid": variable("time", is_valid, "1", "whether there is a reading"),
            **with_u("inclination", (), *angle, "angle of the line of sight to the motion"),
            **with_u("gain", (), *gain, "true over displayed, along the line of sight"),
            **with_u("zero", (), at_rest.level, at_rest.u_level, unit_of_reading, "reading that is zero"),
        },
        coords={"time": variable("time", delayed, "s", "time from the first point, filter delay removed")},
        attrs=found,
    )


def _raw(readings: xr.Dataset, output: str, values: LaserValues) -> tuple[Floats, float | None, Quantity]:
    """Return the readings, the step of their display, and the gain to a length."""
    if output not in readings:
        outputs = ", ".join(name for name in map(str, readings) if name.startswith("out"))
        raise InputError(f'the readings have no output "{output}"; they have {outputs}')
    unit_text = readings[output].attrs.get("units")
    step = readings[output].attrs.get("resolution")
    raw = np.asarray(readings[output].values, dtype=float)
    if unit_text == "m":
        return raw, step, values.scale
    if unit_text == "V" and values.volt_scale is not None:
        a, b = values.scale, values.volt_scale
        return raw, step, Quantity(a.value * b.value, math.hypot(a.u * b.value, b.u * a.value), b.si)
    if unit_text == "V":
        raise CalibrationError(f'{output} is in volts; the record needs volt_scale = "0.5 ± 0.0005 mm/V"')
    raise CalibrationError(f"{output} is in {unit_text}; a displacement needs m or V")


def _as_read(zero: _quiet.Zero, unit_of_reading: str, values: LaserValues) -> _quiet.Zero:
    """Return a zero in the unit of the readings: a displayed length as its voltage."""
    if not isinstance(zero, Quantity) or zero.si == unit_of_reading:
        return zero
    if (zero.si, unit_of_reading) == ("m", "V") and values.volt_scale is not None:
        return Quantity(zero.value / values.volt_scale.value, zero.u / values.volt_scale.value, "V")
    raise InputError(f"the zero is in {zero.si}, the readings are in {unit_of_reading}")


def inclination_from_drop(travel: Quantity, height: Quantity) -> Quantity:
    """Find the inclination [rad] from a drop of known height, ``arccos(travel / height)``.

    Parameters
    ----------
    travel : Quantity [m]
        Reading from release to first contact, along the line of sight, gain corrected.
    height : Quantity [m]
        The height, from a micrometer.

    Raises
    ------
    CalibrationError
        The travel is longer than the height by more than both are uncertain: the height, the
        gain or the contact is wrong.
    InputError
        One of them is not a positive length.

    Notes
    -----
    At small angles the cosine is flat and says little: the uncertainty is then that of the
    cosine, converted without the derivative, ``sqrt(2 u)``.

    Examples
    --------
    >>> angle = inclination_from_drop(Quantity(6.847e-3, 1e-6, "m"), Quantity(7e-3, 2e-6, "m"))
    >>> round(math.degrees(angle.value), 2), round(math.degrees(angle.u), 2)
    (12.0, 0.09)
    """
    if travel.si != "m" or height.si != "m" or travel.value <= 0 or height.value <= 0:
        raise InputError(f"expected two positive lengths, found {travel} and {height}")
    cosine = travel.value / height.value
    u_cosine = math.hypot(travel.u / height.value, cosine * height.u / height.value)
    if cosine > 1.0 + _TOLERANCE * u_cosine:
        raise CalibrationError(
            f"the travel {travel.value:.6g} m is longer than the height {height.value:.6g} m, by "
            f"more than {_TOLERANCE:g} standard uncertainties; check height, gain and contact"
        )
    angle = math.acos(min(cosine, 1.0))
    flat = math.sqrt(2.0 * u_cosine)
    u_angle = min(u_cosine / math.sin(angle), flat) if angle > 0 else flat
    return Quantity(angle, u_angle, "rad")

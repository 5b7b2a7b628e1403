"""Extreme readings for the calibrations: laser, load cell, camera, time base.

Readings are made from the true quantity through the sensor's law; the calibration has to give it
back within its own uncertainty, in any layout of memory, with gaps, far from zero, or refuse.
"""

import math
from collections.abc import Mapping
from datetime import date
from typing import Any

import numpy as np
import xarray as xr

import calibration
from calibration._time_base import corrected, filter_delay, time_base
from calibration.camera import pixel_size
from calibration.record import LaserRecord, LaserValues, LoadCellRecord, LoadCellValues
from labpipe.arrays import Floats
from labpipe.units import Quantity
from tests.extremes.inputs import Random, laid_out, with_gaps
from tests.extremes.outcome import Case, Outcome, silently, worst

_DAY = date(2024, 5, 14)
#: Samples at rest before the motion, all of them evidence of the zero.
_REST = 120


def _record(kind: str, values: Any) -> Any:
    made = {"laser": LaserRecord, "load_cell": LoadCellRecord}[kind]
    return made(
        version=1,
        kind=kind,
        id="r",
        instrument="",
        serial="",
        valid_from=_DAY,
        valid_until=_DAY,
        who="a",
        when=_DAY,
        how="b",
        values=values,
    )


def _motion(random: Random) -> Floats:
    """Rest, then something that moves by about one."""
    count = int(random.integers(30, 200))
    return np.concatenate([np.zeros(_REST), np.cumsum(random.standard_normal(count)) / 10.0])


def laser(random: Random) -> Outcome:
    """Any angle, gain, unit, zero and sign: the motion comes back, NaN where nothing was read."""
    truth = _motion(random) * 10 ** random.uniform(-6, -1)
    size = float(np.ptp(truth))
    angle, gain = random.uniform(0.0, 1.3), random.uniform(0.6, 1.9)
    is_volt = bool(random.random() < 0.3)
    per_volt = 10 ** random.uniform(-4, 0) if is_volt else 1.0
    values = LaserValues(
        inclination=Quantity(angle, 1e-4, "rad"),
        scale=Quantity(gain, 1e-4, "1"),
        volt_scale=Quantity(per_volt, 1e-5 * per_volt, "m/V") if is_volt else None,
    )
    direction = int(random.choice([1, -1]))
    noise = size * float(random.choice([0.0, 10 ** random.uniform(-6, -2)]))
    zero = size * float(random.choice([0.0, 1.0, -1e4]))
    seen = zero + noise * random.standard_normal(truth.size)
    seen += direction * truth * math.cos(angle) / gain
    out = with_gaps(random, laid_out(random, seen / per_volt))
    interval = 10 ** random.uniform(-6, 0)
    known = np.isfinite(out)
    time = interval * np.arange(out.size)
    readings = xr.Dataset(
        {"out1": ("time", out, {"units": "V" if is_volt else "m"})},
        {"time": time},
        attrs={"sampling_interval": interval, "averaging": int(random.integers(1, 5))},
    )
    with silently():
        found = calibration.apply(readings, _record("laser", values), direction=direction, ignore_validity=True)
    late = (readings.attrs["averaging"] - 1) / 2 * interval
    error = np.abs(found["displacement"].values - truth)[known]
    factor = gain / math.cos(angle)
    u_zero = factor * float(found["u_zero"]) * per_volt
    allowed = 8.0 * (factor * noise + u_zero) + 1e-11 * factor * (abs(zero) + size)
    return worst(
        (float(error.max()) / allowed, "a displacement by 8 u"),
        (
            0.0 if np.array_equal(np.isfinite(found["displacement"].values), known) else np.inf,
            "a reading that was none, or lost",
        ),
        (float(np.abs(found["time"].values - time + late).max()) / (1e-9 * time[-1]), "a time by 1e-9"),
    )


def load_cell(random: Random) -> Outcome:
    """Any scale, tare and sign of the cell: compression comes back positive."""
    truth = _motion(random) * 10 ** random.uniform(-6, 4)
    size = float(np.ptp(truth))
    gain, sign = random.uniform(0.6, 1.9), int(random.choice([1, -1]))
    noise = size * float(random.choice([0.0, 10 ** random.uniform(-6, -2)]))
    tare = size * float(random.choice([0.0, -2.0, 1e4]))
    seen = tare + sign * truth / gain + noise * random.standard_normal(truth.size)
    shown = with_gaps(random, laid_out(random, seen))
    known = np.isfinite(shown)
    readings = xr.Dataset(
        {"force_z": ("time", shown, {"units": "N"})},
        {"time": 0.01 * np.arange(shown.size)},
        attrs={"compression_sign": sign},
    )
    record = _record("load_cell", LoadCellValues(scale=Quantity(gain, 1e-3, "1")))
    zero = "start" if random.random() < 0.7 else tare
    with silently():
        found = calibration.apply(readings, record, zero=zero, ignore_validity=True)
    error = np.abs(found["force"].values - truth)[known]
    allowed = 8.0 * gain * (noise + float(found["u_tare"])) + 1e-11 * (abs(tare) + size)
    return worst(
        (float(error.max()) / allowed, "a force by 8 u"),
        (0.0 if np.array_equal(found["valid"].values, known) else np.inf, "an unread force"),
    )


def camera_and_clock(random: Random) -> Outcome:
    """Scale of a view with its relative uncertainties, and the delay of a moving average."""
    length, pixels = 10 ** random.uniform(-9, 3), 10 ** random.uniform(-3, 6)
    u_length, u_pixels = random.uniform(0.0, 0.2, 2) * (length, pixels)
    size = pixel_size(Quantity(length, u_length, "m"), Quantity(pixels, u_pixels, "px"))
    relative = math.sqrt((u_length / length) ** 2 + (u_pixels / pixels) ** 2)
    interval, averaging = 10 ** random.uniform(-9, 3), int(random.integers(1, 5000))
    deviation = random.uniform(-1e-3, 1e-3)
    attrs = {"sampling_interval": interval, "averaging": averaging}
    base = time_base(attrs, Quantity(deviation, 1e-5, "1"))
    time = float(interval) * np.arange(50, dtype=float)
    exact = (time - 0.5 * (averaging - 1) * interval) * (1.0 + deviation)
    late = np.abs(corrected(laid_out(random, time), base, interval) - exact).max()
    return worst(
        (abs(size.value * pixels / length - 1.0) / 1e-12, "a scale by 1e-12"),
        (abs(size.u / size.value - relative) / 1e-12, "its uncertainty by 1e-12"),
        (float(late) / (1e-12 * interval * (50 + averaging)), "a time by 1e-12"),
    )


def calibration_that_is_none(random: Random) -> Outcome:
    """Refuse records, zeros and readings that cannot be."""
    fault = str(
        random.choice(
            [
                "no zero",
                "moving",
                "unit",
                "volts",
                "direction",
                "output",
                "interval",
                "sign",
                "length",
                "cycle",
                "averaging",
            ]
        )
    )
    bad = float(random.choice([np.nan, -1.0, 0.0, -np.inf]))
    out = np.zeros(200) + 1e-7 * random.standard_normal(200)
    attrs: dict[str, Any] = {"sampling_interval": 1e-3}
    options: dict[str, Any] = {"ignore_validity": True}
    units = {"unit": "N", "volts": "V"}.get(fault, "m")
    if fault == "no zero":
        out[:] = np.nan
    elif fault == "moving":
        out += np.linspace(0.0, 1.0, 200)
    elif fault == "direction":
        options["direction"] = int(random.choice([0, 2, -3]))
    elif fault == "output":
        options["output"] = "out7"
    elif fault == "interval":
        attrs = {} if random.random() < 0.3 else {"sampling_interval": bad}
    elif fault == "averaging":
        attrs["averaging"] = int(random.choice([0, -4]))
    elif fault == "length":
        pixel_size(Quantity(bad, 0.0, "m"), Quantity(10.0, 0.0, "px"))
    elif fault == "cycle":
        filter_delay(3, bad)
    readings = xr.Dataset(
        {"out1": ("time", out, {"units": units}), "force_z": ("time", out, {"units": "N"})},
        {"time": 1e-3 * np.arange(200)},
        attrs=attrs,
    )
    with silently():
        if fault == "sign":
            cell = LoadCellValues(scale=Quantity(1.0, 1e-3, "1"))
            calibration.apply(readings, _record("load_cell", cell), **options)
        else:
            sensor = LaserValues(inclination=Quantity(0.2, 1e-4, "rad"))
            calibration.apply(readings, _record("laser", sensor), **options)
    return Outcome(np.inf, f"took {fault} = {bad}")


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {
    "laser": (laser, 250),
    "load cell": (load_cell, 200),
    "camera and clock": (camera_and_clock, 400),
    "invalid calibration": (calibration_that_is_none, 300),
}

"""Velocity from a laser's displacement: error against run time of the methods.

Data: a sphere bouncing in the virtual rig, so that the true velocity is known at every sample.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import make_smoothing_spline
from scipy.signal import savgol_filter

from labpipe import materials, signals
from labpipe.arrays import Floats
from pipelines.bench.measure import THESIS, Extra, Suite, race
from pipelines.rig.apparatus import SPHERE
from pipelines.rig.drops import DropRig, LaserSensor, drop_once


@dataclass(frozen=True, slots=True)
class Record:
    """One record: the readings and their truth.

    ``displacement`` (time,) [m]; ``velocity`` (time,) [m/s] at the samples; ``events`` [s]: touches and lift-offs.
    """

    displacement: xr.DataArray
    velocity: Floats
    events: Floats


def record(material: str, duration: float) -> Record:
    """Drop a sphere of the library from the lowest height in the virtual rig; record ``duration`` s at 20 kHz."""
    # a sensor that looks straight down: its scale is no matter of the derivative
    rig = DropRig(duration=duration, sensor=LaserSensor(inclination=0.0))
    drop = drop_once(rig, materials.load(material), SPHERE.heights[0], 5)
    time = np.arange(len(drop.readings)) * rig.sensor.cycle
    since, motion = time - drop.release, drop.trajectory
    half = 1e-6  # s of the central difference, far below a sample
    velocity = (motion.at(np.asarray(since + half)) - motion.at(np.asarray(since - half))) / (2.0 * half)
    readings = xr.DataArray(drop.readings, {"time": time}, ["time"], attrs={"units": "m"})
    return Record(readings, np.asarray(velocity), drop.release + np.sort([*motion.touch, *motion.liftoff]))


def run(quick: bool, beside: float = 1e-3) -> list[Suite]:
    """Measure every method on one bouncing record (acrylic, 1.5 mm, 20 kHz, 1 µm noise).

    So many s beside a touch or lift-off count as contact.
    """
    made = record("acrylic", 0.2 if quick else 0.5)
    displacement, samples = made.displacement, made.velocity.size
    cycle = float(displacement.time[1])
    ours, average = partial(signals.velocity, displacement), partial(signals.velocity, displacement, "thesis")
    calls: dict[str, tuple[str, Callable[[], object]]] = {
        "spline": ("", ours),
        "spline, contacts given": ("", partial(ours, breaks=made.events)),
        "spline, noise given": ("", partial(ours, noise=1e-6)),
        "moving average, default": (THESIS, average),
        "central differences": (THESIS, partial(signals.velocity, displacement, "difference")),
    }
    for window in (7, 15, 31, 61):
        calls[f"moving average, {window} samples"] = THESIS, partial(average, window=window)
        smoothed = partial(savgol_filter, displacement.values, window, 3, deriv=1, delta=cycle)
        calls[f"Savitzky–Golay, cubic, {window} samples"] = "SciPy Savitzky–Golay", smoothed
    if not quick:  # it takes seconds; badly scaled in seconds and metres, so samples and micrometres
        place = np.arange(float(samples))
        calls["cross-validated"] = (
            "SciPy smoothing spline",
            lambda: make_smoothing_spline(place, displacement.values * 1e6)(place, 1) * 1e-6 / cycle,
        )
    near = (np.abs(displacement.time.values[:, None] - made.events) < beside).any(axis=1)

    def judge(_: str, found: Any) -> tuple[float, Extra]:
        error = np.asarray(found, float) - made.velocity
        return _rms(error), {
            "near contacts (m/s)": _rms(error[near]),
            "in flight (m/s)": _rms(error[~near]),
            "largest (m/s)": float(np.nanmax(np.abs(error))),
        }

    points = race(calls, 3 if quick else 9, judge, "spline", budget=20.0)
    title = f"Velocity of a bouncing sphere, {samples} samples at 20 kHz, 1 µm noise, 0.1 µm steps"
    return [Suite("velocity", title, "RMS error (m/s)", points)]


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.nanmean(error**2)))

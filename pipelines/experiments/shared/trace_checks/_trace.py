"""The readings of one record as its checks look at them."""

import json
from dataclasses import dataclass
from functools import cached_property
from math import erf, inf, log, sqrt

import numpy as np
import xarray as xr

from labpipe.report import quantity
from labpipe.signals import quantisation_step

FLAT = 6
"""Equal readings in a row that a moving body does not give."""
IN_NOISE = 8.0  # standard deviations of noise that a jump exceeds
QUIET = 200  # readings at the beginning that should be still
LIMITS = (1e-3, 0.02, 0.2)  # of the travel: drift over the record that is told, doubtful, impossible
_CHANCE = 1e-9  # by which equal readings in a row are told
WRONG_CHANNEL = "the wrong channel or file was recorded, or the sensor did not see the body"


@dataclass(frozen=True)
class Trace:
    """The readings of one record.

    ``name`` is its file, for messages; ``time`` [s] and ``reading`` [m] (time,) are NaN where there is no valid
    reading; ``header`` is the text above the readings in the file; ``outliers`` holds first and last index and the
    largest deviation [m] of each run of readings that was left out.
    """

    name: str
    time: np.ndarray
    reading: np.ndarray
    header: str = ""
    outliers: tuple[tuple[int, int, float], ...] = ()

    @classmethod
    def of(cls, name: str, readings: xr.Dataset, output: str) -> "Trace | None":
        """Take one output; None where it is not there or no length."""
        if output not in readings or readings[output].attrs.get("units") != "m":
            return None
        x = np.array(readings[output].values, float)
        state = output.replace("out", "status")
        if state in readings:
            x[readings[state].values != 0] = np.nan
        left_out = json.loads(readings.attrs.get("outliers", "{}")).get(output, [])
        runs = tuple((int(first), int(last), float(by)) for first, last, by in left_out)
        return cls(name, readings["time"].values, x, str(readings.attrs.get("header", "")), runs)

    @cached_property
    def travel(self) -> float:
        """Range of the readings without their extremes [m]."""
        low, high = np.nanquantile(self.reading, [0.005, 0.995])
        return float(high - low)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a reading, from second differences [m]."""
        bend = np.diff(self.reading, 2)
        bend = bend[np.isfinite(bend)]
        return float(1.4826 * np.median(np.abs(bend)) / np.sqrt(6.0)) if bend.size else 0.0

    @cached_property
    def resolution(self) -> float:
        """Smallest difference between two readings [m]."""
        x = self.reading[np.isfinite(self.reading)]
        if not x.size:
            return 0.0
        return float(quantisation_step(x)) if np.ptp(x) > 0.0 else 0.0

    def at(self, index: int) -> str:
        """Write the time of a reading."""
        return quantity(float(self.time[index]), "s")


def longest_by_chance(noise: float, step: float, count: int) -> float:
    """Return how many of `count` readings stay on one step by chance; infinite where noise does not reach the step.

    Of white noise a reading lies on one step with erf(step/(2 sqrt(2) noise)) at most.
    """
    stays = erf(step / (sqrt(8.0) * noise)) if noise > 0.0 else 1.0
    return log(_CHANCE / count) / log(stays) if 0.0 < stays < 1.0 else inf


def longest_run(flags: np.ndarray) -> tuple[int, int]:
    """Return length and start of the longest run of true values."""
    if not flags.any():
        return 0, 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    starts, ends = edges[::2], edges[1::2]
    best = int(np.argmax(ends - starts))
    return int(ends[best] - starts[best]), int(starts[best])

"""Extreme records: derivatives, oscillations, repeats, and measures of agreement.

Truth is a formula. Records come unevenly sampled, far from zero, in single precision, reversed or
strided in memory, read-only, with bursts of missing samples; a fault in them must be refused.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from tests.extremes.inputs import Random, laid_out, with_gaps
from tests.extremes.outcome import Case, Outcome, silently, worst

#: Readings from which a record knows its own noise well.
_MANY = 30
_EPS32, _EPS64 = float(np.finfo(np.float32).eps), float(np.finfo(float).eps)


def record_of(time: Floats, values: Floats, units: str = "m") -> xr.DataArray:
    """Label a record."""
    return xr.DataArray(values, {"time": time}, ["time"], name="displacement", attrs={"units": units})


def uneven_times(random: Random, count: int, spread: float = 1.0) -> Floats:
    """Draw increasing times from any beginning, steps of 1e-9 to 1e3 s within one spread."""
    step = 10 ** random.uniform(-9, 3)
    steps = step * 10 ** random.uniform(-0.5 * spread, 0.5 * spread, count)
    if random.random() < 0.5:
        steps[:] = step
    begin = step * float(random.choice([0.0, -count, 1e4]))
    return np.asarray(begin + np.cumsum(steps))


def velocity_of_a_polynomial(random: Random) -> Outcome:
    """Up to cubic motion with noise: the velocity is right within its own uncertainty."""
    count = int(random.integers(12, 200))
    time = uneven_times(random, count)
    span = float(time[-1] - time[0])
    s = (time - time[0]) / span
    size = 10 ** random.uniform(-9, 3)
    factors = size * random.uniform(-1.0, 1.0, 4)
    truth = np.polynomial.polynomial.polyval(s, np.polynomial.polynomial.polyder(factors)) / span
    offset = size * float(random.choice([0.0, 1.0, 1e4, 1e9]))
    noise = size * float(random.choice([0.0, 10 ** random.uniform(-6, -1)]))
    moved = np.polynomial.polynomial.polyval(s, factors)
    readings = moved + offset + noise * random.standard_normal(count)
    is_single = random.random() < 0.3
    readings = with_gaps(random, laid_out(random, readings, is_single=is_single))
    found = _velocity(record_of(laid_out(random, time), readings))
    known = np.isfinite(readings)
    rounding = (_EPS32 if is_single else _EPS64) * (offset + size)
    # As documented: of a curve without noise the spline smooths up to 3e-4 of the largest velocity.
    u = found.u_velocity.values[known]
    if found.attrs["method"] == "difference" and np.isnan(u).all():
        return Outcome(0.0, "", "too few readings to know the noise, which is said")
    u = np.hypot(u, np.hypot(8.0 * rounding / span, 6e-5 * np.abs(truth).max()))
    pull = np.abs(found.values - truth)[known] / u
    # Four to twenty differences tell the noise, and with it the uncertainty, to a factor of three.
    allowed = 5.0 if count >= _MANY else 12.0
    return worst(
        (float(np.sqrt(np.mean(pull**2))) / allowed, "velocity off by 5 u rms, or 12 of few"),
        (0.0 if np.array_equal(np.isfinite(found.values), known) else np.inf, "a sample was lost"),
    )


def _velocity(record: xr.DataArray, **options: Any) -> xr.DataArray:
    with silently():
        return signals.velocity(record, **options)


def _wave_times(random: Random, cycles: float) -> tuple[Floats, float]:
    """Return times of some cycles at 8 to 40 readings per cycle, and the frequency."""
    frequency = 10 ** random.uniform(-4, 6)
    per_cycle = random.uniform(8.0, 40.0)
    count = int(cycles * per_cycle)
    time = np.arange(count) / (per_cycle * frequency)
    return time + time[-1] * float(random.choice([0.0, -3.0, 100.0])), frequency


def sinusoid(random: Random) -> Outcome:
    """Frequency, amplitude and phase of a wave of any size, with noise, drift and offset."""
    time, frequency = _wave_times(random, random.uniform(4.0, 20.0))
    amplitude, phase = 10 ** random.uniform(-9, 6), random.uniform(-np.pi, np.pi)
    share = float(random.choice([0.0, 10 ** random.uniform(-6, -0.7)]))
    offset = amplitude * float(random.choice([0.0, -3.0, 1e4]))
    angle = 2 * np.pi * frequency * time
    values = offset + amplitude * np.sin(angle + phase)
    values += share * amplitude * random.standard_normal(time.size)
    values = with_gaps(random, laid_out(random, values))
    found = signals.fit_sinusoid(time, values, frequency if random.random() < 0.5 else None)
    # rounding of offset and of time, which stands for a phase
    late = _EPS64 * float(np.abs(angle).max())
    floor = 20.0 * (_EPS64 * (1.0 + abs(offset) / amplitude) + late) + 1e-8
    middle = phase + 2 * np.pi * frequency * found.reference_time
    turned = math.remainder(found.phase - middle, 2 * math.pi)
    span = float(time[-1] - time[0])
    return worst(
        (
            abs(found.amplitude / amplitude - 1.0) / (7.0 * found.u_amplitude / amplitude + floor),
            "an amplitude by 7 uncertainties",
        ),
        (abs(turned) / (7.0 * found.u_phase + floor), "a phase by 7 uncertainties"),
        (
            abs(found.frequency - frequency) * span / (7.0 * found.u_frequency * span + floor),
            "a frequency by 7 uncertainties",
        ),
    )


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {
    "velocity of a polynomial": (velocity_of_a_polynomial, 40),
    "sinusoid": (sinusoid, 150),
}

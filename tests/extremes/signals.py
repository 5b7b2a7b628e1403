"""Extreme records: derivatives, oscillations, repeats, and measures of agreement.

Truth is a formula. Records come unevenly sampled, far from zero, in single precision, reversed or
strided in memory, read-only, with bursts of missing samples; a fault in them must be refused.
"""

import math
from collections.abc import Callable, Mapping
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


# -- velocity --------------------------------------------------------------------------------------


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


def velocity_scaled(random: Random) -> Outcome:
    """Another unit, zero, beginning or direction of time changes the velocity as it must."""
    count = int(random.integers(2, 60))
    time = np.arange(count, dtype=float) * float(10 ** random.uniform(-6, 3))
    values = np.cumsum(random.standard_normal(count))
    method = str(random.choice(["spline", "thesis", "difference"]))
    window = int(random.integers(1, count + 1))
    plain = _velocity(record_of(time, values), method=method, window=window).values
    # powers of two, so that the scaled record holds the same numbers to the last digit
    length, duration = 2.0 ** random.integers(-30, 30), 2.0 ** random.integers(-20, 20)
    other = _velocity(record_of(time * duration, -values * length), method=method, window=window)
    change = float(np.abs(other.values * duration / length + plain).max() / np.abs(plain).max())
    return Outcome(change / 1e-9, f"{method}: scaled record, other velocity 1e-9")


def velocity_of_rest(random: Random) -> Outcome:
    """Expect no velocity of a constant record, wherever its zero is."""
    count = int(random.integers(2, 100))
    time = uneven_times(random, count, 2.0)
    level = float(random.choice([0.0, -1.0, 1.0])) * 10 ** random.uniform(-9, 9)
    values = laid_out(random, np.full(count, level), is_single=random.random() < 0.3)
    method = str(random.choice(["spline", "thesis", "difference"]))
    found = _velocity(record_of(time, with_gaps(random, values)), method=method, window=1)
    largest = float(np.nanmax(np.abs(found.values))) * float(np.diff(time).min())
    return Outcome(largest / (4.0 * _EPS64 * abs(level) + 1e-300), "a constant that moves")


# -- records with a fault --------------------------------------------------------------------------

_FAULTS = ("repeated", "backward", "no time", "endless time", "infinite", "nothing", "one", "unit")


def _faulty(random: Random) -> tuple[xr.DataArray, str]:
    count = int(random.integers(20, 60))
    time, place = np.sort(random.random(count)), int(random.integers(1, count))
    values = np.sin(9.0 * time)
    fault = str(random.choice(_FAULTS))
    if fault == "repeated":
        time[place] = time[place - 1]
    elif fault == "backward":
        time[[place - 1, place]] = time[[place, place - 1]]
    elif fault == "no time":
        time[place] = np.nan
    elif fault == "endless time":
        time[-1] = np.inf
    elif fault == "infinite":
        values[place] = random.choice([np.inf, -np.inf])
    elif fault == "nothing":
        values[:] = np.nan
    elif fault == "one":
        values[1:] = np.nan
    return record_of(time, values, "mm" if fault == "unit" else "m"), fault


def record_that_is_none(random: Random) -> Outcome:
    """Expect everything that takes a record to refuse one with a fault."""
    record, fault = _faulty(random)
    time, values = record["time"].values, record.values
    whole = record_of(np.linspace(0.0, 1.0, 50), np.sin(9.0 * np.linspace(0.0, 1.0, 50)))
    calls: dict[str, Callable[[], object]] = {
        "velocity": lambda: _velocity(record),
        "difference": lambda: _velocity(record, method="difference"),
        "bounces": lambda: signals.bounces(record),
        "fit_sinusoid": lambda: signals.fit_sinusoid(time, values, 1.4),
        "damped_oscillation": lambda: signals.damped_oscillation(time, values),
        "repeats": lambda: signals.combine_repeats([whole, record], [0.0, 0.0]),
        "at_times": lambda: signals.interpolated_at(record, np.linspace(0.2, 0.8, 9)),
    }
    name = str(random.choice(list(calls)))
    if fault == "unit" and name in ("fit_sinusoid", "damped_oscillation", "at_times"):
        return Outcome(0.0, "")  # any quantity will do
    if fault in ("nothing", "one") and name in ("repeats", "at_times"):
        return Outcome(0.0, "")  # what was not read stays NaN
    calls[name]()
    return Outcome(np.inf, f"{name} took a record with the fault: {fault}")


# -- oscillations ----------------------------------------------------------------------------------


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


def stiffness_and_lag(random: Random) -> Outcome:
    """Complex stiffness of any size and any loss from position and force."""
    time, frequency = _wave_times(random, random.uniform(4.0, 15.0))
    stiffness, lag = 10 ** random.uniform(-3, 9), random.uniform(-0.1, 1.5)
    size = 10 ** random.uniform(-9, -2)
    share = float(random.choice([0.0, 10 ** random.uniform(-6, -1.5)]))
    angle = 2 * np.pi * frequency * (time - time[0])
    noise = share * random.standard_normal((2, time.size))
    position = size * (np.sin(angle) + noise[0])
    force = size * stiffness * (np.sin(angle + lag) + noise[1] + random.uniform(-9.0, 9.0))
    found = signals.common_fit(time, laid_out(random, position), with_gaps(random, force))
    floor = 1e-8 + 20.0 * _EPS64 * float(np.abs(2 * np.pi * frequency * time).max())
    storage, loss = stiffness * math.cos(lag), stiffness * math.sin(lag)
    return worst(
        (abs(found.phase_lag - lag) / (7.0 * found.u_phase_lag + floor), "a lag by 7 u"),
        (
            abs(found.storage_stiffness - storage) / (7.0 * found.u_storage_stiffness + floor * stiffness),
            "storage by 7 u",
        ),
        (abs(found.loss_stiffness - loss) / (7.0 * found.u_loss_stiffness + floor * stiffness), "loss by 7 u"),
    )


def decay(random: Random) -> Outcome:
    """Frequency and damping of a decaying vibration of any size about any rest."""
    cycles = random.uniform(5.0, 25.0)
    time, frequency = _wave_times(random, cycles)
    ratio = 10 ** random.uniform(-3.5, -0.9)
    amplitude = 10 ** random.uniform(-9, 3)
    share = float(random.choice([0.0, 10 ** random.uniform(-5, -2)]))
    s = time - time[0]
    rate = 2 * np.pi * frequency * ratio / math.sqrt(1.0 - ratio**2)
    values = amplitude * np.exp(-rate * s) * np.sin(2 * np.pi * frequency * s + 1.0)
    values += amplitude * float(random.choice([0.0, 5.0, -1e3]))
    values += share * amplitude * random.standard_normal(time.size)
    found = signals.damped_oscillation(laid_out(random, time), with_gaps(random, values))
    return worst(
        (
            abs(found.frequency / frequency - 1.0) / (8.0 * found.u_frequency / frequency + 1e-6),
            "a frequency by 8 uncertainties",
        ),
        (abs(found.damping_ratio - ratio) / (8.0 * found.u_damping_ratio + 1e-6), "a damping by 8 uncertainties"),
    )


# -- several records -------------------------------------------------------------------------------


def repeats(random: Random) -> Outcome:
    """Expect a line as the mean of lines, and counts and bands of what was read."""
    n, count = int(random.integers(1, 7)), int(random.integers(2, 60))
    step = 10 ** random.uniform(-9, 3)
    slope, level = random.standard_normal(2) * 10 ** random.uniform(-6, 9)
    starts, lines, records = step * random.integers(0, 50, n), random.standard_normal(n), []
    for start, line in zip(starts, lines, strict=True):
        time = start + step * np.arange(count)
        values = level + line + slope * np.arange(count)
        records.append(record_of(time, laid_out(random, values)))
    found = signals.combine_repeats(records, starts)
    expected = level + float(np.mean(lines)) + slope * np.arange(count)
    size = abs(level) + abs(slope) * count + 10.0
    spread = float(np.std(lines, ddof=1)) if n > 1 else np.nan
    sd = found["displacement_sd"].values
    if found.sizes["time"] != count:
        return Outcome(np.inf, f"{count} samples became {found.sizes['time']}")
    # a start of up to 50 steps has the rounding of so many times
    mean_error = float(np.abs(found["displacement_mean"].values - expected).max())
    sd_error = float(np.abs(sd - spread).max()) if n > 1 else float(np.isfinite(sd).any())
    return worst(
        (mean_error / (1e-9 * size), "a mean by 1e-9"),
        (sd_error / (1e-9 * size), "a band by 1e-9"),
        (float(np.abs(found["n"].values - n).max()), "a repeat was lost"),
    )


def agreement_of_two(random: Random) -> Outcome:
    """Bias and error against their definitions in exact sums, far from zero too."""
    count = int(random.integers(3, 200))
    offset, size = float(random.choice([0.0, 1e9])), 10 ** random.uniform(-3, 6)
    a, b = random.standard_normal((2, count)) * size + offset
    a, b = with_gaps(random, laid_out(random, a)), laid_out(random, b)
    both = np.isfinite(a) & np.isfinite(b)
    d = a[both] - b[both]
    if d.size < 3:
        signals.agreement(a, b)
        return Outcome(np.inf, "limits of agreement from fewer than three pairs")
    bias = math.fsum(d) / d.size
    rms = math.sqrt(math.fsum(d * d) / d.size)
    found = signals.agreement(a, b)
    floor = 1e-9 + 10.0 * _EPS64 * offset / size
    extent = float(np.ptp(b[both]))
    return worst(
        (abs(found.bias - bias) / (floor * size), "a bias by 1e-9"),
        (abs(signals.nrmse(a, b) - rms / extent) / floor, "a normalised error by 1e-9"),
        (0.0 if 1.0 <= found.n_effective <= 2.0 * d.size else np.inf, "impossibly many samples"),
    )


def figures_of_nothing(random: Random) -> Outcome:
    """Curves that cannot be compared are refused."""
    count = int(random.integers(3, 20))
    a, b = random.standard_normal((2, count))
    calls: Mapping[str, Callable[[Floats, Floats], object]] = {"nrmse": signals.nrmse, "agreement": signals.agreement}
    name = str(random.choice(list(calls)))
    fault = str(random.choice(["shape", "infinite", "nothing", "constant"]))
    if fault == "shape":
        b = b[:-1]
    elif fault == "infinite":
        b[int(random.integers(0, count))] = random.choice([np.inf, -np.inf])
    elif fault == "nothing":
        a[1:] = np.nan
    elif name == "agreement":
        return Outcome(0.0, "")  # constant curves agree or do not
    else:
        (b if name == "nrmse" else a)[:] = 10 ** random.uniform(-9, 9)
    calls[name](a, b)
    return Outcome(np.inf, f"{name} took curves with the fault: {fault}")


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {
    "velocity of a polynomial": (velocity_of_a_polynomial, 40),
    "velocity, scaled": (velocity_scaled, 60),
    "velocity of rest": (velocity_of_rest, 150),
    "invalid record": (record_that_is_none, 450),
    "sinusoid": (sinusoid, 150),
    "stiffness and lag": (stiffness_and_lag, 100),
    "decay": (decay, 60),
    "repeats": (repeats, 100),
    "agreement of two": (agreement_of_two, 300),
    "agreement of invalid input": (figures_of_nothing, 200),
}

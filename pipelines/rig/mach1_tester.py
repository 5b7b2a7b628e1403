"""A material tester that presses a periodic punch into rubber and records as a Mach-1 does.

The stage is not perfect: its sinusoid is a little slow and a little large, as measured on real
files. The force passes the cell's causal low-pass filter before it is sampled and sits on an
untared offset; the writer rounds it to the cell's counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

Array = NDArray[np.float64]

RATE = 100.0  # Hz, what the instrument writes
OVERSAMPLING = 10  # the true motion and force are known this much finer than they are written


@dataclass(frozen=True, slots=True)
class Tester:
    """What the tester does to a motion and a force; m, N, Hz, m/s."""

    force_noise: float = 0.01
    force_offset: float = 0.35
    filter_order: int = 3
    filter_cutoff: float = 20.0
    frequency_error: float = -0.004
    amplitude_error: float = 0.015
    second_harmonic: float = 0.004
    ramp_speed: float = 1e-3


def fine_time(duration: float) -> Array:
    """Return the rig's time of a block; the instrument writes whole tenths of a second."""
    total = np.ceil(duration * RATE / 10) * 10 / RATE
    return np.arange(round(total * RATE * OVERSAMPLING)) / (RATE * OVERSAMPLING)


def oscillation(
    tester: Tester, mean: float, amplitude: float, frequency: float, cycles: int, rest: float
) -> tuple[Array, Array, float]:
    """Make one Sinusoid block: fine time, displacement, and the frequency that really ran.

    The stage rests ``rest`` s before and after; its motion starts and ends at the mean.
    """
    # real stages run slower the faster they are asked to go
    real = frequency * (1 + tester.frequency_error * np.sqrt(frequency))
    time = fine_time(cycles / real + 2 * rest)
    phase = 2 * np.pi * real * np.clip(time - rest, 0.0, cycles / real)
    shape = np.sin(phase) + tester.second_harmonic * (1 - np.cos(2 * phase))
    return time, mean + amplitude * (1 + tester.amplitude_error) * shape, real


def ramp(tester: Tester, start: float, end: float, hold: float) -> tuple[Array, Array]:
    """Make one ramp at the stage's speed and the hold after it: fine time and displacement."""
    time = fine_time((end - start) / tester.ramp_speed + hold)
    return time, np.minimum(start + tester.ramp_speed * time, end)


def approach(start: float, end: float, speed: float) -> tuple[Array, Array]:
    """Make a slow approach from above the surface (negative displacement) to slight contact."""
    time = fine_time((end - start) / speed)
    return time, np.minimum(start + speed * time, end)


def record(tester: Tester, force: Array, generator: np.random.Generator) -> Array:
    """Return the compression force in N at the instrument's rate, filtered, noisy, untared."""
    sections = butter(
        tester.filter_order, tester.filter_cutoff, fs=RATE * OVERSAMPLING, output="sos"
    )
    state = sosfilt_zi(sections) * force[0]
    filtered, _ = sosfilt(sections, force, zi=state)
    sampled: Array = filtered[::OVERSAMPLING]
    return sampled + generator.normal(0.0, tester.force_noise, sampled.size) + tester.force_offset

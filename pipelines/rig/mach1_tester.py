"""A material tester that presses a periodic punch into rubber and records as a Mach-1 does.

The stage is not perfect: its sinusoid is a little slow and a little large, as measured on real
files. The force passes the cell's causal low-pass filter before it is sampled and sits on an
untared offset; the writer rounds it to the cell's counts.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfilt, sosfilt_zi

from labpipe.arrays import Floats

RATE = 100.0  # Hz, what the instrument writes
OVERSAMPLING = 10  # the true motion and force are known this much finer than they are written


@dataclass(frozen=True, slots=True)
class Tester:
    """Errors of the tester in motion and force, and how it finds contact; m, N, Hz, m/s, s.

    ``force_gain`` is displayed over true force; ``acceleration`` [m/s²] rounds the corners of a
    ramp, infinite leaves them sharp. The approach begins ``air`` above the surface and stops at an indentation of
    ``touch``; the stage rests for ``settle`` between two blocks.
    """

    force_noise: float = 0.01
    force_offset: float = 0.35
    force_gain: float = 1.0
    filter_order: int = 3
    filter_cutoff: float = 20.0
    frequency_error: float = -0.004
    amplitude_error: float = 0.015
    second_harmonic: float = 0.004
    ramp_speed: float = 1e-3
    acceleration: float = np.inf
    air: float = 0.05e-3
    touch: float = 2e-6
    approach_speed: float = 0.05e-3
    settle: float = 2.0


def fine_time(duration: float) -> Floats:
    """Return the rig's time of a block; the instrument writes whole tenths of a second."""
    total = np.ceil(duration * RATE / 10) * 10 / RATE
    return np.arange(round(total * RATE * OVERSAMPLING)) / (RATE * OVERSAMPLING)


def oscillation(
    tester: Tester, mean: float, amplitude: float, frequency: float, cycles: int, rest: float
) -> tuple[Floats, Floats, float]:
    """Make one Sinusoid block: fine time, displacement, and the frequency that really ran.

    The stage rests ``rest`` s before and after; its motion starts and ends at the mean.
    """
    # real stages run slower the faster they are asked to go
    real = frequency * (1 + tester.frequency_error * np.sqrt(frequency))
    time = fine_time(cycles / real + 2 * rest)
    phase = 2 * np.pi * real * np.clip(time - rest, 0.0, cycles / real)
    shape = np.sin(phase) + tester.second_harmonic * (1 - np.cos(2 * phase))
    return time, mean + amplitude * (1 + tester.amplitude_error) * shape, real


def ramp(tester: Tester, start: float, end: float, hold: float) -> tuple[Floats, Floats]:
    """Make one ramp at the stage's speed and the hold after it: fine time and displacement."""
    way, speed = end - start, tester.ramp_speed
    gain = min(speed / tester.acceleration, np.sqrt(way / tester.acceleration))
    speed = min(speed, tester.acceleration * gain) if gain > 0 else speed
    total = way / speed + gain
    time = fine_time(total + hold)
    since = np.minimum(time, total)
    if gain == 0:
        return time, np.minimum(start + speed * time, end)
    # a trapezium of speed: a parabola, a line, a parabola
    rising = 0.5 * tester.acceleration * np.minimum(since, gain) ** 2
    steady = speed * np.clip(since - gain, 0.0, total - 2 * gain)
    braking = np.clip(since - (total - gain), 0.0, gain)
    return time, start + rising + steady + braking * (speed - 0.5 * tester.acceleration * braking)


def approach(start: float, end: float, speed: float) -> tuple[Floats, Floats]:
    """Make a slow approach from above the surface (negative displacement) to slight contact."""
    time = fine_time((end - start) / speed)
    return time, np.minimum(start + speed * time, end)


def record(tester: Tester, force: Floats, generator: np.random.Generator) -> Floats:
    """Return the compression force in N at the instrument's rate, filtered, noisy, untared."""
    sections = butter(tester.filter_order, tester.filter_cutoff, fs=RATE * OVERSAMPLING, output="sos")
    state = sosfilt_zi(sections) * force[0]
    filtered, _ = sosfilt(sections, force, zi=state)
    sampled: Floats = filtered[::OVERSAMPLING]
    noise = generator.normal(0.0, tester.force_noise, sampled.size)
    return sampled * tester.force_gain + noise + tester.force_offset

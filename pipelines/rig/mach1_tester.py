"""A material tester that presses a periodic punch into rubber and records as a Mach-1 does.

The stage is not perfect: its sinusoid is a little slow and a little large, as measured on real
files. The force passes the cell's causal low-pass filter before it is sampled, sits on an
untared offset, and is rounded to the cell's counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

Array = NDArray[np.float64]

RATE = 100.0  # Hz, what the instrument writes
OVERSAMPLING = 100  # the true force is known this much finer than it is written


@dataclass(frozen=True, slots=True)
class Tester:
    """What the tester does to a motion and a force; m, N, Hz."""

    stage_step: float = 1e-6 * 1e-3
    force_step: float = 0.0125
    force_noise: float = 0.01
    force_offset: float = 0.35
    filter_order: int = 3
    filter_cutoff: float = 20.0
    frequency_error: float = -0.003
    amplitude_error: float = 0.015
    second_harmonic: float = 0.004


def oscillation(
    tester: Tester, mean: float, amplitude: float, frequency: float, cycles: int, rest: float
) -> tuple[Array, Array]:
    """Fine time and stage displacement of one Sinusoid block, rest before and after.

    Returns
    -------
    time, displacement : array (fine,) [s], [m]
    """
    real_frequency = frequency * (1 + tester.frequency_error * np.sqrt(frequency))
    moving = cycles / real_frequency
    # the instrument writes whole tenths of a second
    total = np.ceil((moving + 2 * rest) * RATE / 10) * 10 / RATE
    fine = RATE * OVERSAMPLING
    time = np.arange(round(total * fine)) / fine
    phase = 2 * np.pi * real_frequency * np.clip(time - rest, 0.0, moving)
    shape = np.sin(phase) + tester.second_harmonic * (1 - np.cos(2 * phase))
    return time, mean + amplitude * (1 + tester.amplitude_error) * shape


def record(
    tester: Tester, displacement: Array, force: Array, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Return what is written at the instrument's rate: position in m, compression force in N."""
    fine = RATE * OVERSAMPLING
    sections = butter(tester.filter_order, tester.filter_cutoff, fs=fine, output="sos")
    state = sosfilt_zi(sections) * force[0]
    filtered, _ = sosfilt(sections, force, zi=state)
    sampled = filtered[::OVERSAMPLING]
    noisy = sampled + generator.normal(0.0, tester.force_noise, sampled.size) + tester.force_offset
    position = np.round(displacement[::OVERSAMPLING] / tester.stage_step) * tester.stage_step
    return position, np.round(noisy / tester.force_step) * tester.force_step

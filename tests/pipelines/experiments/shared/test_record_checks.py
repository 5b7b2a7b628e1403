"""Checks of a record's readings on records made here: a body that hangs, falls and lies."""

import numpy as np
import pytest

from pipelines.experiments.shared.record_checks import Trace, break_in, held_readings


def _record(noise: float, step: float, seed: int) -> Trace:
    """A body that hangs for 0.1 s, falls 5 mm within 32 ms, bounces and lies (20 µs between readings)."""
    time = 20e-6 * np.arange(12_000)
    s = np.clip(time - 0.1, 0.0, None)
    fall = np.minimum(0.5 * 9.81 * s**2, 5e-3)
    later = s - np.sqrt(2 * 5e-3 / 9.81)
    bounce = np.where(later > 0, np.clip(0.25 * later - 0.5 * 9.81 * later**2, 0.0, None), 0.0)
    reading = bounce - fall + np.random.default_rng(seed).normal(0.0, noise, time.size)
    return Trace("a.csv", time, np.round(reading / step) * step)


@pytest.mark.parametrize("noise", [0.1e-6, 0.9e-6, 3e-6])
def test_equal_readings_of_a_body_at_rest_are_not_held_ones(noise: float) -> None:
    """With noise about the display's step, runs of equal readings come by chance, and so do jumps beside them."""
    assert [held_readings(_record(noise, 1e-6, seed)).level for seed in range(100)] == [None] * 100

    # one that is held 20 ms after the beginning of the fall
    trace = _record(0.8e-6, 1e-6, 1)
    trace.reading[6000:6030] = trace.reading[6000]
    assert held_readings(trace).level == "doubtful"


def test_an_impact_is_no_break_in_a_motion_and_a_step_is() -> None:
    found = [break_in(trace.reading, trace.noise) for trace in (_record(1e-6, 1e-7, seed) for seed in range(50))]
    assert found == [None] * 50
    trace = _record(1e-6, 1e-7, 1)
    trace.reading[7000:] += 50e-6
    assert break_in(trace.reading, trace.noise) == (7000, pytest.approx(50e-6, abs=6e-6))

"""The benchmarks of signals: their truth is true, and ours is nearer to it than the thesis's."""

import numpy as np
import pytest

from pipelines.bench import velocity
from pipelines.bench.laser_truth import Record, record


@pytest.fixture(scope="module")
def bouncing() -> Record:
    return record("acrylic", 0.12)


def test_the_true_velocity_is_that_of_free_fall(bouncing: Record) -> None:
    time = bouncing.displacement.time.values
    falling = (time > bouncing.touch[0] - 0.01) & (time < bouncing.touch[0] - 0.001)
    slope = np.polyfit(time[falling], bouncing.velocity[falling], 1)[0]
    assert slope == pytest.approx(-9.81, abs=0.01)


def test_the_readings_differ_from_the_truth_by_the_noise(bouncing: Record) -> None:
    time, height = bouncing.displacement.time.values, bouncing.displacement.values
    integral = np.concatenate([[0], np.cumsum((bouncing.velocity[1:] + bouncing.velocity[:-1]) / 2 * np.diff(time))])
    assert np.std(height - integral) == pytest.approx(1e-6, rel=0.3)


@pytest.mark.slow
def test_the_default_spline_beats_every_moving_average() -> None:
    points = velocity.run(quick=True).points
    (ours,) = [p.error for p in points if p.is_default]
    assert ours < min(p.error for p in points if p.group)

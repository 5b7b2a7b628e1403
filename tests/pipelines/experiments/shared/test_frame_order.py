"""Exchanged frames are found where an exchange matters, and nowhere else."""

import numpy as np
import pytest

from pipelines.experiments.shared.frame_order import exchanged

RATE, NOISE = 4000.0, 2e-7


@pytest.fixture(scope="module")
def fall():
    """A body that waits, falls from 1.5 mm and bounces with e = 0.8; height [m] of each frame."""
    time = np.arange(0.0, 0.14, 1 / RATE) - 0.02
    first = np.sqrt(2 * 1.5e-3 / 9.81)
    height = np.where(time < 0, 1.5e-3, 1.5e-3 - 0.5 * 9.81 * time**2)
    begin, speed = first, 9.81 * first
    while begin < time[-1]:
        speed *= 0.8
        after = time - begin
        height = np.where(after > 0, speed * after - 0.5 * 9.81 * after**2, height)
        begin += 2 * speed / 9.81
    return height


def test_nothing_is_exchanged_in_clean_films(fall):
    rng = np.random.default_rng(1)
    assert [exchanged(fall + NOISE * rng.standard_normal(fall.size)) for _ in range(50)] == [None] * 50
    assert [exchanged(np.zeros(count)) for count in range(5)] == [None] * 5  # too few for an order


def test_any_two_frames_that_differ_by_more_than_noise_are_named(fall):
    rng = np.random.default_rng(2)
    missed = []
    for k in range(200):
        first = int(rng.integers(0, fall.size - 1))
        second = first + 1 if k % 2 else int(rng.integers(0, fall.size))
        seen = fall + NOISE * rng.standard_normal(fall.size)
        seen[[first, second]] = seen[[second, first]]
        pair = (min(first, second), max(first, second))
        found = exchanged(seen)
        assert found in (pair, None)
        if found is None:
            missed.append(abs(fall[first] - fall[second]))
    assert max(missed) < 30 * NOISE
    assert len(missed) < 120


def test_a_contact_that_a_frame_hides_is_not_exchanged_with_its_neighbour() -> None:
    area = np.array([0.0] * 20 + [143, 428, 582, 689, 761, 801, 810, 786, 730, 640, 513, 324, 5] + [0.0] * 27) ** 2
    hidden = area.copy()
    hidden[30] = 0.0
    assert exchanged(hidden, 10.0) == (30, 31)
    assert exchanged(hidden, 10.0, missed=hidden == 0.0) is None
    area[[24, 40]] = area[[40, 24]]
    assert exchanged(area, 10.0, missed=area == 0.0) == (24, 40)

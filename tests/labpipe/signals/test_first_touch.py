"""First touch: found within its uncertainty, and refused where there is none."""

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.signals._first_touch import first_touch

TOUCH, STIFFNESS, LEVEL, NOISE = 6.25e-5, 1e5, -0.3, 0.02
POSITION = np.linspace(0.0, 1e-4, 2001)  # steps of force far below the noise


def approach(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, NOISE, POSITION.size)
    return LEVEL + STIFFNESS * np.maximum(0.0, POSITION - TOUCH) + noise


def test_touch_and_level_are_found_within_their_uncertainties() -> None:
    found = [first_touch(POSITION, approach(seed)) for seed in range(30)]
    position = np.array([f.position for f in found])
    level = np.array([f.level for f in found])
    assert position.mean() == pytest.approx(TOUCH, abs=2e-8)
    assert level.mean() == pytest.approx(LEVEL, abs=5e-4)
    assert np.mean([f.stiffness for f in found]) == pytest.approx(STIFFNESS, rel=5e-3)
    assert np.mean([f.noise for f in found]) == pytest.approx(NOISE, rel=0.05)
    for values, u in ((position, [f.u_position for f in found]), (level, [f.u_level for f in found])):
        assert np.std(values) == pytest.approx(np.mean(u), rel=0.3)


@pytest.mark.parametrize("count", [60, 200])
def test_steps_of_force_above_the_noise_are_not_noise(count: int) -> None:
    """A coarse approach: most readings lie behind the touch, each 8 or 30 noises above the last."""
    z = np.linspace(5.0e-5, 1.5e-4, count)
    noises, deviations = [], []
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(0.0, NOISE / 10, count)
        force = LEVEL + STIFFNESS * np.maximum(0.0, z - TOUCH) + noise
        found = first_touch(z, force)
        noises.append(found.noise)
        deviations.append((found.position - TOUCH) / found.u_position)
    assert np.mean(noises) == pytest.approx(NOISE / 10, rel=0.06)
    assert 0.6 < np.std(deviations) < 1.3


@pytest.mark.parametrize(
    ("position", "force", "match"),
    [
        (POSITION[:19], np.arange(19.0), "at least 20 readings, found 19"),
        (POSITION, -approach(0), "does not rise"),
        (POSITION, np.zeros(2001), "does not rise"),
        (POSITION, np.where(np.arange(2001) % 2, 0.1, -0.1), "does not rise"),
    ],
)
def test_no_touch_is_refused(position: np.ndarray, force: np.ndarray, match: str) -> None:
    with pytest.raises(InputError, match=match):
        first_touch(position, force)


@pytest.mark.parametrize("seed", range(4))
def test_an_approach_that_stops_at_four_times_the_noise_has_its_touch(seed: int) -> None:
    noise, touch = 0.015, 0.8e-3
    z = np.linspace(0.0, 1e-3, 300)
    force = 0.06 * np.maximum(0.0, z - touch) / (z[-1] - touch) + np.random.default_rng(seed).normal(0.3, noise, z.size)
    found = first_touch(z, force)
    assert abs(found.position - touch) < 3.0 * found.u_position < 0.2e-3
    with pytest.raises(InputError, match="does not rise"):
        first_touch(z, np.random.default_rng(seed).normal(0.3, noise, z.size))

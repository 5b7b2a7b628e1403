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


@pytest.mark.parametrize(("count", "noise"), [(2001, NOISE), (60, NOISE / 10)])
def test_the_touch_is_found_also_where_steps_of_force_are_above_the_noise(count: int, noise: float) -> None:
    z = np.linspace(0.0, 1.5e-4, count)
    rise = STIFFNESS * np.maximum(0.0, z - TOUCH)
    found = [first_touch(z, LEVEL + rise + np.random.default_rng(k).normal(0.0, noise, count)) for k in range(20)]
    assert np.mean(found) == pytest.approx(TOUCH, abs=2e-8)
    assert np.std(found) < 3.0 * noise / STIFFNESS / np.sqrt(count / 4)


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

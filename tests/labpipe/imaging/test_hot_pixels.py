"""Pixels that do not follow the scene are found, and nothing else is."""

import numpy as np
import pytest

from labpipe.frames import ArrayFrames
from labpipe.imaging.films import without_stuck_pixels


def moving_film(kind: type[np.generic] = np.uint8) -> np.ndarray:
    """Blobs that move by 0.7 px a frame."""
    y, x = np.mgrid[:64, :80]
    frames = [110.0 + 60.0 * np.sin(0.4 * (x - 0.7 * k)) * np.cos(0.5 * y + 0.1 * k) for k in range(10)]
    noise = np.random.default_rng(0).normal(0.0, 1.5, (10, 64, 80))
    return np.clip(np.rint(np.stack(frames) + noise), 0, 255).astype(kind)


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_hot_and_dead_pixels_are_interpolated(kind: type[np.generic]) -> None:
    film = moving_film(kind)
    wrong = film.copy()
    wrong[:, 20, 30], wrong[:, 41, 11], wrong[:, 41, 12] = 255, 0, 255
    repaired, found = without_stuck_pixels(ArrayFrames(wrong))
    assert found.count == 3
    places = ([20, 41, 41], [30, 11, 12])
    for k in range(10):
        assert np.abs(repaired[k][places].astype(float) - film[k][places]).max() < 25.0
        rest = np.ones(film[k].shape, bool)
        rest[places] = False
        assert (repaired[k][rest] == wrong[k][rest]).all()
    part = repaired.roi(slice(10, 30), slice(20, 40))
    assert (part[3] == repaired[3][10:30, 20:40]).all()


def test_a_sound_film_and_one_in_which_nothing_moves_are_left_as_they_are() -> None:
    sound = ArrayFrames(moving_film())
    assert without_stuck_pixels(sound)[0] is sound
    film = np.repeat(moving_film()[:1], 6, axis=0)
    film[:, 20, 30] = 255
    assert without_stuck_pixels(ArrayFrames(film))[1].count == 0

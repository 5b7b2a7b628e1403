"""Patterns that come back are followed over more than a period where their grain tells it, and refused where not."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from labpipe.arrays import Floats
from labpipe.imaging import track
from labpipe.imaging.dic._comes_back import ComesBack

#: Rows and columns of a frame, and of a brick with its joint (px).
SIZE, HIGH, WIDE = 180, 11.0, 23.0
PLACES = np.stack(np.meshgrid(np.arange(40, 150, 20), np.arange(40, 150, 20)), axis=-1).reshape(-1, 2)


def bricks(moved: tuple[float, float], grain: float, seed: int = 1) -> Floats:
    """Bricks of two tones, averaged over the pixels, whose grain (grey) of 3 px moves with them, and noise of 1."""
    fine = 4
    at = (np.arange(fine * SIZE) + 0.5) / fine - 0.5
    x, y = at[None, :] - moved[0] + 500.0, at[:, None] - moved[1] + 500.0
    course = np.floor(y / HIGH)
    joint = (y % HIGH < 2.0) | ((x + (course % 2) * WIDE / 2.0) % WIDE < 2.0)
    seen = np.where(joint, 80.0, 140.0).reshape(SIZE, fine, SIZE, fine).mean(axis=(1, 3))
    texture = gaussian_filter(np.random.default_rng(7).standard_normal((SIZE, SIZE)), 3.0, mode="wrap")
    down, across = np.fft.fftfreq(SIZE)[:, None], np.fft.fftfreq(SIZE)
    turned = np.exp(-2j * np.pi * (across * moved[0] + down * moved[1]))
    seen += grain * np.fft.ifft2(np.fft.fft2(texture / texture.std()) * turned).real
    return np.rint(seen + np.random.default_rng(seed).standard_normal(seen.shape))


def film(steps: list[tuple[float, float]], grain: float) -> Floats:
    """Frames of bricks at displacements."""
    return np.stack([bricks(step, grain, seed) for seed, step in enumerate(steps)])


@pytest.mark.parametrize("jump", [(14.25, 0.25), (-3.5, 12.5), (20.0, -14.5)])
def test_grain_tells_a_jump_of_more_than_a_period(jump: tuple[float, float]) -> None:
    """Nothing but a grain of 2 grey tells bricks from the next ones; all are found, at their places."""
    steps = [(0.0, 0.0), (0.25, 0.0), jump, (jump[0] + 0.25, jump[1] - 0.25)]
    found = track(film(steps, 2.0).astype(np.uint8), PLACES, 21)
    error = np.hypot(found.dx - np.array(steps)[:, :1], found.dy - np.array(steps)[:, 1:])
    inside = ((PLACES + jump > 15) & (PLACES + jump < SIZE - 16)).all(axis=1)
    assert found.valid.values[:, inside].all()
    assert float(error.max()) < 0.1


def test_a_jump_is_refused_that_nothing_tells() -> None:
    """Without grain a jump by most of a period may be one back by the rest, and no result says either."""
    found = track(film([(0.0, 0.0), (0.25, 0.0), (14.25, 0.25), (14.5, 0.25)], 0.0).astype(np.uint8), PLACES, 21)
    assert found.valid.values[:2].all()
    assert not found.valid.values[2:].any()


def test_a_slow_motion_needs_no_grain() -> None:
    """A motion of a small part of a period is where it was expected, whatever else matches."""
    steps = [(0.5 * k, -0.25 * k) for k in range(6)]
    found = track(film(steps, 0.0).astype(np.uint8), PLACES, 21)
    error = np.hypot(found.dx - np.array(steps)[:, :1], found.dy - np.array(steps)[:, 1:])
    assert found.valid.values.all()
    assert float(error.max()) < 0.1


@pytest.mark.parametrize(("grain", "most"), [(0.0, 1), (4.0, 0)])
def test_places_are_looked_for_far_around_only_where_the_place_at_hand_does_not_tell(
    grain: float, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every frame of such a film was searched over 110 px: it took up to six times as long as without."""
    searches = []
    find = ComesBack._find

    def counted(self: ComesBack, *args: object, **options: object) -> object:
        searches.append(1)
        return find(self, *args, **options)

    monkeypatch.setattr(ComesBack, "_find", counted)
    steps = [(0.25 * k, -0.25 * k) for k in range(6)]
    found = track(film(steps, grain).astype(np.uint8), PLACES, 21)
    error = np.hypot(found.dx - np.array(steps)[:, :1], found.dy - np.array(steps)[:, 1:])
    assert found.valid.values.all()
    assert float(error.max()) < 0.1
    assert len(searches) <= most

"""Patterns that repeat themselves, and lines sharper than the pixels: nothing is found in a wrong period."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from labpipe.imaging import track
from labpipe.imaging.dic._periodic import find_repeats
from pipelines.bench import film_scenes
from pipelines.bench.film_scenes import Formula, View, digitised
from tests.by_day import crossed
from tests.labpipe.imaging.speckle import grid
from tests.labpipe.imaging.test_trust import seen_by_pixels, wrong

SIZE = 160
PATTERNS = {"lines": film_scenes.bars, "crossed": None, "dots": film_scenes.dots}


def pattern(kind: str, angle: float, period: float, sharpness: float) -> Formula:
    if kind != "crossed":
        return PATTERNS[kind](angle, period, sharpness)
    one, other = (film_scenes.bars(turn, period, sharpness) for turn in (angle, angle + 0.5 * np.pi))
    return lambda x, y: one(x, y) * other(x, y) / 60.0


def paths(rng: np.random.Generator) -> dict[str, list[View]]:
    """Five views each, of motions at random."""
    step, far = rng.uniform(-1.0, 1.0, 2), rng.uniform(-9.0, 9.0, 2)
    at = [tuple(k * step) for k in range(5)]
    return {
        "still": [View()] * 5,
        "slow": [View((0.4 * x, 0.4 * y)) for x, y in at],
        "fast": [View((2.5 * x, 2.5 * y)) for x, y in at],
        "turn": [View((0.4 * x, 0.4 * y), angle=0.004 * x) for x, y in at],
        "jump": [View(), View(), *(View(tuple(far + 0.2 * k)) for k in range(3))],
        "pixels": [View(tuple(k * np.sign(step))) for k in range(5)],
    }


def follow(kind: str, path: str, seed: int) -> tuple[int, int, int]:
    """Results wrong, valid and asked for, of a grating or grid at random."""
    rng = np.random.default_rng(seed)
    period = rng.uniform(10.0, 16.0) if rng.random() < 0.25 else rng.uniform(5.0, 8.0)
    sharpness, grain = rng.choice([0.02, 0.1, 0.3]), rng.choice([0.0, 0.0, 0.5, 2.0])
    drawn = pattern(kind, rng.uniform(0.0, np.pi), period, sharpness)
    texture = film_scenes.perlin(5.0, seed, octaves=1)
    grained = (lambda x, y: drawn(x, y) + grain / 40.0 * texture(x, y)) if grain else drawn
    views = paths(rng)[path]
    noise, subset = rng.choice([0.5, 1.0, 2.0, 4.0]), [15, 21, 31, 45][rng.integers(4)]
    frames = [seen_by_pixels(grained, SIZE, view) for view in views]
    found = track(
        digitised(frames, noise, seed), grid((SIZE, SIZE), 26, 12), subset, ["auto", "rigid", "affine"][seed % 3]
    )
    return wrong(found, tuple(views)), int(found.valid[1:].sum()), found.valid[1:].size


@pytest.mark.parametrize(("kind", "path"), crossed(PATTERNS, ["turn", "jump", "fast", "slow"], 3, 4))
def test_no_wrong_period_and_no_moire_is_followed(kind: str, path: str) -> None:
    for seed in (14, 16):
        assert follow(kind, path, seed)[0] == 0


def test_a_grid_whose_folded_waves_lie_side_by_side_is_told() -> None:
    """Each was taken for the texture around the others, and 243 results followed the moire."""
    assert follow("crossed", "jump", 5268)[0] == 0


@pytest.mark.nightly
def test_of_100_000_results_on_gratings_and_grids_none_is_wrong_by_5_u() -> None:
    bad, asked, seed = 0, 0, 0
    while asked < 100_000:
        seed += 1
        kind = list(PATTERNS)[seed % 3]
        wrong_here, _, asked_here = follow(kind, list(paths(np.random.default_rng(0)))[seed % 6], 5000 + seed)
        bad, asked = bad + wrong_here, asked + asked_here
    assert bad == 0


def test_a_grid_that_moves_slowly_is_followed() -> None:
    """Its own past tells which period it is."""
    views = tuple(View((0.3 * k, -0.2 * k)) for k in range(5))
    frames = [film_scenes.from_formula(film_scenes.dots(0.3, 9.0, 1.0), SIZE, view) for view in views]
    found = track(digitised(frames, 1.0, 3), grid((SIZE, SIZE), 26, 12), 31)
    assert found.valid.all()
    assert wrong(found, views) == 0


@pytest.mark.parametrize("jump", [(3.9, 0.4), (4.4, -3.1), (2.0, 1.0)])
def test_a_grid_that_jumps_is_lost(jump: tuple[float, float]) -> None:
    """Any of its periods may be the right one; template matches say nothing."""
    views = [View(), View(), View(jump), View(jump)]
    frames = [film_scenes.from_formula(film_scenes.dots(0.0, 8.0, 1.0), SIZE, view) for view in views]
    found = track(digitised(frames, 1.0, 3), grid((SIZE, SIZE), 26, 12), 31)
    assert wrong(found, tuple(views)) == 0


def test_a_grid_of_many_harmonics_is_recognised() -> None:
    """Two waves have hardly half of its variance; it went by whole pixels into a wrong period."""
    assert follow("dots", "pixels", 5053)[0] == 0


def test_random_patterns_do_not_repeat_themselves() -> None:
    points = np.rint(grid((240, 240), 40, 10)).astype(int)
    fields = [film_scenes.random_field(240, feature, 3) for feature in (0.8, 1.9, 4.5)]
    textures = [film_scenes.from_formula(film_scenes.perlin(cell, 4), 240, View()) for cell in (4.0, 7.0, 20.0)]
    for image in (*fields, *textures, film_scenes.photograph(240)):
        found = find_repeats(digitised([image - image.mean() + 127.0], 2.0, 1)[0].astype(float), points)
        assert np.isinf(found.period).all()
        assert not found.is_folded.any()


@pytest.mark.parametrize("seed", [0, 1])
def test_a_texture_on_a_grid_is_none_of_its_folded_waves(seed: int) -> None:
    """Smooth waves of 5.2 px have none; a fine texture has some at every place, which lost half of the points."""
    y, x = np.mgrid[:SIZE, :SIZE] * (2.0 * np.pi / 5.2)
    waves = np.sin(0.95 * x + 0.31 * y) + np.sin(0.95 * y - 0.31 * x)
    texture = gaussian_filter(np.random.default_rng(seed).standard_normal((SIZE, SIZE)), 0.8)
    grey = 127.0 + 30.0 * waves + 8.0 * texture / texture.std()
    found = find_repeats(grey, np.rint(grid((SIZE, SIZE), 26, 12)).astype(int))
    assert np.isfinite(found.period).all()
    assert not found.is_folded.any()


@pytest.mark.parametrize("sharpness", [0.02, 0.3])
def test_lines_in_focus_are_told_from_lines_sharper_than_the_pixels(sharpness: float) -> None:
    points = np.rint(grid((SIZE, SIZE), 26, 12)).astype(int)
    sharp = seen_by_pixels(film_scenes.bars(0.4, 6.3, sharpness), SIZE, View())
    fine = film_scenes.from_formula(film_scenes.bars(0.4, 31.5, sharpness), 5 * SIZE, View())
    lens = gaussian_filter(fine, 4.5)[2::5, 2::5]
    for grey, is_folded in ((sharp, True), (lens, False)):
        found = find_repeats(digitised([grey], 2.0, 1)[0].astype(float), points)
        assert (found.is_folded == is_folded).mean() > 0.99

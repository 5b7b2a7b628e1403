"""What cameras do to films: rows of two instants, repeated rows, pixels that do not follow the scene."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
import xarray as xr

from labpipe.arrays import Floats
from labpipe.frames import ArrayFrames, FrameSource, as_frames
from labpipe.imaging import contact_radius, track
from labpipe.imaging.films import without_stuck_pixels
from labpipe.imaging.films._stuck_pixels import RepairedFrames
from pipelines.bench import film_scenes
from pipelines.bench.film_scenes import View, digitised, from_formula, from_spectrum
from tests.by_day import by_day
from tests.labpipe.imaging.contact_scenes import Disturbed, film_of
from tests.labpipe.imaging.fringe_film import Scene, gap_of_hertz
from tests.labpipe.imaging.speckle import grid

SIZE, NOISE = 160, 1.0
POINTS = grid((SIZE, SIZE), 30, 14)
Draw = Callable[[View], Floats]
PATTERNS: dict[str, Draw] = {
    "fine field": partial(from_spectrum, 0.7 * film_scenes.random_field(SIZE, 0.9, 1)),
    "field": partial(from_spectrum, 0.7 * film_scenes.random_field(SIZE, 1.9, 2)),
    "coarse field": partial(from_spectrum, 0.7 * film_scenes.random_field(SIZE, 3.0, 3)),
    "Perlin noise": partial(from_formula, film_scenes.perlin(7.0, 4), SIZE),
    "photograph": partial(from_spectrum, film_scenes.photograph(SIZE)),
}
#: Motion from frame to frame (px).
STEPS = {"slow": (0.13, 0.07), "half a pixel": (0.5, 0.1), "fast": (1.3, 0.7), "down": (0.0, 0.9), "jumps": (4.3, 2.7)}


def moving(draw: Draw, step: tuple[float, float], count: int = 6) -> list[Floats]:
    return [draw(View((k * step[0], k * step[1]))) for k in range(count)]


def beyond_5_u(found: xr.Dataset, step: tuple[float, float]) -> int:
    error = np.hypot(found.dx - step[0] * found.frame, found.dy - step[1] * found.frame)
    return int((error > 5.0 * np.hypot(found.u_dx, found.u_dy) + 0.002).sum())


def stuck(film: np.ndarray, kind: str, seed: int) -> np.ndarray:
    """The film as a sensor with faults records it."""
    rng = np.random.default_rng(seed)
    y, x = rng.integers(0, SIZE, (2, SIZE * SIZE // (1000 if kind == "hot" else 100)))
    film = film.copy()
    film[:, y, x] = np.where(rng.random(len(y)) < 0.5, 255, 0) if kind == "mixed" else 255
    if kind == "pairs":
        film[:, y, np.minimum(x + 1, SIZE - 1)] = 255
    if kind == "column":
        film = digitised([frame.astype(float) for frame in film], 0.0, 0)
        film[:, :, 71] = 255
    return film


@pytest.mark.parametrize("motion", ["slow", "fast"])
@pytest.mark.parametrize("kind", ["hot", "mixed", "pairs"])
@pytest.mark.parametrize("name", by_day(["field", "coarse field", "Perlin noise"], 1))
def test_pixels_that_are_stuck_do_not_bind_the_correlation(name: str, kind: str, motion: str) -> None:
    clean = digitised(moving(PATTERNS[name], STEPS[motion]), NOISE, 9)
    film = stuck(clean, kind, 10)
    found, sound = track(film, POINTS), track(clean, POINTS)
    assert found.valid[1:].all()
    assert beyond_5_u(found, STEPS[motion]) == 0
    away = np.abs(found.dx - sound.dx)
    assert float(np.sqrt((away**2).mean())) < 0.01  # px; unrepaired 0.05 to 0.8
    assert "not follow the scene" in found.attrs["note"]


def test_stuck_pixels_are_found_and_nothing_else() -> None:
    clean = digitised(moving(PATTERNS["field"], (0.9, 0.4)), NOISE, 11)
    film = stuck(clean, "mixed", 12)
    repaired, found = without_stuck_pixels(as_frames(film))
    truth = (film != clean).all(axis=0)
    assert found.count == pytest.approx(truth.sum(), rel=0.05)
    before, after = (np.abs(one[2].astype(float) - clean[2])[truth] for one in (film, repaired))
    assert np.sqrt((after**2).mean()) < 0.1 * np.sqrt((before**2).mean())
    assert (repaired[2] != film[2])[~truth].mean() < 2e-4


def test_pixels_that_add_to_the_light_or_take_from_it_are_found() -> None:
    """A leak of charge adds, dust on the cover glass shades: their level follows the scene, not their height."""
    images = np.array(moving(PATTERNS["coarse field"], (0.5, 0.3)))
    y, x = np.random.default_rng(21).integers(8, SIZE - 8, (2, 12))
    images[:, y, x] += np.resize([70.0, -70.0], 12)
    repaired, found = without_stuck_pixels(as_frames(digitised(list(images), NOISE, 22)))
    assert isinstance(repaired, RepairedFrames)
    assert repaired.stuck[y, x].mean() > 0.8
    assert found.count <= 12


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_a_repaired_film_is_a_film(kind: type[np.generic]) -> None:
    clean = digitised(moving(PATTERNS["field"], (0.9, 0.4)), NOISE, 13)
    time = np.arange(6) * 1e-4
    film = ArrayFrames(stuck(clean, "mixed", 14).astype(kind), time, 2e-5)
    repaired, found = without_stuck_pixels(film)
    assert isinstance(repaired, FrameSource)
    assert found.count > 200
    assert repaired[0].dtype == kind
    assert (len(repaired), repaired.shape, repaired.levels) == (6, film.shape, film.levels)
    assert np.array_equal(repaired.time, time)
    assert repaired.exposure is not None
    assert repaired.valid.all()
    part = repaired.roi(slice(40, 90), slice(20, 100))
    assert np.array_equal(part[3][8:-8, 8:-8], repaired[3][48:82, 28:92])
    everything = [repaired[k] for k in range(len(repaired))]
    assert np.array_equal(np.stack(list(repaired)), np.stack(everything))


# --- fringes ------------------------------------------------------------------------------------

OPTICS = Scene(rows=320, columns=420)
RADII = [150e-6, 200e-6, 230e-6, 240e-6, 240e-6, 240e-6]


def contacts(radii: list[float], seed: int = 0) -> np.ndarray:
    def gap(r: Floats, a: float) -> Floats:
        return gap_of_hertz(r, a, OPTICS.sphere_radius)

    return film_of(Disturbed(OPTICS), gap, radii, seed=seed)


def measured(film: np.ndarray) -> xr.Dataset:
    return contact_radius(film, OPTICS.pixel_size, OPTICS.sphere_radius, OPTICS.wavelength)


@pytest.mark.parametrize("radii", by_day([RADII, [200e-6 + k * 0.4e-6 for k in range(6)]], 1))
def test_contacts_of_two_instants_are_left_out_and_those_at_rest_are_not(radii: list[float]) -> None:
    later = [0.5 * (one + other) for one, other in zip(radii, [*radii[1:], radii[-1]], strict=True)]
    film, odd = contacts(radii), contacts(later, 1)
    film[:, 1::2] = odd[:, 1::2]
    with pytest.warns(UserWarning, match="odd and even rows"):
        found = measured(film)
    is_moving = np.abs(np.gradient(radii)) > 0.0
    assert not found.valid.values[is_moving].any()
    rest = found.radius.values[~is_moving] - np.array(radii)[~is_moving]
    assert np.abs(rest).max(initial=0.0) < 0.01e-6
    assert "interlaced" in found.attrs["note"]


def test_a_film_of_contacts_from_one_field_is_refused() -> None:
    film = contacts(RADII)
    film[:, 1::2] = film[:, ::2]
    with pytest.warns(UserWarning, match="every second row"):
        found = measured(film)
    assert not found.valid.any()
    assert not np.isfinite(found.radius).any()


def test_stuck_pixels_do_not_change_a_radius() -> None:
    film = contacts(RADII)
    rng = np.random.default_rng(3)
    y, x = rng.integers(0, 320, 1300), rng.integers(0, 420, 1300)
    film[:, y, x] = np.where(rng.random(1300) < 0.5, 255, 0)
    found = measured(film)
    error = (found.radius - RADII) / np.hypot(found.u_radius, found.radius_systematic)
    assert np.abs(error).max() < 3.0
    assert found.u_radius.max() < 0.005e-6
    assert "not follow the scene" in found.attrs["note"]


@pytest.mark.parametrize("is_reflected", [True, False])
def test_contacts_under_a_reflection_that_stands_still_are_measured(is_reflected: bool) -> None:
    """Frames were taken for blank, or were off by up to 1 um; bright, overexposed contacts are no reflection."""
    scene = OPTICS if is_reflected else OPTICS.change(phase=0.0, mean=190.0)
    film = film_of(Disturbed(scene), lambda r, a: gap_of_hertz(r, a, scene.sphere_radius), RADII)
    if is_reflected:
        row, column = np.indices(film.shape[1:])
        light = 300.0 * np.exp(-(((row - 168) / 21.0) ** 2) - ((column - 230) / 21.0) ** 2)
        film = np.clip(np.rint(film + light), 0, 255).astype(np.uint8)
    found = measured(film)
    assert found.in_contact.all()
    assert np.abs(found.radius - RADII).max() < 0.02e-6
    assert ("reflection" in found.attrs["note"]) is is_reflected

"""Which frames of a long film are read: contacts are not missed, flights and rest are left out."""

import json
from collections import Counter

import numpy as np
import pytest
import xarray as xr

from labpipe.frames import ArrayFrames
from labpipe.imaging import contact_radius
from tests.labpipe.imaging.fringe_film import Scene, clean_image, expose
from tests.labpipe.imaging.impact_film import score

SCENE = Scene(rows=96, columns=128, pixel_size=5e-6)
CENTRE = (62.3, 45.7)
UM = 1e-6
REST = 320  # first frame at rest


class CountedFrames(ArrayFrames):
    """A film that counts how often every frame is read whole."""

    reads: Counter[int]

    def __getitem__(self, index: int) -> np.ndarray:
        self.reads[index] += 1
        return super().__getitem__(index)


def long_film() -> tuple[CountedFrames, np.ndarray]:
    """Two impacts of some frames, flights between them, and rest; only the noise is new."""
    rng = np.random.default_rng(3)
    radii = np.zeros(400)
    radii[81:92] = 100.0 * UM * (0.6 + np.sin(np.pi * (np.arange(11) + 1.0) / 12.0))
    radii[203:211] = 90.0 * UM * (0.6 + np.sin(np.pi * (np.arange(8) + 1.0) / 9.0))
    radii[REST:] = 75.0 * UM
    # The sphere moves many fringes during an exposure.
    washed_out = np.full((SCENE.rows, SCENE.columns), SCENE.mean)
    seen = {0.0: washed_out} | {float(a): clean_image(SCENE, float(a), CENTRE, samples=4) for a in set(radii) - {0.0}}
    images = np.stack([expose(seen[float(a)], SCENE, rng) for a in radii])
    film = CountedFrames(images, 1e-4 * np.arange(400, dtype=np.float64))
    film.reads = Counter()
    return film, radii


def measure(film: ArrayFrames, **options: object) -> xr.Dataset:
    given = SCENE.pixel_size, SCENE.sphere_radius, SCENE.wavelength
    return contact_radius(film, *given, **options)  # type: ignore[arg-type]


def test_where_the_radius_turns_round_it_is_measured() -> None:
    """Bands showed no change there: radii between those before and after were off by up to 113 u."""
    radii = (80.0 + 25.0 * np.sin(np.linspace(0.3, np.pi - 0.3, 120))) * UM
    rng = np.random.default_rng(8)
    images = np.stack([expose(clean_image(SCENE, float(a), CENTRE, samples=4), SCENE, rng) for a in radii])
    found = measure(ArrayFrames(images, 1e-4 * np.arange(120, dtype=np.float64)))
    assert found.in_contact.all()
    assert np.abs(score(found, radii, radii, found.radius_systematic).ratios).max() < 4.5


def test_only_frames_that_matter_are_read_and_none_is_missed() -> None:
    film, radii = long_film()
    found = measure(film)
    work = json.loads(found.attrs["work"])
    assert found.in_contact.values.tolist() == (radii > 0.0).tolist()
    assert found.radius.values[radii > 0.0] == pytest.approx(radii[radii > 0.0], abs=0.1 * UM)
    assert work["frames_read"] < 0.2 * work["frames_total"]
    assert work["bytes_read"] < 0.45 * work["bytes_total"]  # every tenth row of all frames among them
    assert work["bytes_total"] == 400 * 96 * 128
    assert (found.method.values[REST + 5 : -5] == 3).sum() > 60
    assert max(film.reads.values()) == 1
    assert len(film.reads) == work["frames_read"]
    assert work["repeated_reads"] == 0


@pytest.mark.parametrize(
    ("optics", "second", "light"), [({"phase": 0.3}, (95.3, 90.7), (1.0, 0.5)), ({}, (210.3, 195.7), (1.0, 1.0))]
)
def test_contacts_are_found_whatever_their_light_and_wherever_they_are(
    optics: dict[str, float], second: tuple[float, float], light: tuple[float, float]
) -> None:
    """Bands judged by the stated phase, near the first contact, in its light missed most of them."""
    scene = SCENE.change(**optics, rows=260, columns=300, pixel_size=2.2e-6)
    rng = np.random.default_rng(6)
    radii = np.zeros(120)
    radii[62:67], radii[100:104] = 100.0 * UM, 80.0 * UM
    even = np.full((scene.rows, scene.columns), scene.mean)
    shown = {0.0: even} | {a: clean_image(scene, a, p, samples=4) for a, p in ((1e-4, (95.3, 90.7)), (8e-5, second))}
    levels = np.linspace(*light, len(radii)).tolist()
    images = [expose(shown[round(a, 6)] * level, scene, rng) for a, level in zip(radii.tolist(), levels, strict=True)]
    found = contact_radius(np.stack(images), scene.pixel_size, scene.sphere_radius, scene.wavelength)
    against = score(found, radii, radii, found.radius_systematic)
    assert (against.false, against.missed) == ([], [])
    assert np.abs(against.ratios).max() < 4.0

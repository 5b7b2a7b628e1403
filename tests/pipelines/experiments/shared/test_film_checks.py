"""Checks of a film: its light, order and copies of its frames, and the rate and exposure that a session states."""

import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from instruments import phantom
from labpipe.errors import LabpipeError
from labpipe.frames import as_frames
from labpipe.judging import Check
from labpipe.units import Quantity
from labpipe.workflow.context import Context, Outcome, Warned
from pipelines.experiments.shared.film_checks import (
    LIGHT,
    exchanged,
    exposed,
    exposure_stated,
    light_of,
    of_film,
    said_by_file,
)
from pipelines.experiments.shared.film_frames import open_film

COUNT, SHAPE = 60, (64, 96)
RATE, SHUTTER, NOISE = 4000.0, 5e-6, 2e-7


def scene() -> np.ndarray:
    """Bright and dark patches with noise, in grey levels that are not yet digitised."""
    random = np.random.default_rng(4)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    patches = 120.0 * (1.0 + 0.8 * np.sin(0.3 * columns) * np.cos(0.4 * rows))
    return patches + 2.0 * random.standard_normal((COUNT, *SHAPE))


def light(images: np.ndarray) -> str:
    return light_of(as_frames(np.clip(np.rint(images), 0, 255).astype(np.uint8)))


@pytest.mark.parametrize(("factor", "level"), [(1.0, None), (1.22, "note"), (3.0, "doubtful")])
def test_an_over_exposed_film_is_named_with_its_level(factor: float, level: str | None) -> None:
    found = exposed(xr.Dataset(attrs={LIGHT: light(factor * scene())}), "a.cine")
    assert found.level == level
    assert ("highest grey level, 255" in found.message) == (level is not None)


@pytest.fixture
def film(tmp_path: Path) -> Callable[..., xr.Dataset]:
    """Write a film and return what a stage keeps of it."""

    def written(time: np.ndarray) -> xr.Dataset:
        images = (np.full((16, 16), 40 + i % 3, np.uint8) for i in range(time.size))
        recording = phantom.Recording(int(RATE), SHUTTER, bits=8)
        phantom.write(tmp_path / "a.cine", images, (time.size, 16, 16), time, recording)
        return xr.Dataset(attrs={"said_by_file": said_by_file(open_film(tmp_path / "a.cine"))})

    return written


@pytest.mark.parametrize(("seconds", "level"), [(SHUTTER, None), (1e-6, None), (5e-3, "doubtful")])
def test_a_stated_exposure_is_a_flash_or_contradicts_the_shutter(
    film: Callable[..., xr.Dataset], seconds: float, level: str | None
) -> None:
    check = exposure_stated(film(np.arange(COUNT) / RATE), "a.cine", Quantity(seconds, 0.0, "s"))
    assert (check.level, check.setting) == (level, "exposure")
    assert "5.00 µs" in check.message


def fall() -> np.ndarray:
    """A body that waits, falls from 1.5 mm and bounces with e = 0.8; height [m] of each frame."""
    time = np.arange(0.0, 0.14, 1 / RATE) - 0.02
    begin = np.sqrt(2 * 1.5e-3 / 9.81)
    height, speed = np.where(time < 0, 1.5e-3, 1.5e-3 - 0.5 * 9.81 * time**2), 9.81 * begin
    while begin < time[-1]:
        speed *= 0.8
        after = time - begin
        height = np.where(after > 0, speed * after - 0.5 * 9.81 * after**2, height)
        begin += 2 * speed / 9.81
    return height


def test_any_two_frames_that_differ_by_more_than_noise_are_named_and_none_in_clean_films() -> None:
    rng, height = np.random.default_rng(2), fall()
    assert [exchanged(height + NOISE * rng.standard_normal(height.size)) for _ in range(50)] == [None] * 50
    assert [exchanged(np.zeros(count)) for count in range(5)] == [None] * 5  # too few for an order
    missed = []
    for k in range(200):
        first = int(rng.integers(0, height.size - 1))
        second = first + 1 if k % 2 else int(rng.integers(0, height.size))
        seen = height + NOISE * rng.standard_normal(height.size)
        seen[[first, second]] = seen[[second, first]]
        found = exchanged(seen)
        assert found in ((min(first, second), max(first, second)), None)
        missed += [abs(height[first] - height[second])] * (found is None)
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


def _written(path: Path, patterns: np.ndarray) -> Path:
    times = np.arange(len(patterns)) * 1e-4
    phantom.write(path, iter(patterns), patterns.shape, times, phantom.Recording(10_000, 2e-6))
    return path


def _rings(count: int) -> np.ndarray:
    """Images of rings with noise, as a camera sees them."""
    y, x = np.mgrid[:40, :200]
    rings = 120 + 60 * np.cos(2e-3 * ((x - 90) ** 2 + (y - 15) ** 2))
    return (rings + np.random.default_rng(1).normal(0, 2, (count, 40, 200))).round().astype(np.uint8)


@pytest.mark.parametrize("count", [1, 3])
def test_exchanged_width_and_height_are_told(tmp_path: Path, count: int) -> None:
    """They are exchanged where the images are described, or where settings are too."""
    path = _written(tmp_path / "a.cine", _rings(3))
    assert open_film(path).shape == (3, 40, 200)
    data = bytearray(path.read_bytes())
    (bitmap, setup) = struct.unpack_from("<II", data, 24)
    for layout, at in (("<ii", bitmap + 4), ("<HH", setup + 737), ("<II", setup + 1588))[:count]:
        struct.pack_into(layout, data, at, *reversed(struct.unpack_from(layout, data, at)))
    path.write_bytes(data)
    with pytest.raises(LabpipeError, match="width and height are exchanged") as error:
        open_film(path)
    failed = Outcome("film", "radius", None, "failed", message=str(error.value), reason=error.value.reason)
    (told,) = _judged(failures=(failed,))
    assert told.cause.startswith("width and height are exchanged in the header")


def _judged(**run: Any) -> list[Check]:
    """Judge the steps of a run over a film of which nothing was measured."""
    context = Context("film", "contact_area", "", "", "", False, **run)
    causes = {"radius": "the record is of another view", "bounces": "the film shows no drop"}
    return of_film(context, SimpleNamespace(film="film/f.avi"), None, causes, {})


def test_a_step_that_fails_over_a_film_that_broke_off_is_told_so() -> None:
    warned = Warned("track", None, "IncompleteFilmWarning", "f.avi: 9 frames are declared, 4 can be read", 1)
    failed = Outcome("film", "bounces", None, "failed", message="no bounce found")
    (told,) = _judged(failures=(failed,), warnings=(warned,))
    assert told.cause.startswith("the film was not copied whole")
    (told,) = _judged(failures=(failed,))
    assert told.cause == "the film shows no drop"

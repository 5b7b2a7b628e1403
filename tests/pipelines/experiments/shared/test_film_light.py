"""The light of a film: dark frames, and grey levels that are cut off."""

import json

import numpy as np
import pytest
import xarray as xr

from labpipe.frames import as_frames
from pipelines.experiments.shared.film_light import LIGHT, exposed, light_of, lit

COUNT, SHAPE = 60, (64, 96)


def film() -> np.ndarray:
    """Bright and dark patches with noise, in grey levels that are not yet digitised."""
    random = np.random.default_rng(4)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    scene = 120.0 * (1.0 + 0.8 * np.sin(0.3 * columns) * np.cos(0.4 * rows))
    return scene + 2.0 * random.standard_normal((COUNT, *SHAPE))


def digitised(images: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(images), 0, 255).astype(np.uint8)


def judged(images: np.ndarray, wanted: tuple[int, ...] = ()):
    return exposed(xr.Dataset(attrs={LIGHT: light_of(as_frames(images), wanted)}), "a.cine")


@pytest.mark.parametrize(("factor", "level"), [(0.1, None), (1.0, None), (1.22, "note"), (3.0, "doubtful")])
def test_an_over_exposed_film_is_named_with_its_level(factor: float, level: str | None) -> None:
    found = judged(digitised(factor * film()))
    assert found.level == level
    assert ("highest grey level, 255" in found.message) == (level is not None)
    assert ("over-exposed" in found.cause) == (level is not None)


def test_dark_frames_are_found_where_they_matter() -> None:
    images = film()
    images[30:33] *= 0.05
    light = json.loads(light_of(as_frames(digitised(images)), range(25, 40)))
    brightness = {int(i): b for i, b in light["brightness"].items()}
    assert [i for i, b in brightness.items() if b < 0.5] == [30, 31, 32]
    time = np.arange(COUNT) * 1e-3
    counts = np.zeros(COUNT, bool)
    found = lit("a.cine", brightness, counts, time)
    assert (found.level, "frame 30, at 30.0 ms" in found.message) == ("note", True)
    counts[33:36] = True
    assert lit("a.cine", brightness, counts, time).level == "doubtful"


def test_a_lamp_that_flickers_is_no_dark_frame_and_without_frames_nothing_is_judged() -> None:
    images = film() * (1.0 + 0.3 * np.sin(1.9 * np.arange(COUNT)))[:, None, None]
    light = json.loads(light_of(as_frames(digitised(images)), ()))
    brightness = {int(i): b for i, b in light["brightness"].items()}
    assert lit("a.cine", brightness, np.ones(COUNT, bool), np.arange(COUNT) * 1e-3).level is None
    assert lit("a.cine", {}, np.ones(3, bool), np.arange(3.0)).needs
    assert exposed(xr.Dataset(), "a.cine").needs

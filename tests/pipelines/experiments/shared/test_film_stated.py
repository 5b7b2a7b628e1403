"""What session.toml states of a film is held against what the film says of itself."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from instruments import phantom
from labpipe.frames import as_frames
from labpipe.units import Quantity
from pipelines.experiments.shared.film_frames import open_film
from pipelines.experiments.shared.film_stated import said_by_file, stated_twice, wrong_rate

RATE, SHUTTER, COUNT = 4000.0, 5e-6, 60


@pytest.fixture
def film(tmp_path: Path) -> Callable[..., xr.Dataset]:
    """Write a film and return what a stage keeps of it."""

    def written(time: np.ndarray) -> xr.Dataset:
        images = (np.full((16, 16), 40 + i % 3, np.uint8) for i in range(time.size))
        recording = phantom.Recording(int(RATE), SHUTTER, bits=8)
        phantom.write(tmp_path / "a.cine", images, (time.size, 16, 16), time, recording)
        return xr.Dataset(attrs={"said_by_file": said_by_file(open_film(tmp_path / "a.cine"))})

    return written


def hertz(value: float, u: float = 0.0) -> Quantity:
    return Quantity(value, u, "Hz")


@pytest.mark.parametrize(
    ("stated", "level"), [(RATE, "note"), (1.005 * RATE, "note"), (1.03 * RATE, "doubtful"), (10 * RATE, "doubtful")]
)
def test_a_rate_that_the_film_knows_better_has_no_effect(
    film: Callable[..., xr.Dataset], stated: float, level: str
) -> None:
    found = film(np.arange(COUNT) / RATE)
    (check,) = stated_twice(found, "a.cine", hertz(stated))
    assert (check.level, check.setting) == (level, "frame_rate")
    assert "which are used" in check.message
    assert "4.00 kHz" in check.message
    assert "no effect" in check.cause
    assert not wrong_rate({}, hertz(stated), found, "a.cine").setting


@pytest.mark.filterwarnings("ignore:.*dropped by the camera")
def test_the_rate_within_bursts_is_a_rate_of_the_film(film: Callable[..., xr.Dataset]) -> None:
    time = np.concatenate([np.arange(8) / RATE, 7 / RATE + 5e-3 + 5e-3 * np.arange(20)])
    for stated in (RATE, 200.0):
        (check,) = stated_twice(film(time), "a.cine", hertz(stated))
        assert check.level == "note"


@pytest.mark.parametrize(("stated", "level"), [(SHUTTER, None), (1e-6, "note"), (5e-3, "doubtful")])
def test_a_stated_exposure_is_a_flash_or_contradicts_the_shutter(
    film: Callable[..., xr.Dataset], stated: float, level: str | None
) -> None:
    found = film(np.arange(COUNT) / RATE)
    (check,) = stated_twice(found, "a.cine", None, Quantity(stated, 0.0, "s"))
    assert (check.level, check.setting) == (level, "exposure")
    assert "5.00 µs" in check.message
    assert "which is used" in check.message


def test_images_hold_neither_so_that_nothing_contradicts() -> None:
    said = said_by_file(as_frames(np.zeros((4, 8, 8), np.uint8)))
    assert json.loads(said) == {"intervals": [], "exposure": None}
    found = xr.Dataset(attrs={"said_by_file": said})
    assert list(stated_twice(found, "frames", hertz(RATE), Quantity(SHUTTER, 0.0, "s"))) == []
    assert wrong_rate({}, hertz(RATE), found, "a.cine").setting == "frame_rate"
    assert not wrong_rate({}, None, found, "a.cine").setting

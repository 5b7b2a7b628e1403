"""Films in experiments: key frames, and what cannot be a film that a camera wrote."""

import struct
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

import instruments
from instruments import phantom
from labpipe.errors import InputError, LabpipeError
from labpipe.judging import stated
from labpipe.workflow.context import Context, Failed, Warned
from pipelines.experiments.shared.film_frames import (
    CAUSES,
    explained,
    key_frames,
    open_film,
    repeated,
    strip,
    thinned,
    whole_film,
)
from pipelines.experiments.shared.judgements import failed_steps


@dataclass
class Setup:
    lens: str = "105 mm"
    serial: int | None = None
    camera_model: str = ""


@dataclass
class Header:
    count: int = 3
    frame_rate: float = 4000.0
    offsets: np.ndarray = field(default_factory=lambda: np.arange(3))
    setup: Setup = field(default_factory=Setup)


class Film:
    """Three frames of 1300 columns, the second one damaged."""

    shape = (3, 2, 1300)
    levels = (100.0, 300.0)
    time = np.array([0.0, 0.25, 0.5])
    valid = np.array([True, False, True])
    header = Header()

    def __getitem__(self, index):
        return np.full((2, 1300), 100 * (index + 1), dtype=np.uint16)


def test_frames_are_reduced_to_the_page_and_to_eight_bit():
    found = key_frames(Film(), [0, 1, 2])
    assert found["frame"].values.tolist() == [0, 2]
    assert found["image"].shape == (2, 1, 640)
    assert found["image"].values[:, 0, 0].tolist() == [0, 255]
    assert float(found["reduction"]) == pytest.approx(1300 / 640)
    # without tables, and without what the header leaves open
    assert found.attrs["header"].splitlines() == ["count: 3", "frame rate: 4000.0", "lens: 105 mm"]
    with pytest.raises(InputError, match="all frames selected for display are damaged"):
        key_frames(Film(), [1])


def _film(path: Path, patterns: np.ndarray) -> Path:
    phantom.write(
        path, iter(patterns), patterns.shape, np.arange(len(patterns)) * 1e-4, phantom.Recording(10_000, 2e-6)
    )
    return path


def _smooth(rows: int = 40, columns: int = 200) -> np.ndarray:
    """Three images of rings with noise, as a camera sees them."""
    y, x = np.mgrid[:rows, :columns]
    rings = 120 + 60 * np.cos(2e-3 * ((x - 90) ** 2 + (y - 15) ** 2))
    return (rings + np.random.default_rng(1).normal(0, 2, (3, rows, columns))).round().astype(np.uint8)


def _exchange(path: Path, *, is_whole: bool) -> None:
    """Exchange width and height where the images are described; where settings are too if all are."""
    data = bytearray(path.read_bytes())
    (bitmap, setup) = struct.unpack_from("<II", data, 24)
    for layout, at in (("<ii", bitmap + 4), ("<HH", setup + 737), ("<II", setup + 1588))[: 3 if is_whole else 1]:
        struct.pack_into(layout, data, at, *reversed(struct.unpack_from(layout, data, at)))
    path.write_bytes(data)


@pytest.mark.parametrize("is_whole", [False, True])
def test_exchanged_width_and_height_are_told(tmp_path, *, is_whole):
    path = _film(tmp_path / "a.cine", _smooth())
    assert open_film(path).shape == (3, 40, 200)
    _exchange(path, is_whole=is_whole)
    with pytest.raises(LabpipeError, match="width and height are exchanged") as error:
        open_film(path)
    failed = Failed("radius", None, str(error.value), reason=error.value.reason)
    context = Context("film", "contact_area", "", "", "", False, failures=(failed,))
    (told,) = failed_steps(context, CAUSES | {"radius": "the record is of another view"})
    assert told.cause.startswith("width and height are exchanged in the header")


def test_a_step_that_fails_over_a_film_that_broke_off_is_told_so():
    warned = Warned("track", None, "IncompleteFilmWarning", "f.avi: 9 frames are declared, 4 can be read", 1)
    context = Context("film", "dic_validation", "", "", "", True, warnings=(warned,))
    whole = whole_film(context, "film/f.avi")
    assert (whole.level, whole.message) == ("note", "film/f.avi: 9 frames are declared, 4 can be read")
    failed = stated("step bounces", "no bounce found", "impossible", cause="the film shows no drop")
    assert explained(failed, whole).cause.startswith("the film was not copied whole")
    assert explained(failed, whole_film(replace(context, warnings=()), "film/f.avi")).cause == "the film shows no drop"


def test_frames_that_come_twice_are_found(tmp_path):
    images = np.concatenate([_smooth(), _smooth()])
    images += np.random.default_rng(3).integers(0, 4, images.shape).astype(images.dtype)
    images[[2, 5]] = images[[1, 4]]
    assert repeated(instruments.read(_film(tmp_path / "a.cine", images)), np.ones(6, bool)) == [2, 5]


def test_a_strip_of_a_film_fits_its_page_and_keeps_the_frame_that_is_shown_first() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (480, 640, 3), np.uint8)
    for n in (5, 60):
        drawn = [(np.roll(noise, i, 0), f"frame {i}", f"frame {i}", float(i)) for i in range(n)]
        gallery = strip("Film", drawn, start=3, group="film")
        assert sum(len(frame.address) for frame in gallery.frames) <= 1_500_000
        assert gallery.frames[gallery.start].at == 3.0
    flat = [(np.zeros((48, 64, 3), np.uint8), "a", "b", float(i)) for i in range(60)]
    assert len(strip("Film", flat).frames) == 60


def test_key_frames_are_always_among_those_of_a_strip() -> None:
    assert thinned(range(1000), [0, 501, 999]) == sorted({*thinned(range(1000), [0, 501, 999]), 0, 501, 999})
    assert len(thinned(range(1000), [0, 501, 999])) == 60
    assert thinned([4, 5], [1]) == [1, 4, 5]

"""Films in experiments: the frames of a page."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from labpipe.errors import InputError
from pipelines.experiments.shared.film_frames import key_frames, strip


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


def test_a_strip_of_a_film_fits_its_page_and_keeps_the_frame_that_is_shown_first() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (480, 640, 3), np.uint8)
    for n in (5, 60):
        drawn = [(np.roll(noise, i, 0), f"frame {i}", f"frame {i}", float(i)) for i in range(n)]
        gallery = strip("Film", drawn, start=3, group="film")
        assert sum(len(frame.address) for frame in gallery.frames) <= 1_500_000
        assert gallery.frames[gallery.start].at == 3.0
    flat = [(np.zeros((48, 64, 3), np.uint8), "a", "b", float(i)) for i in range(60)]
    assert len(strip("Film", flat).frames) == 60

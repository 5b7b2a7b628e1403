"""Key frames: what a page shows of a film."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from labpipe.errors import InputError
from pipelines.experiments.shared.film_frames import key_frames


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


def test_the_header_is_listed_without_tables_and_without_what_it_leaves_open():
    lines = key_frames(Film(), [0]).attrs["header"].splitlines()
    assert lines == ["count: 3", "frame rate: 4000.0", "lens: 105 mm"]


def test_damaged_frames_alone_are_refused():
    with pytest.raises(InputError, match="all frames selected for display are damaged"):
        key_frames(Film(), [1])

"""Mistakes of a laboratory with a film of a falling holder are noticed and named.

A film is long to follow, so the edits are made on what is measured in its frames.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr

from labpipe import contact, materials
from labpipe.judging import Judgement
from tests.mistakes.rows import misspelt
from tests.pipelines.experiments.dic_validation.test_checks import RATE, fallen, judged, laser, recorded, tracked

pytestmark = pytest.mark.filterwarnings(
    "ignore:the record ends before the body is at rest", "ignore:the body was already falling when the record began"
)
__all__ = ["fallen", "laser"]  # fixtures of the checks' own tests

Film = tuple[xr.Dataset, xr.Dataset]
"""What the stages ``motion`` and ``track`` give."""


@dataclass(frozen=True, slots=True)
class FrontMistake:
    """What is measured of an edited film, and what must be said."""

    name: str
    level: str
    words: tuple[str, ...]
    film: Callable[[xr.Dataset], Film]


def _filmed(scale: float = 1.0, rate: float = RATE) -> Callable[[xr.Dataset], Film]:
    return lambda fallen: (recorded(fallen, 7, scale=scale, rate=rate), tracked())


def _turned(fallen: xr.Dataset) -> Film:
    motion = recorded(fallen, 7)
    return motion.assign(direction=motion["direction"] + 0.5 * np.pi), tracked()


def _without(lost: Callable[[np.ndarray, int], np.ndarray]) -> Callable[[xr.Dataset], Film]:
    """Leave frames out, by their numbers and that of the first impact, and give the others new times."""

    def film(fallen: xr.Dataset) -> Film:
        motion = recorded(fallen, 7)
        numbers, first = np.arange(motion.sizes["time"]), int(np.argmin(motion["displacement"].values))
        left = motion.isel(time=~lost(numbers, first))
        return left.assign_coords(time=motion["time"][: left.sizes["time"]]).assign_attrs(motion.attrs), tracked()

    return film


def _flickers(fallen: xr.Dataset) -> Film:
    track = tracked()
    track["contrast"][::25] *= 0.2
    return recorded(fallen, 7), track


def _creeping(fallen: xr.Dataset) -> Film:
    motion = recorded(fallen, 7)
    motion["displacement"].values += 6 * float(motion["pixel_size"]) * np.linspace(0.0, 1.0, motion.sizes["time"])
    return motion, tracked()


def _of(height: float) -> Callable[[xr.Dataset], Film]:
    def film(fallen: xr.Dataset) -> Film:
        del fallen
        times = np.arange(0.0, 0.16, 1 / RATE)
        other = contact.drop(materials.load("ptfe"), 9.525e-3, 0.505, height, 0.16, times=times)
        return recorded(other, 7), tracked()

    return film


ROWS = (
    FrontMistake("scale one half", "impossible", ("too small by a factor of 2",), _filmed(scale=0.5)),
    FrontMistake("frame rate twice", "impossible", ("the frame rate is 2 times the true one",), _filmed(rate=2 * RATE)),
    FrontMistake("camera upside down", "impossible", ("upside down",), _filmed(scale=-1.0)),
    FrontMistake("camera on its side", "doubtful", ("to the image's columns", "turned"), _turned),
    FrontMistake("film of a drop from 10 mm", "impossible", ("a height 1.4", "film or laser_experiment"), _of(10e-3)),
    FrontMistake("camera creeps", "doubtful", ("creeps up", "470 µm if it goes on", "fasten it"), _creeping),
    FrontMistake("film of a drop from 6.5 mm", "doubtful", ("a height 0.93", "film or laser_experiment"), _of(6.5e-3)),
    FrontMistake("lamp flickers", "yes", ("of the usual light", "flickers"), _flickers),
    FrontMistake(
        "every fifth frame lost, times renewed",
        "impossible",
        ("the frame rate is",),
        _without(lambda numbers, _: numbers % 5 == 4),
    ),
    FrontMistake(
        "begins after the first impact",
        "impossible",
        ("moves up by", "begins too late, after an impact"),
        _without(lambda numbers, first: numbers < first + 6),
    ),
    FrontMistake(
        "begins in the fall",
        "yes",
        ("moves down by", "begins too late, after the release"),
        _without(lambda numbers, first: numbers < first - 20),
    ),
)


@pytest.mark.parametrize("mistake", ROWS, ids=lambda row: row.name)
def test_mistake_is_noticed_and_named(fallen: xr.Dataset, laser: xr.Dataset, mistake: FrontMistake) -> None:
    motion, track = mistake.film(fallen)
    found: Judgement = judged(motion, laser, track=track)[0]
    said = " ".join(f"{f.message} {f.cause}" for f in found.findings)
    assert found.believable == mistake.level, said
    assert [word for word in mistake.words if word not in said] == [], said
    assert misspelt(said) == []

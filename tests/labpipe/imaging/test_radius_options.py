"""Arguments of the contact radius: the ends of a range belong to it, what lies beyond does not."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.frames import ArrayFrames
from labpipe.imaging.fringes._arguments import FilmOptions, check_film, exposure_times

OPTIONS = FilmOptions(pixel_size=1e-5, sphere_radius=1e-2, wavelength=532e-9)
FILM = ArrayFrames(np.zeros((3, 16, 16), np.uint8), np.arange(3.0))
RANGES = {
    "pixel_size": (1e-9, 1e-3),
    "sphere_radius": (1e-6, 10.0),
    "wavelength": (100e-9, 20e-6),
    "fringes": (0.5, 20.0),
}


@pytest.mark.parametrize("name", RANGES)
def test_both_ends_are_allowed_and_nothing_beyond(name: str) -> None:
    low, high = RANGES[name]
    for value in (low, high):
        check_film(FILM, replace(OPTIONS, **{name: value}))
    for value in (0.999 * low, 1.001 * high, nan, -low):
        with pytest.raises(InputError, match=name):
            check_film(FILM, replace(OPTIONS, **{name: value}))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"shape": "square"}, "shape must be"),
        ({"phase": inf}, "phase must be a finite angle"),
        ({"exposure": -1e-9}, "not negative"),
        ({"exposure": np.zeros(2)}, r"one per frame \(3\)"),
        ({"exposure": nan}, "exposure must be"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, object], match: str) -> None:
    with pytest.raises(InputError, match=match):
        check_film(FILM, replace(OPTIONS, **changes))


def test_frames_must_be_sixteen_pixels_wide_and_there_must_be_one() -> None:
    check_film(FILM, OPTIONS)
    for shape, match in (((3, 15, 16), "16 x 16"), ((0, 16, 16), "no frames")):
        film = ArrayFrames(np.zeros(shape, np.uint8), np.arange(float(shape[0])))
        with pytest.raises(InputError, match=match):
            check_film(film, OPTIONS)


def test_exposures_are_one_per_frame() -> None:
    assert exposure_times(FILM, OPTIONS) is None
    one = exposure_times(FILM, replace(OPTIONS, exposure=2e-6))
    assert one is not None
    assert one.tolist() == [2e-6] * 3
    check_film(FILM, replace(OPTIONS, exposure=0.0))

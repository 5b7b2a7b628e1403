"""The reflection of a lamp that stands still in a film: the light that it adds around what it clips."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.frames import FrameSource, ShownFrames

#: Frames that are asked what stands still; width (px) below which what is clipped is a stuck pixel or a stroke of
#: writing; pixels that a reflection clips at least, and share of the frame at most.
_FRAMES, _STROKE, _LEAST, _MOST = 8, 5, 30, 0.1
#: Distance up to which the light is looked at, in radii of a disc as large as what every frame clips; and share of
#: all that is clipped farther away than one radius up to which a film is not overexposed.
_REACH, _ELSEWHERE = 6.0, 0.15
#: Share of the pixels at a distance that are no brighter than the dark fringes there.
_DARK = 0.1


class UnreflectedFrames(ShownFrames):
    """A film from which light (row, column) [grey levels] is taken off where a pixel is not clipped."""

    def __init__(self, film: FrameSource, light: NDArray[np.integer]) -> None:
        self._film, self._light = film, light
        self.time, self.exposure, self.shape, self.valid = film.time, film.exposure, film.shape, film.valid
        self.levels = film.levels

    def __getitem__(self, index: int) -> NDArray[np.integer]:
        """Return one frame."""
        image = self._film[index]
        black, white = self.levels
        less = np.maximum(image.astype(np.int64) - self._light, int(black))
        return np.where(image >= white, image, less).astype(image.dtype)

    def roi(self, rows: slice, columns: slice) -> "UnreflectedFrames":
        """Return a view of a rectangle."""
        return UnreflectedFrames(self._film.roi(rows, columns), self._light[rows, columns])


def without_reflection(
    film: FrameSource, wanted: Flags, read: Callable[[int], NDArray[Any]]
) -> tuple[FrameSource, int]:
    """Take off the light around pixels that are clipped in every frame; the same film, and 0, when there are none.

    ``wanted``: frames that may be read; ``read``: returns the frame of an index. Also how many pixels stay clipped.

    Notes
    -----
    The darkest that is seen at a distance from what is clipped are dark fringes, or a dark contact, and what the
    reflection adds to them: it falls outwards, and ends where that is least.
    """
    import cv2

    sound = np.flatnonzero(np.asarray(film.valid, bool) & wanted)
    chosen = sound[np.unique(np.linspace(0, len(sound) - 1, _FRAMES).astype(int))].tolist() if len(sound) else []
    white = film.levels[1]
    clipped, darkest = np.zeros(film.shape[1:], int), np.full(film.shape[1:], np.inf)
    for index in chosen:
        image = read(index)
        if image.dtype.kind not in "iu" or image.shape != clipped.shape or not (image >= white).any():
            return film, 0
        clipped += image >= white
        darkest = np.minimum(darkest, image)
    square = np.ones((_STROKE, _STROKE), np.uint8)
    always = cv2.morphologyEx((clipped == len(chosen)).astype(np.uint8), cv2.MORPH_OPEN, square) > 0
    count = int(always.sum())
    if not chosen or not _LEAST <= count <= _MOST * always.size:
        return film, 0
    distance = cv2.distanceTransform((~always).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    radius = math.sqrt(count / math.pi)
    if clipped[distance > radius].sum() > _ELSEWHERE * clipped.sum():
        return film, 0
    profile = _darkest_at(distance, darkest, _REACH * radius)
    added = np.interp(distance, np.arange(len(profile)) + 1.0, profile, right=0.0)
    return UnreflectedFrames(film, np.rint(np.where(always, 0.0, added)).astype(np.int64)), count


def _darkest_at(distance: NDArray[Any], darkest: Floats, reach: float) -> Floats:
    """Tell by how much the dark is lighter than at its darkest farther out, at every whole px of distance."""
    place = np.rint(distance).astype(int)
    found = [np.quantile(darkest[place == k], _DARK) for k in range(1, math.ceil(reach)) if (place == k).any()]
    falling = np.minimum.accumulate(found)
    return np.asarray(falling - falling[-1])

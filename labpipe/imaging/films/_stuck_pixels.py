"""Hot and dead pixels of a sensor: bright or dark whatever is before them.

They do not move with the specimen and would bind a correlation, or a ring of fringes, to the sensor. A lens spreads
every point of a scene over neighbours, and what moves is seen by other pixels soon after: a pixel is stuck when it
stands out from its neighbours by about as much in all frames, while its surroundings change.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers
from labpipe.frames import FrameSource, ShownFrames

#: Frames that are compared, spread over the film.
_FRAMES = 8
#: Standard deviations of noise by which a stuck pixel stands out, and by which its surroundings change and it does not.
_STANDS_OUT, _CHANGES = 8.0, 4.0
#: Share of its height by which the level of a stuck pixel may change; share of the pixels that stand out as far.
_SAME, _MOST = 0.5, 0.7


class RepairedFrames(ShownFrames):
    """A film in which some pixels are interpolated from those around them.

    Parameters
    ----------
    film : FrameSource
        The film as recorded.
    stuck : bool array (row, column)
        Pixels that do not count.
    """

    def __init__(self, film: FrameSource, stuck: Flags) -> None:
        self._film, self.stuck = film, stuck
        self.time, self.exposure, self.shape = film.time, film.exposure, film.shape
        self.valid, self.levels = film.valid, film.levels
        # pixels (flat index) to be repaired, those (pixel, source) that repair them, and their bell-shaped weights
        rows, columns = stuck.shape
        y, x = np.nonzero(stuck)
        steps = np.arange(-2, 3)
        down, across = np.repeat(steps, 5), np.tile(steps, 5)
        at_y, at_x = y[:, None] + down, x[:, None] + across
        is_inside = (at_y >= 0) & (at_y < rows) & (at_x >= 0) & (at_x < columns)
        at_y, at_x = np.clip(at_y, 0, rows - 1), np.clip(at_x, 0, columns - 1)
        weight = np.exp(-0.8 * (down**2 + across**2)) * (is_inside & ~stuck[at_y, at_x])
        self._weight: Floats = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
        self._target: Integers = y * columns + x
        self._source: Integers = at_y * columns + at_x

    def __getitem__(self, index: int) -> NDArray[np.integer]:
        """Return one frame, repaired."""
        image = np.array(self._film[index])
        grey = image.reshape(-1)
        found = np.einsum("pk,pk->p", grey[self._source], self._weight)
        grey[self._target] = np.rint(found) if image.dtype.kind in "iu" else found
        return image

    def roi(self, rows: slice, columns: slice) -> FrameSource:
        """Return a view of a rectangle."""
        part, stuck = self._film.roi(rows, columns), self.stuck[rows, columns]
        return RepairedFrames(part, stuck) if stuck.any() else part


@dataclass(frozen=True)
class StuckPixels:
    """Number of pixels that are repaired, and of frames that were read to find them."""

    count: int = 0
    frames_read: int = 0

    @property
    def note(self) -> str:
        """Sentence for a reader; empty when there are none."""
        if not self.count:
            return ""
        some = "1 pixel that does" if self.count == 1 else f"{self.count} pixels that do"
        return f"{some} not follow the scene (stuck, or dust on the sensor) interpolated from the neighbours"


def without_stuck_pixels(
    film: FrameSource, wanted: Flags | None = None, read: Callable[[int], NDArray[np.generic]] | None = None
) -> tuple[FrameSource, StuckPixels]:
    """Repair the pixels of a film that are stuck; the same film when there are none.

    While nothing moves, nothing can be decided, and nothing is harmed.

    Parameters
    ----------
    film : FrameSource
        Grey images.
    wanted : bool array (frame,), optional
        Frames that may be read; by default all.
    read : callable, optional
        Returns the frame of an index; by default the film's own.
    """
    import cv2

    sound = np.flatnonzero(np.asarray(film.valid, bool) & (True if wanted is None else wanted))
    if len(sound) < 2:
        return film, StuckPixels()
    chosen = sound[np.unique(np.linspace(0, len(sound) - 1, _FRAMES).round().astype(int))].tolist()
    for number, index in enumerate(chosen):
        image = np.asarray((read or film.__getitem__)(index))
        if image.ndim != 2 or min(image.shape) < 8 or image.dtype.kind not in "iuf":
            return film, StuckPixels(0, number + 1)
        grey = np.ascontiguousarray(image if image.dtype in (np.uint8, np.uint16) else image.astype(np.float32))
        median = cv2.medianBlur(grey, 3)
        if number == 0:
            difference = cv2.subtract(grey, median, dtype=cv2.CV_32F)
            # where the frame is quietest the mean of its absolute value is 0.88 of the noise of a pixel
            quiet = cv2.blur(np.abs(difference), (12, 12))
            noise = max(float(np.percentile(quiet[::3, ::3], 3.0)) / 0.88, 0.5 if image.dtype.kind in "iu" else 0.0)
            difference = np.abs(difference.reshape(-1))
            least = max(_STANDS_OUT * noise, float(np.percentile(difference[::7], 97.0)))
            stuck = np.flatnonzero(difference > least)
        middle = median.reshape(-1)[stuck].astype(np.float32)
        rest = grey.reshape(-1)[stuck].astype(np.float32) - middle
        if number == 0:
            first, around, heights = rest, middle, np.abs(rest)
            changes = np.zeros(len(stuck), bool)
        if not len(stuck):
            break
        # the level stays, or sign and height do where the pixel adds to the light
        level = np.abs(rest + middle - first - around)
        stands = (rest * first > 0.0) & (np.abs(rest) > _STANDS_OUT * noise)
        keeps = (level < _CHANGES * noise) | (stands & (level < _SAME * np.abs(first)))
        changes |= np.abs(middle - around) > _CHANGES * noise
        stuck, first, around, changes = stuck[keeps], first[keeps], around[keeps], changes[keeps]
    stuck, height = stuck[changes], np.abs(first[changes])
    # Of a fine scene some pixels keep their level by chance: of those that stand out as far, most must be stuck.
    height, order = -np.sort(-height), np.argsort(-height)
    standing = len(heights) - np.searchsorted(np.sort(heights), height)
    enough = np.flatnonzero(np.arange(1, len(height) + 1) > _MOST * standing)
    stuck = stuck[order[: enough[-1] + 1]] if len(enough) else stuck[:0]
    if not len(stuck):
        return film, StuckPixels(0, number + 1)
    mask = np.zeros(film.shape[1] * film.shape[2], bool)
    mask[stuck] = True
    return RepairedFrames(film, mask.reshape(film.shape[1:])), StuckPixels(len(stuck), len(chosen))

"""Pixels of the sensor that do not follow the scene: bright or dark whatever is before them.

They stand still while the specimen moves and would bind a correlation, or a ring of fringes, to the
sensor. One frame tells which pixels stick out from their neighbours as no lens draws them; others,
in which the scene around them has moved on, tell which of these still do.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers
from labpipe.frames import FrameSource, ShownFrames

#: Standard deviations of noise, and share of the contrast of the frame, by which a pixel sticks out.
_STANDS_OUT, _CONTRAST = 8.0, 0.1
#: The share of the pixels of a scene that stick out most, and the multiple of their height from which
#: a pixel sticks out as no scene does.
_TOPS, _BEYOND_TOPS = 3.0, 3.0
#: Share of the pixels above which those that are not strange are a scene as fine as the pixels.
_MOST = 0.05
#: Frames that are asked whether a pixel is stuck, and pixels sampled for the noise of a frame.
_FRAMES, _SAMPLED = 8, 20_000
#: Half width (px) of the neighbourhood that tells whether the scene has moved on, and by how many of
#: its pixels (px): a finest spot that goes so far loses more of its light than a steady pixel may.
_AROUND, _MOVED, _MOVED_LITTLE = 3, 0.7, 0.3
#: Share of its height above the neighbours by which the level of a stuck pixel may change, and the
#: height of one that adds to its light; share and standard deviations of noise for a steady one.
_SAME, _SAME_HEIGHT, _STEADY, _STEADY_NOISE = 0.15, 0.3, 0.04, 4.0
#: Share of its height by which a stuck pixel must stand out in another frame at least once.
_STILL_OUT = 0.5
#: Median of the distances of noise from the median of three by three pixels, over its deviation.
_MEDIAN_OF_REST = 0.76
#: Weights of the next and the second next pixel on both sides in a cubic through four.
_NEXT, _SECOND = 4.0 / 6.0, -1.0 / 6.0
#: Reach (px) and width of the mean that repairs a pixel beside others that are stuck.
_REACH, _WIDTH = 3, 0.8
#: Share of the pixels that stick out by a height from which those that keep their level are faults.
_MOST_OF_THEM = 0.7
#: Least noise of counts (grey levels).
_ROUNDING = 0.5


class RepairedFrames(ShownFrames):
    """A film in which some pixels are interpolated from those around them.

    ``film``: The film as recorded. ``stuck``: Pixels that do not count.
    """

    def __init__(self, film: FrameSource, stuck: Flags) -> None:
        self._film = film
        self.stuck = stuck
        self._target, self._source, self._weight = _interpolation(stuck)

    @property
    def time(self) -> Floats:
        """Time of every frame in s."""
        return self._film.time

    @property
    def exposure(self) -> Floats | None:
        """Exposure time of every frame in s, or None."""
        return self._film.exposure

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of frames, rows, columns."""
        return self._film.shape

    @property
    def valid(self) -> Flags:
        """False for frames that the file damaged."""
        return self._film.valid

    @property
    def levels(self) -> tuple[float, float]:
        """Black and white level."""
        return self._film.levels

    def __getitem__(self, index: int) -> NDArray[np.integer]:
        """Return one frame, repaired."""
        image = np.array(self._film[index])
        grey = image.reshape(-1)
        found = np.einsum("pk,pk->p", grey[self._source], self._weight)
        if image.dtype.kind in "iu":
            whole = np.iinfo(str(image.dtype))
            found = np.clip(np.rint(found), whole.min, whole.max)
        grey[self._target] = found
        return image

    def roi(self, rows: slice, columns: slice) -> FrameSource:
        """Return a view of a rectangle."""
        part = self._film.roi(rows, columns)
        stuck = self.stuck[rows, columns]
        return RepairedFrames(part, stuck) if stuck.any() else part


@dataclass(frozen=True)
class StuckPixels:
    """What was found of them.

    ``count``: Pixels that are repaired. ``frames_read``: Frames that were read to find out.
    """

    count: int = 0
    frames_read: int = 0

    @property
    def note(self) -> str:
        """What a reader must know; empty when there are none."""
        if not self.count:
            return ""
        some = "1 pixel that does" if self.count == 1 else f"{self.count} pixels that do"
        return f"{some} not follow the scene (stuck, or dust on the sensor) interpolated from the neighbours"


def without_stuck_pixels(
    film: FrameSource, wanted: Flags | None = None, read: Callable[[int], NDArray[np.generic]] | None = None
) -> tuple[FrameSource, StuckPixels]:
    """Repair the pixels of a film that are stuck; the same film when there are none.

    ``film``: Grey images. ``wanted``: Frames that may be read; by default all. ``read``: Returns the frame of an
    index, by default the film's own.

    Notes
    -----
    A lens spreads every point of a scene over neighbours, and what moves is seen by other pixels
    soon after. A pixel is stuck when it sticks out from its neighbours in one frame, and does so by
    the same in all frames in which what surrounds it has moved by most of a pixel. While nothing has
    moved, nothing can tell, and nothing is harmed.
    """
    sound = np.flatnonzero(np.asarray(film.valid, bool) & (True if wanted is None else wanted))
    read = film.__getitem__ if read is None else read
    if len(sound) < 2:
        return film, StuckPixels()
    first = np.array(read(int(sound[0])))
    candidates, height, noise, strange = _standing_out(first)
    sure = height > strange
    if not sure.any():
        return film, StuckPixels(0, 1)
    chosen = sound[np.unique(np.linspace(1, len(sound) - 1, _FRAMES).round().astype(int))]
    others = [np.array(read(int(index))) for index in chosen]
    stuck = np.zeros(len(candidates), bool)
    stuck[sure] = _do_not_follow(candidates, candidates[sure], height[sure], noise, strange, first, others)
    # Where there are some, lesser ones are looked for as well.
    if stuck.any() and not sure.all():
        stuck |= _do_not_follow(candidates, candidates, height, noise, strange, first, others)
    if not stuck.any():
        return film, StuckPixels(0, 1 + len(chosen))
    mask = np.zeros(first.size, bool)
    mask[candidates[stuck]] = True
    return RepairedFrames(film, mask.reshape(first.shape)), StuckPixels(int(stuck.sum()), 1 + len(chosen))


def _standing_out(image: NDArray[np.generic]) -> tuple[Integers, Floats, float, float]:
    """Pixels (flat index) that differ from the median about them, by how much, noise, and what is strange."""
    import cv2

    if image.ndim != 2 or min(image.shape) <= 2 * _AROUND or image.dtype.kind not in "iuf":
        return np.zeros(0, np.int64), np.zeros(0), 0.0, 0.0
    grey = np.ascontiguousarray(image if image.dtype in (np.uint8, np.uint16) else image.astype(np.float32))
    rest = cv2.absdiff(grey, cv2.medianBlur(grey, 3)).reshape(-1)
    step = max(1, rest.size // _SAMPLED)
    middle, tops = np.percentile(rest[::step], (50.0, 100.0 - _TOPS))
    noise = max(float(middle) / _MEDIAN_OF_REST, _ROUNDING if grey.dtype.kind == "u" else 0.0)
    low, high = np.percentile(grey.reshape(-1)[::step], (1.0, 99.0))
    least = max(_STANDS_OUT * noise, _CONTRAST * float(high - low))
    found = np.flatnonzero(rest > least)
    if len(found) > _MOST * image.size:
        found = found[rest[found] > _BEYOND_TOPS * tops]
    return found, rest[found].astype(np.float64), noise, max(least, _BEYOND_TOPS * float(tops))


def _do_not_follow(
    candidates: Integers,
    asked: Integers,
    height: Floats,
    noise: float,
    strange: float,
    first: NDArray[np.generic],
    others: list[NDArray[np.generic]],
) -> Flags:
    """Tell which pixels keep their level in all frames in which what surrounds them has moved."""
    rows, columns = first.shape
    steps = np.arange(-_AROUND, _AROUND + 1)
    y = np.clip(asked[:, None] // columns + np.repeat(steps, len(steps)), 0, rows - 1)
    x = np.clip(asked[:, None] % columns + np.tile(steps, len(steps)), 0, columns - 2)
    around = y * columns + x
    is_sound = np.ones(first.size, bool)
    is_sound[candidates] = False
    counts = is_sound[around]
    before = first.reshape(-1)[around].astype(np.float64)
    beside = first.reshape(-1)[around + 1].astype(np.float64)
    slope = _mean((beside - before) ** 2, counts & is_sound[around + 1])
    middle = around.shape[1] // 2
    inner = np.flatnonzero((np.abs(np.repeat(steps, len(steps))) <= 1) & (np.abs(np.tile(steps, len(steps))) <= 1))
    raised = before[:, middle] - np.median(before[:, inner], axis=1)
    is_strange = height > strange
    has_moved, has_changed, stands_out = np.zeros((3, len(asked)), bool)
    for other in others:
        now = other.reshape(-1)[around].astype(np.float64)
        square = _mean((now - before) ** 2, counts)
        change = np.abs(now[:, middle] - before[:, middle])
        stands = now[:, middle] - np.median(now[:, inner], axis=1)
        by_height = np.abs(stands - raised)
        is_steady = change <= np.maximum(_STEADY_NOISE * noise, _STEADY * height)
        is_same = is_steady | (change <= _SAME * height) | (by_height <= _SAME_HEIGHT * height)
        far, little = (square > step**2 * slope for step in (_MOVED, _MOVED_LITTLE))
        tells = far | (little & is_steady & is_strange)
        has_moved |= tells
        stands_out |= tells & (np.abs(stands) > _STILL_OUT * height)
        has_changed |= (far & ~is_same) | (little & ~is_steady & (by_height > _SAME_HEIGHT * height))
    # One that has come to lie inside a larger feature keeps its level too, but stands out no more.
    stuck = has_moved & ~has_changed & stands_out
    # Of a fine scene some keep their level by chance: of those that stick out as far, most must.
    order = np.argsort(-height)
    order = order[has_moved[order]]
    share = np.cumsum(stuck[order]) / np.arange(1, len(order) + 1)
    enough = np.flatnonzero(share >= _MOST_OF_THEM)
    least = height[order[enough[-1]]] if len(enough) else np.inf
    return stuck & (height >= least)


def _mean(values: Floats, counts: Flags) -> Floats:
    """Mean of each row over what counts; 0 where nothing does."""
    return np.asarray((values * counts).sum(axis=1) / np.maximum(counts.sum(axis=1), 1))


def _interpolation(stuck: Flags) -> tuple[Integers, Integers, Floats]:
    """Pixels (flat index) to be repaired, those (pixel, source) that repair them, and their weights.

    A cubic through four pixels along the row, one along the column, or their mean, as far as none of the
    four is stuck or outside; else the weighted mean of what is around.
    """
    rows, columns = stuck.shape
    y, x = np.nonzero(stuck)
    steps = np.arange(-_REACH, _REACH + 1)
    down, across = np.repeat(steps, len(steps)), np.tile(steps, len(steps))
    at_y, at_x = y[:, None] + down, x[:, None] + across
    is_inside = (at_y >= 0) & (at_y < rows) & (at_x >= 0) & (at_x < columns)
    at_y, at_x = np.clip(at_y, 0, rows - 1), np.clip(at_x, 0, columns - 1)
    counts = is_inside & ~stuck[at_y, at_x]
    cubics = []
    for along, aside in ((down, across), (across, down)):
        cubic = np.zeros(len(down))
        cubic[(aside == 0) & (np.abs(along) == 1)] = _NEXT
        cubic[(aside == 0) & (np.abs(along) == 2)] = _SECOND
        cubics.append(cubic * (counts | (cubic == 0.0)).all(axis=1, keepdims=True))
    bell = np.exp(-0.5 * (down**2 + across**2) / _WIDTH**2) * counts
    weight = sum(cubics)
    weight = np.where(weight.any(axis=1, keepdims=True), weight, bell)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
    return y * columns + x, at_y * columns + at_x, weight

"""Read only the rectangle of each frame that the subsets need, and turn it into coefficients."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32
from labpipe.frames import FrameSource
from labpipe.imaging.dic._solver import OVERHANG
from labpipe.imaging.dic._spline import HORIZON, prefilter

#: Rectangles start and end at multiples of this (px), so that they change seldom.
_GRID = 32
#: Room around the foreseen subsets (px): the difference between two frames of a fast bounce.
_SLACK = 8

Box = tuple[int, int, int, int]


@dataclass(frozen=True)
class Loaded:
    """Coefficients of a rectangle of one frame.

    Attributes
    ----------
    box : (left, right, top, bottom) [px]
        The rectangle; right and bottom are the first column and row outside.
    window : (left, right, top, bottom) [px]
        Where interpolation is exact: away from cut edges, up to the border of the frame.
    coefficients : float32 array or None
        From :func:`.prefilter`; None when the frame holds NaN.
    """

    box: Box
    window: tuple[float, float, float, float]
    coefficients: Floats32 | None


def smooth(image: NDArray[np.generic], blur: float, out: Floats32 | None = None) -> Floats32:
    """Convert to float32 and blur by a Gaussian of standard deviation ``blur`` (px).

    Parameters
    ----------
    image : array (row, column)
        Grey levels.
    blur : float [px]
        0 for none.
    out : float32 array (row, column), optional
        To be filled instead of a new one: fresh memory costs more than the blur itself.
    """
    if out is None or out.shape != image.shape:
        out = np.empty(image.shape, np.float32)
    if blur <= 0.0:
        np.copyto(out, image, casting="unsafe")
        return out
    import cv2

    kernel = cv2.getGaussianKernel(2 * int(np.ceil(4.0 * blur)) + 1, blur, cv2.CV_32F)
    pixels = np.ascontiguousarray(image, image.dtype if image.dtype == np.uint8 else np.float32)
    cv2.sepFilter2D(pixels, cv2.CV_32F, kernel, kernel, out, borderType=cv2.BORDER_REFLECT_101)
    return out


class FilmWindow:
    """The part of a film that is looked at; counts what it reads.

    Parameters
    ----------
    frames : FrameSource
        The film.
    order : 3 or 5
        Spline order.
    blur : float [px]
        Gaussian blur before the prefilter; 0 for none.
    """

    def __init__(self, frames: FrameSource, order: int, blur: float) -> None:
        self._frames = frames
        self._order = order
        self._blur = blur
        _, self._rows, self._columns = frames.shape
        self._box: Box | None = None
        self._part = frames
        self._coefficients: Floats32 | None = None
        self._grey: Floats32 | None = None
        self.frames_read = 0
        self.pixels_read = 0

    @property
    def whole(self) -> Box:
        """The rectangle of a whole frame."""
        return (0, self._columns, 0, self._rows)

    def box_around(self, corners: Floats) -> Box:
        """Rectangle that holds the given (left, right, top, bottom) with all margins."""
        margin = HORIZON + _SLACK + 4.0 * self._blur
        low = [max(0, int((value - margin) // _GRID) * _GRID) for value in corners[[0, 2]]]
        high = [
            min(size, -int(-(value + margin + 1) // _GRID) * _GRID)
            for value, size in zip(corners[[1, 3]], (self._columns, self._rows), strict=True)
        ]
        # A motion that has left the frame must not ask for an empty rectangle.
        if high[0] - low[0] < _GRID or high[1] - low[1] < _GRID:
            return self.whole
        return (low[0], high[0], low[1], high[1])

    def load(self, index: int, box: Box) -> Loaded:
        """Read a rectangle of a frame; the result is valid until the next call."""
        if box != self._box:
            left, right, top, bottom = box
            is_whole = box == self.whole
            self._part = self._frames if is_whole else self._frames.roi(slice(top, bottom), slice(left, right))
            self._box = box
        image = self._part[index]
        self.frames_read += 1
        self.pixels_read += image.size
        self._grey = grey = smooth(image, self._blur, self._grey)
        window = self._exact_window(box)
        if image.dtype.kind == "f" and not np.isfinite(grey).all():
            return Loaded(box, window, None)
        self._coefficients = prefilter(grey, self._order, self._coefficients, overwrite_image=True)
        return Loaded(box, window, self._coefficients)

    def read_whole(self, index: int) -> tuple[Floats32, Loaded]:
        """Read a whole frame outside the alternation of :meth:`load`; grey levels as well."""
        image = self._frames[index]
        self.frames_read += 1
        self.pixels_read += image.size
        grey = smooth(image, self._blur)
        coefficients = prefilter(grey, self._order)
        return grey, Loaded(self.whole, self._exact_window(self.whole), coefficients)

    def _exact_window(self, box: Box) -> tuple[float, float, float, float]:
        """Shrink cut edges by the reach of the recursive filter; let true borders be touched."""
        margin = HORIZON + 4.0 * self._blur
        left, right, top, bottom = box
        return (
            left + margin if left else -OVERHANG,
            right - 1 - margin if right < self._columns else right - 1 + OVERHANG,
            top + margin if top else -OVERHANG,
            bottom - 1 - margin if bottom < self._rows else bottom - 1 + OVERHANG,
        )

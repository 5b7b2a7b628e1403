"""Features of one frame: radial profiles, centres of rings, and whether there is more than noise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._hough_centre import Spot, find_centres, reduce_frame


@dataclass(frozen=True)
class FrameFeatures:
    """A frame (row, column) of grey levels, and its features, each found once."""

    frame: NDArray[np.generic]

    @cached_property
    def has_structure(self) -> bool:
        """Whether there is more in it than noise."""
        small, factor = reduce_frame(self.frame)
        smooth = cv2.GaussianBlur(small, (3, 3), 0.8)
        low, high = np.percentile(smooth, (0.1, 99.9))
        # the noise of a pixel where the frame is quietest, so that fringes do not count
        side = min(12, *self.frame.shape)
        rows, columns = (size // side * side for size in self.frame.shape)
        bands = self.frame[:rows, :columns].reshape(-1, side, columns)
        bands = bands[:: max(1, bands.size // 80_000)]
        steps = np.abs(np.diff(bands.astype(np.float32), axis=1))
        blocks = steps.reshape(len(bands), side - 1, -1, side).swapaxes(1, 2).reshape(-1, side**2 - side)
        # the median of the difference of two normal numbers is 0.954 of the deviation of one
        noise = float(np.percentile(np.median(blocks, axis=1), 3.0)) / 0.954
        return float(high - low) > 8.0 * max(noise, 0.3) / (2.0 * factor)

    @cached_property
    def centres(self) -> Sequence[Spot]:
        """Centres of rings, those with most votes first."""
        return find_centres(self.frame)


def radial_profile(
    frame: NDArray[np.generic], x: float, y: float, width: float, bins: int, axes: tuple[float, float] = (0.0, 0.0)
) -> tuple[Floats, Floats]:
    """Mean grey level and number of pixels in rings of a width (px) around a point, which may lie outside the frame.

    ``axes`` are stretch and shear of ellipses. Of large frames every second row, third row and so on is read.
    """
    from labpipe.imaging.fringes._kernels import radial_sums

    step = max(1, math.floor(math.sqrt(frame.size / 150_000)))
    rows = np.ascontiguousarray(frame[::step], np.float32)
    sums, counts = radial_sums(rows, x, y, float(step), width, bins, *axes)
    return sums / np.maximum(counts, 1.0), counts

"""Find round spots in a frame: candidate contacts, to about a pixel."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats32
from labpipe.errors import InputError
from labpipe.imaging.fringes._circle import fit_circle

#: Shorter side of the reduced image (px): a spot of a twentieth of it is still some pixels wide.
_REDUCED_SIDE = 120
#: Smallest spot in the reduced image (px), and the fewest points of its outline.
_LEAST_AREA, _LEAST_POINTS = 6, 6
#: Spots looked at for one threshold, the largest first.
_SPOTS_PER_LEVEL = 3
#: Grey levels (percentiles) half way between which is a threshold besides Otsu's: small spots.
_LOW_PERCENT, _HIGH_PERCENT = 0.2, 60.0
#: Centres nearer to each other than this (reduced px) are one candidate.
_SAME = 1.0


@dataclass(frozen=True)
class Spot:
    """A circle through the outline of a spot, in px of the full frame; +1 bright, -1 dark."""

    x: float
    y: float
    radius: float
    polarity: int


def reduce_frame(frame: NDArray[np.generic]) -> tuple[Floats32, int]:
    """Average a frame over squares of pixels; return it with the width of the squares."""
    factor = max(1, min(8, min(frame.shape) // _REDUCED_SIDE))
    rows, columns = (size // factor for size in frame.shape)
    cut = frame[: rows * factor, : columns * factor]
    known = cut if cut.dtype in (np.uint8, np.uint16) else cut.astype(np.float32)
    small = cv2.resize(np.asarray(known), (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32), factor


def find_spots(frame: NDArray[np.generic]) -> list[Spot]:
    """Circles through the outlines of dark and bright spots, likely ones first.

    Parameters
    ----------
    frame : array (row, column)
        Grey levels.

    Returns
    -------
    list of Spot
        Empty for a frame without structure. Points of an outline on the border of the frame are
        left out, so that a spot that the frame cuts keeps its circle.
    """
    small, factor = reduce_frame(frame)
    smooth = np.asarray(cv2.GaussianBlur(small, (3, 3), 0.8), np.float32)
    low, high = float(smooth.min()), float(smooth.max())
    if not high > low:
        return []
    spots: list[Spot] = []
    tails = np.percentile(smooth, (_LOW_PERCENT, _HIGH_PERCENT, 100.0 - _HIGH_PERCENT, 100.0 - _LOW_PERCENT))
    for polarity, usual, extreme in ((-1, -tails[1], -tails[0]), (1, tails[2], tails[3])):
        for level in (_otsu(polarity * smooth), 0.5 * float(usual + extreme)):
            mask = (polarity * smooth > level).astype(np.uint8)
            for spot in _spots_of_mask(mask, factor, polarity):
                is_new = all(math.hypot(spot.x - old.x, spot.y - old.y) > _SAME * factor for old in spots)
                if is_new:
                    spots.append(spot)
    return spots


def _otsu(image: Floats32) -> float:
    """Otsu's threshold, above which a spot stands."""
    low, high = float(image.min()), float(image.max())
    scaled = ((image - low) * (255.0 / (high - low))).astype(np.uint8)
    otsu, _ = cv2.threshold(scaled, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return low + (otsu + 0.5) * (high - low) / 255.0


def _spots_of_mask(mask: NDArray[np.uint8], factor: int, polarity: int) -> list[Spot]:
    """Circles around the largest connected parts of a mask."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    order = 1 + np.argsort(-stats[1:count, cv2.CC_STAT_AREA], kind="stable")
    spots = []
    for label in order[:_SPOTS_PER_LEVEL]:
        if stats[label, cv2.CC_STAT_AREA] < _LEAST_AREA:
            break
        left, top, width, height = stats[label, : cv2.CC_STAT_AREA]
        circle = _circle_of(labels[top : top + height, left : left + width] == label, (left, top), mask.shape)
        if circle is not None:
            x, y, radius = circle
            # The centre of the first square of pixels lies (factor - 1) / 2 inside the frame.
            shift = 0.5 * (factor - 1)
            spots.append(Spot(x * factor + shift, y * factor + shift, radius * factor, polarity))
    return spots


def _circle_of(
    part: NDArray[np.bool_], corner: tuple[int, int], shape: tuple[int, ...]
) -> tuple[float, float, float] | None:
    """Circle through the outline of one part, without points on the border of the frame.

    ``part`` begins at a column and a row of a mask of this shape.
    """
    contours, _ = cv2.findContours(part.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=corner)
    outline = np.concatenate([contour[:, 0] for contour in contours]).astype(float)
    rows, columns = shape
    x, y = outline.T
    is_inside = (x > 0) & (x < columns - 1) & (y > 0) & (y < rows - 1)
    if is_inside.sum() < _LEAST_POINTS:
        return None
    try:
        circle = fit_circle(outline[is_inside])
    except InputError:
        return None
    return circle if circle[2] < 2.0 * math.hypot(rows, columns) else None

"""Round spots of a frame, by the outlines of what is darker or brighter than a threshold."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats32
from labpipe.errors import InputError
from labpipe.imaging.fringes._circle import fit_circle


@dataclass(frozen=True)
class Spot:
    """A circle through the outline of a spot, or the steepest ring around a centre, in px of the full frame."""

    x: float
    y: float
    radius: float


def reduce_frame(frame: NDArray[np.generic]) -> tuple[Floats32, int]:
    """Average a frame over squares of pixels to 120 px on its shorter side; return it with the width of the squares."""
    factor = max(1, min(8, min(frame.shape) // 120))
    rows, columns = (size // factor for size in frame.shape)
    cut = frame[: rows * factor, : columns * factor]
    known = cut if cut.dtype in (np.uint8, np.uint16) else cut.astype(np.float32)
    small = cv2.resize(np.asarray(known), (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32), factor


def find_spots(frame: NDArray[np.generic]) -> list[Spot]:
    """Circles through the outlines of dark and bright spots of a frame, likely ones first.

    Points of an outline on the border of the frame are left out, so that a spot that the frame cuts keeps its circle.
    """
    small, factor = reduce_frame(frame)
    smooth = np.asarray(cv2.GaussianBlur(small, (3, 3), 0.8), np.float32)
    spots: list[Spot] = []
    if not float(smooth.max()) > float(smooth.min()):
        return spots
    for polarity in (-1, 1):
        for level in _levels(polarity * smooth):
            mask = (polarity * smooth > level).astype(np.uint8)
            for spot in _spots_of_mask(mask, factor):
                if all(math.hypot(spot.x - old.x, spot.y - old.y) > factor for old in spots):
                    spots.append(spot)
    return spots


def _levels(image: Floats32) -> list[float]:
    """Thresholds above which a spot shows: Otsu's, and half way up to the brightest, for small spots."""
    low, high = float(image.min()), float(image.max())
    scaled = ((image - low) * (255.0 / (high - low))).astype(np.uint8)
    otsu, _ = cv2.threshold(scaled, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    usual, extreme = np.percentile(image, (40.0, 99.8))
    return [low + (otsu + 0.5) * (high - low) / 255.0, 0.5 * float(usual + extreme)]


def _spots_of_mask(mask: NDArray[np.uint8], factor: int) -> list[Spot]:
    """Circles around the three largest connected parts of a mask of the reduced frame."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    order = 1 + np.argsort(-stats[1:count, cv2.CC_STAT_AREA], kind="stable")
    spots = []
    # The centre of the first square of pixels lies (factor - 1) / 2 inside the frame.
    shift = 0.5 * (factor - 1)
    for label in order[:3]:
        circle = _circle_of(labels == label)
        if circle is not None:
            x, y, radius = (factor * value for value in circle)
            spots.append(Spot(x + shift, y + shift, radius))
    return spots


def _circle_of(part: NDArray[np.bool_]) -> tuple[float, float, float] | None:
    """Circle through the outline of one part, without points on the border of the frame."""
    contours, _ = cv2.findContours(part.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = np.concatenate([contour[:, 0] for contour in contours]).astype(float)
    rows, columns = part.shape
    x, y = outline.T
    inside = outline[(x > 0) & (x < columns - 1) & (y > 0) & (y < rows - 1)]
    if len(inside) < 6:
        return None
    try:
        circle = fit_circle(inside)
    except InputError:
        return None
    return circle if circle[2] < 2.0 * math.hypot(rows, columns) else None

"""Common centre of the rings in a frame, or of a disc, by a Hough transform of the directions of its slopes.

The directions in which the light changes pass through the centre of the rings, also where the light is uneven, the
frame cuts them, or fringes too fine for the pixels make patterns of their own.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32

#: Steepest places of the reduced frame that vote, and the centres that are returned at most.
_VOTERS, _MOST_CENTRES = 1500, 3
#: Width (reduced px) of the cells in which votes are counted, and the share of the longer side of the frame up to
#: which centres are looked for outside it.
_CELL, _MARGIN = 4.0, 0.5
#: Distance (reduced px) from a centre up to which the lines through it may pass, and the fewest that must do so.
_NEAR, _LEAST_VOTERS = 24.0, 12
#: Weakest over strongest determination of a centre, below which all lines are nearly parallel: a strip of a few rows.
_STRIP = 0.02


@dataclass(frozen=True)
class Spot:
    """The steepest ring around a centre, in px of the full frame."""

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


def find_centres(frame: NDArray[np.generic]) -> list[Spot]:
    """Find the centres of rings in a frame (row, column), those with the most votes first.

    Their radius is that at which the light changes most. OpenCV's Hough transform of circles looks for one radius and
    needs edges; here all rings vote together.
    """
    small, factor = reduce_frame(frame)
    smooth = cv2.GaussianBlur(small, (0, 0), 1.0)
    slope_y, slope_x = np.gradient(np.asarray(smooth, np.float64))
    steep = np.hypot(slope_x, slope_y)
    # Beyond the border the light is made up, and slopes there point along the border's normal.
    steep[[0, -1]] = 0.0
    steep[:, [0, -1]] = 0.0
    places = np.argpartition(steep, -min(_VOTERS, steep.size), axis=None)[-_VOTERS:]
    largest = float(np.percentile(steep.ravel()[places], 90.0))
    places = places[steep.ravel()[places] > 0.1 * largest]
    if len(places) < _LEAST_VOTERS or largest == 0.0:
        return []
    y, x = (axis.astype(float) for axis in np.unravel_index(places, steep.shape))
    weight = steep.ravel()[places]
    along = np.stack([slope_x.ravel()[places], slope_y.ravel()[places]]) / weight
    weight = np.minimum(weight, largest)
    margin = _MARGIN * max(steep.shape)
    # the weights of the lines through a cell are added up in it, counted once a cell width
    rows, columns = (math.ceil((size + 2.0 * margin) / _CELL) for size in steep.shape)
    longest = math.ceil(math.hypot(*steep.shape) / _CELL)
    steps = _CELL * np.arange(-longest, longest + 1)[:, None]
    across = ((x + steps * along[0] + margin) / _CELL).astype(np.int32)
    down = ((y + steps * along[1] + margin) / _CELL).astype(np.int32)
    inside = (across >= 0) & (across < columns) & (down >= 0) & (down < rows)
    weights = np.broadcast_to(weight, inside.shape)[inside]
    counted = np.bincount((down * columns + across)[inside], weights, minlength=rows * columns)
    votes = np.asarray(cv2.GaussianBlur(counted.reshape(rows, columns), (0, 0), 0.75))
    spots: list[Spot] = []
    for _ in range(_MOST_CENTRES):
        row, column = map(int, np.unravel_index(int(votes.argmax()), votes.shape))
        start = ((column + 0.5) * _CELL - margin, (row + 0.5) * _CELL - margin)
        votes[max(row - 5, 0) : row + 6, max(column - 5, 0) : column + 6] = 0.0
        found = _placed(x, y, along, weight, start)
        if found is not None and all(math.hypot(found.x - old.x, found.y - old.y) > 1.0 for old in spots):
            spots.append(found)
    shift = 0.5 * (factor - 1)  # the centre of the first square of pixels lies so far inside the frame
    return [Spot(factor * spot.x + shift, factor * spot.y + shift, factor * spot.radius) for spot in spots]


def _placed(x: Floats, y: Floats, along: Floats, weight: Floats, start: tuple[float, float]) -> Spot | None:
    """Centre by least squares of the distances to the lines; radius of the steepest ring."""
    (at_x, at_y), near = start, _NEAR
    for _ in range(8):
        across = (x - at_x) * along[1] - (y - at_y) * along[0]
        used = np.abs(across) < near
        if used.sum() < _LEAST_VOTERS:
            return None
        # 2.5 standard deviations, of which the median deviation is 0.67
        near = min(max(2.5 / 0.67 * float(np.median(np.abs(across[used]))), 1.5), _NEAR)
        root = np.sqrt(weight[used])
        matrix = np.stack([along[1][used] * root, -along[0][used] * root], axis=1)
        (at_x, at_y), *_ = np.linalg.lstsq(matrix, matrix[:, 0] * x[used] + matrix[:, 1] * y[used])
    values, vectors = np.linalg.eigh(matrix.T @ matrix)
    if values[0] < _STRIP * values[1]:
        side = vectors[:, 0]
        # rings lie alike on both sides of their middle: of steep places along a line through it
        place, rise = (x - at_x) * side[0] + (y - at_y) * side[1], side @ along
        most = int(np.abs(place).max()) + 2
        left, right = (
            np.bincount(np.rint(np.maximum(way * place, 0.0)).astype(np.int64), way * rise * weight, minlength=most)
            for way in (-1.0, 1.0)
        )
        left[0] = right[0] = 0.0  # places of the other side
        alike = np.correlate(right, left, "full")
        shift = 0.5 * float(int(alike.argmax()) - most + 1) if alike.max() > 0.0 else 0.0
        at_x, at_y = at_x + shift * side[0], at_y + shift * side[1]
    outward = ((x - at_x) * along[0] + (y - at_y) * along[1])[used]
    counts = np.bincount(np.abs(outward).astype(np.int64), weight[used])
    return Spot(float(at_x), float(at_y), int(counts.argmax()) + 0.5)

"""Find the common centre of the rings in a frame, under any illumination and if cut by the border.

A threshold finds a spot that stands out as a whole. Where the light is uneven, or fringes too fine
for the pixels make patterns of their own, the directions in which the light changes tell more: all
of them pass through the centre of the rings.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.imaging.fringes._circle import fit_circle
from labpipe.imaging.fringes._spots import Spot, reduce_frame

#: Places that vote, the steepest ones, and the share of the steepest slope that they have at least.
_VOTERS, _LEAST_SLOPE = 1500, 0.1
#: Width (reduced px) of the cells in which votes are counted.
_CELL = 2.0
#: Centres are looked for up to this share of the frame's longer side outside it.
_MARGIN = 0.5
#: Smoothing before slopes are taken, and of the votes (reduced px).
_SMOOTH, _VOTE_SMOOTH = 1.0, 1.5
#: Voters whose line passes within these distances (reduced px) place the centre, in turn.
_NEAR = (6.0, 3.0, 1.5)
#: Fewest voters of a centre, and the centres that are returned at most.
_LEAST_VOTERS, _MOST_CENTRES = 12, 3
#: Cells around a centre in which no other one is looked for.
_APART = 5
#: Sectors in which the steepest change is looked for, the fewest that must show it, and how far
#: from the circle before (px) it is looked for: in turn, in the reduced frame and in the whole one.
_SECTORS, _LEAST_SECTORS = 48, 8
_REACH_REDUCED, _REACH_WHOLE = (8.0, 5.0), (5.0, 3.0)
#: A sector is left out when it lies this many median deviations beside the circle.
_OUTLIER = 4.0
#: Pixels of a ring that are used.
_MOST_PIXELS = 20_000


@dataclass(frozen=True)
class _Voters:
    """Places of steep slope: where they are, and the direction in which the light grows."""

    x: Floats
    y: Floats
    along_x: Floats
    along_y: Floats
    weight: Floats


def find_centres(frame: NDArray[np.generic]) -> Iterator[Spot]:
    """Find the centres of rings in a frame, those with the most votes first; none without structure.

    Their radius is the one at which the light changes most.
    """
    small, factor = reduce_frame(frame)
    voters = _choose_voters(small)
    if voters is None:
        return
    rows, columns = small.shape
    margin = _MARGIN * max(rows, columns)
    votes = _count_votes(voters, (rows, columns), margin)
    spots: list[Spot] = []
    shift = 0.5 * (factor - 1)
    for _ in range(_MOST_CENTRES):
        row, column = np.unravel_index(int(votes.argmax()), votes.shape)
        if votes[row, column] <= 0.0:
            break
        low = (max(row - _APART, 0), max(column - _APART, 0))
        start = ((column + 0.5) * _CELL - margin, (row + 0.5) * _CELL - margin)
        votes[low[0] : row + _APART + 1, low[1] : column + _APART + 1] = 0.0
        found = _place(voters, *start)
        if found is None:
            continue
        found = _follow_edge(small, found, _REACH_REDUCED)
        whole = Spot(found.x * factor + shift, found.y * factor + shift, found.radius * factor, found.polarity)
        whole = _follow_edge(frame, whole, _REACH_WHOLE)
        if all(_is_apart(whole, other) for other in spots):
            spots.append(whole)
            yield whole


def _is_apart(one: Spot, other: Spot) -> bool:
    return math.hypot(one.x - other.x, one.y - other.y) > 1.0


def _choose_voters(small: NDArray[np.float32]) -> _Voters | None:
    """Pick the places where the light changes most."""
    smooth = cv2.GaussianBlur(small, (0, 0), _SMOOTH)
    slope_y, slope_x = np.gradient(np.asarray(smooth, np.float64))
    slope = np.hypot(slope_x, slope_y)
    # Beyond the border the light is made up, and slopes there point along the border's normal.
    slope[[0, -1]] = 0.0
    slope[:, [0, -1]] = 0.0
    count = min(_VOTERS, slope.size)
    places = np.argpartition(slope, -count, axis=None)[-count:]
    weight = slope.ravel()[places]
    largest = float(np.percentile(weight, 90.0))
    places = places[(weight > _LEAST_SLOPE * largest) & (weight > 0.0)]
    if len(places) < _LEAST_VOTERS:
        return None
    y, x = np.unravel_index(places, slope.shape)
    weight = slope.ravel()[places]
    return _Voters(
        x.astype(float),
        y.astype(float),
        slope_x.ravel()[places] / weight,
        slope_y.ravel()[places] / weight,
        np.minimum(weight, largest),
    )


def _count_votes(voters: _Voters, shape: tuple[int, int], margin: float) -> NDArray[np.float32]:
    """Count in cells the lines that go through them."""
    from labpipe.imaging.fringes._vote_kernel import count_lines

    rows, columns = (math.ceil((size + 2.0 * margin) / _CELL) for size in shape)
    reach = math.ceil(math.hypot(*shape) / _CELL)
    lines = (voters.x, voters.y, voters.along_x, voters.along_y, voters.weight)
    votes = count_lines(*lines, (rows, columns), _CELL, margin, reach)
    blurred = cv2.GaussianBlur(votes.astype(np.float32), (0, 0), _VOTE_SMOOTH / _CELL)
    return np.asarray(blurred, np.float32)


def _place(voters: _Voters, x: float, y: float) -> Spot | None:
    """Centre by least squares of the distances to the lines; radius and polarity of the rings."""
    for near in _NEAR:
        across = (voters.x - x) * voters.along_y - (voters.y - y) * voters.along_x
        used = np.abs(across) < near
        if used.sum() < _LEAST_VOTERS:
            return None
        root = np.sqrt(voters.weight[used])
        matrix = np.stack([voters.along_y[used] * root, -voters.along_x[used] * root], axis=1)
        right = matrix[:, 0] * voters.x[used] + matrix[:, 1] * voters.y[used]
        (x, y), *_ = np.linalg.lstsq(matrix, right, rcond=None)
    outward = (voters.x - x) * voters.along_x + (voters.y - y) * voters.along_y
    distance, sign = np.abs(outward[used]), np.sign(outward[used])
    counts = np.bincount(distance.astype(np.int64), voters.weight[used])
    steepest = int(counts.argmax())
    beside = np.abs(distance - steepest - 0.5) < 2.0
    polarity = -1 if float((sign * voters.weight[used])[beside].sum()) > 0.0 else 1
    return Spot(float(x), float(y), steepest + 0.5, polarity)


def _follow_edge(image: NDArray[np.generic], spot: Spot, reaches: tuple[float, ...]) -> Spot:
    """Lay the circle through the steepest change of the light in every direction."""
    for reach in reaches:
        points = _steepest_points(image, spot, reach)
        for _ in range(2):
            if len(points) < _LEAST_SECTORS:
                return spot
            try:
                x, y, radius = fit_circle(points)
            except InputError:
                return spot
            beside = np.abs(np.hypot(points[:, 0] - x, points[:, 1] - y) - radius)
            points = points[beside <= max(_OUTLIER * float(np.median(beside)), 0.3)]
        if math.hypot(x - spot.x, y - spot.y) > 4.0 * reach or radius < 2.0:
            return spot
        spot = Spot(x, y, radius, spot.polarity)
    return spot


def _steepest_points(image: NDArray[np.generic], spot: Spot, reach: float) -> Floats:
    """Places of steepest change within a distance of a circle, one in every sector."""
    rows, columns = image.shape
    outer, inner = spot.radius + reach, max(spot.radius - reach, 0.0)
    top, bottom = max(0, int(spot.y - outer)), min(rows, int(spot.y + outer) + 2)
    left, right = max(0, int(spot.x - outer)), min(columns, int(spot.x + outer) + 2)
    if bottom <= top or right <= left:
        return np.empty((0, 2))
    # Rows are left out evenly where the ring holds more pixels than the points need.
    stride = max(1, int(math.pi * (outer**2 - inner**2) / _MOST_PIXELS))
    dy = (np.arange(top, bottom, stride) - spot.y).astype(np.float32)[:, None]
    dx = (np.arange(left, right) - spot.x).astype(np.float32)
    r = np.sqrt(dx * dx + dy * dy)
    ring = (r >= inner) & (r < outer)
    angle = np.arctan2(np.broadcast_to(dy, r.shape)[ring], np.broadcast_to(dx, r.shape)[ring])
    steps = max(int(outer - inner), 1)
    sector = np.minimum(((angle / (2.0 * np.pi) + 0.5) * _SECTORS).astype(int), _SECTORS - 1)
    cell = sector * steps + np.minimum((r[ring] - inner).astype(int), steps - 1)
    grey = image[top:bottom:stride, left:right][ring].astype(float)
    counts = np.bincount(cell, minlength=_SECTORS * steps).reshape(_SECTORS, steps)
    sums = np.bincount(cell, grey, minlength=_SECTORS * steps).reshape(_SECTORS, steps)
    is_whole = (counts > 0).all(axis=1)
    if steps < 4 or not is_whole.any():
        return np.empty((0, 2))
    # A dark spot's light grows outwards.
    change = -spot.polarity * np.gradient(sums[is_whole] / counts[is_whole], axis=1)
    best = np.clip(change.argmax(axis=1), 1, steps - 2)
    line = np.arange(len(change))
    before, here, after = change[line, best - 1], change[line, best], change[line, best + 1]
    bend = np.maximum(2.0 * here - before - after, 1e-9)
    shift = np.clip(0.5 * (after - before) / bend, -1.0, 1.0)
    direction = ((np.flatnonzero(is_whole) + 0.5) / _SECTORS - 0.5) * 2.0 * np.pi
    distance = inner + best + 0.5 + shift
    used = here > 0.0
    points = np.stack([spot.x + distance * np.cos(direction), spot.y + distance * np.sin(direction)], axis=1)
    return np.asarray(points[used])

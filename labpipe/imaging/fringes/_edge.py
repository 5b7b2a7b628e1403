"""Radius of a contact from the edge of its spot, where no fringes determine it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.imaging.fringes._circle import fit_circle
from labpipe.imaging.fringes._frame_features import radial_profile
from labpipe.imaging.fringes._ring_model import Optics, distance_at_phase

#: Directions in which the edge is looked for, and the fewest that must show it.
_SECTORS, _LEAST_SECTORS = 72, 12


@dataclass(frozen=True)
class Edge:
    """The edge of a spot.

    Attributes
    ----------
    x, y, half_radius : float [px]
        Circle through the points of half brightness.
    scatter : float [px]
        Standard deviation of these points about the circle.
    points : int
        Their number.
    softness : float [px]
        Width over which the light rises from a quarter to three quarters.
    inside, outside : float [grey levels]
        Brightness of the spot, and of the first ring around it.
    """

    x: float
    y: float
    half_radius: float
    scatter: float
    points: int
    softness: float
    inside: float
    outside: float


def find_edge(frame: NDArray[np.generic], x: float, y: float, radius: float, black: float = 0.0) -> Edge | None:
    """Circle through the points where the light is half way between spot and surroundings.

    The spot must be known to a tenth of its radius (px); ``black`` is the grey level of darkness. None where there is
    no even, round spot.
    """
    edge: Edge | None = None
    for _ in range(2):
        edge = _edge_about(frame, x, y, radius, black)
        if edge is None:
            return None
        x, y, radius = edge.x, edge.y, edge.half_radius
    return edge


def _edge_about(frame: NDArray[np.generic], x: float, y: float, radius: float, black: float) -> Edge | None:
    """One round: profile about the centre, then a point in every direction, then a circle.

    A spot is even to 15 % of its contrast well inside (0.7 of its radius), and its contrast is 10 % of the light.
    """
    bins = int(1.5 * radius) + 4
    profile, counts = radial_profile(frame, x, y, 1.0, bins)
    is_seen, core = counts > 0, slice(0, max(int(0.7 * radius), 2))
    plateau = profile[core][is_seen[core]]
    near = slice(int(0.6 * radius), bins)
    if len(plateau) < 2 or not is_seen[near].all():
        near = slice(near.start, near.start + int(is_seen[near].argmin()))
    if len(plateau) < 2 or near.stop - near.start < 4:
        return None
    inside, line = float(np.median(plateau)), profile[near]
    is_dark = inside < float(line.max()) - (inside - float(line.min()))
    outside = float(line.max() if is_dark else line.min())
    contrast = abs(outside - inside)
    if contrast < 0.1 * (max(outside, inside) - black) or float(plateau.std()) > 0.15 * contrast:
        return None
    levels = [_crossing(line, inside + share * (outside - inside)) for share in (0.25, 0.5, 0.75)]
    quarter, half, three = levels
    if quarter is None or half is None or three is None:
        return None
    points = _points(frame, x, y, near.start + half + 0.5, 0.5 * (inside + outside))
    if len(points) < _LEAST_SECTORS:
        return None
    try:
        new_x, new_y, new_radius = fit_circle(points)
    except InputError:
        return None
    scatter = float(np.std(np.hypot(points[:, 0] - new_x, points[:, 1] - new_y)))
    # beyond this scatter it is no circle
    if scatter > max(0.03 * new_radius, 1.0) or not 0.5 < new_radius / radius < 2.0:
        return None
    softness = max(three - quarter, 0.0)
    return Edge(new_x, new_y, new_radius, scatter, len(points), softness, inside, outside)


def _crossing(line: Floats, level: float) -> float | None:
    """First place where a line passes a level, between samples; None when it does not."""
    above = line > level
    change = np.flatnonzero(above[1:] != above[:-1])
    if not len(change):
        return None
    k = int(change[0])
    return float(k + (level - line[k]) / (line[k + 1] - line[k]))


def _points(frame: NDArray[np.generic], x: float, y: float, radius: float, level: float) -> Floats:
    """Points of half brightness in sectors around the centre (point, 2); those outside the frame missing."""
    rows, columns = frame.shape
    reach = min(max(0.15 * radius, 6.0), 40.0)
    top, bottom = max(0, int(y - radius - reach)), min(rows, int(y + radius + reach) + 2)
    left, right = max(0, int(x - radius - reach)), min(columns, int(x + radius + reach) + 2)
    if bottom <= top or right <= left:
        return np.empty((0, 2))
    # Rows are left out evenly where the ring holds more pixels than the points need.
    stride = max(1, int(4.0 * math.pi * radius * reach / 40_000))
    dy = (np.arange(top, bottom, stride, dtype=np.float32) - np.float32(y))[:, None]
    dx = np.arange(left, right, dtype=np.float32) - np.float32(x)
    square = dx * dx + dy * dy
    ring = (square > (radius - reach) ** 2) & (square < (radius + reach) ** 2)
    r = np.sqrt(square[ring])
    angle = np.arctan2(np.broadcast_to(dy, ring.shape)[ring], np.broadcast_to(dx, ring.shape)[ring])
    grey = frame[top:bottom:stride, left:right][ring].astype(float)
    sector = np.minimum(((angle / (2.0 * np.pi) + 0.5) * _SECTORS).astype(int), _SECTORS - 1)
    steps = int(2 * reach)
    cell = sector * steps + np.minimum((r - (radius - reach)).astype(int), steps - 1)
    counts = np.bincount(cell, minlength=_SECTORS * steps).reshape(_SECTORS, steps)
    sums = np.bincount(cell, grey, minlength=_SECTORS * steps).reshape(_SECTORS, steps)
    found = []
    for k in np.flatnonzero((counts > 0).all(axis=1)):
        # a mean of three, so that noise does not cross the level before the edge does
        line = np.pad(sums[k] / counts[k], 1, mode="edge")
        at = _crossing((line[:-2] + line[1:-1] + line[2:]) / 3.0, level)
        if at is not None:
            direction = ((k + 0.5) / _SECTORS - 0.5) * 2.0 * np.pi
            distance = radius - reach + at + 0.5
            found.append((x + distance * np.cos(direction), y + distance * np.sin(direction)))
    return np.array(found).reshape(-1, 2)


def corrected_radius(edge: Edge, optics: Optics) -> tuple[float, float]:
    """Contact radius (px) and its standard uncertainty from the circle of half brightness.

    Half way between the contact and the first bright ring the gap is an eighth of the wavelength (nominal where it is
    not known). Pixels and noise matter little here; the uncertainty is that of the correction, half of it: it is exact
    for ideal fringes, and nearly gone where motion has washed them out.
    """
    radius, offset = edge.half_radius, 0.0
    for _ in range(8):
        offset = distance_at_phase(0.5 * math.pi, radius, optics) - radius
        radius = max(edge.half_radius - offset, 0.0)
    noise = edge.scatter / math.sqrt(max(edge.points - 3, 1))
    return radius, math.hypot(0.5 * offset, noise)

"""Radius of a contact from the edge of its spot, where no fringes determine it."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.imaging.fringes._frame_features import radial_profile
from labpipe.imaging.fringes._ring_model import Optics, distance_at_phase

#: Sectors in which the edge is looked for, the fewest that must show it, and directions that are averaged in each.
_SECTORS, _LEAST_SECTORS, _RAYS = 72, 12, 8


@dataclass(frozen=True)
class Edge:
    """The edge of a spot: the circle (px) through its points of half brightness.

    ``scatter`` [px]: standard deviation of the points about the circle. ``softness`` [px]: width over which the light
    rises from a quarter to three quarters. ``inside``, ``outside`` [grey levels]: brightness of the spot, and of the
    first ring around it.
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
    no even, round spot: it is even to 15 % of its contrast well inside (0.7 of its radius), and its contrast is 10 % of
    the light.
    """
    edge: Edge | None = None
    for _ in range(2):  # profile about the centre, then a point in every direction, then a circle
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
        edge = Edge(new_x, new_y, new_radius, scatter, len(points), softness, inside, outside)
        x, y, radius = new_x, new_y, new_radius
    return edge


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
    reach = min(max(0.15 * radius, 6.0), 40.0)
    outer = math.ceil(radius + reach)
    size, rays = (outer, _RAYS * _SECTORS), np.arange(_SECTORS)
    known = frame if frame.dtype in (np.uint8, np.uint16, np.float32) else frame.astype(np.float32)
    polar = cv2.warpPolar(np.asarray(known), size, (x, y), outer, cv2.INTER_LINEAR)
    first = max(int(radius - reach), 0)
    lines = polar.reshape(_SECTORS, _RAYS, outer).mean(axis=1, dtype=np.float64)[:, first:]
    direction = 2.0 * np.pi * (rays + 0.5 * (_RAYS - 1) / _RAYS) / _SECTORS
    along = np.column_stack([np.cos(direction), np.sin(direction)])
    ends = np.array([x, y]) + outer * along
    inside = ((ends >= 0.0) & (ends <= np.array(frame.shape[::-1]) - 1.0)).all(axis=1)
    found = []
    for k in np.flatnonzero(inside):
        # a mean of three, so that noise does not cross the level before the edge does
        line = np.pad(lines[k], 1, mode="edge")
        at = _crossing((line[:-2] + line[1:-1] + line[2:]) / 3.0, level)
        if at is not None:
            found.append(np.array([x, y]) + (first + at) * along[k])
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


def fit_circle(points: Floats) -> tuple[float, float, float]:
    """Fit a circle to points, also when they cover only an arc.

    Parameters
    ----------
    points : array (point, 2)
        Coordinates (x, y) of three or more points that are not on one line.

    Returns
    -------
    x, y, radius : float
        Centre and radius in the unit of the points.

    Raises
    ------
    InputError
        Fewer than three points, or points on one line.

    Notes
    -----
    Taubin's fit (IEEE Trans. PAMI 13 (1991) 1115, https://doi.org/10.1109/34.103273): the algebraic distance is
    normalised by the mean of its squared gradient, which takes away most of the pull to small circles that short arcs
    have. OpenCV has no fit of circles.
    """
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise InputError(f"a circle needs three or more points (x, y), found shape {points.shape}")
    middle = points.mean(axis=0)
    centred = points - middle
    square = (centred**2).sum(axis=1)
    mean_square = float(square.mean())
    if mean_square == 0.0:
        raise InputError("the points are all the same; a circle needs three different ones")
    root = np.sqrt(mean_square)
    *_, vectors = np.linalg.svd(np.column_stack([(square - mean_square) / (2.0 * root), centred]), full_matrices=False)
    curvature, *slope = vectors[-1]
    curvature /= 2.0 * root
    if abs(curvature) * root < 1e-9 * np.hypot(*slope):
        raise InputError("the points lie on one line; no circle passes through them")
    x, y = -np.array(slope) / (2.0 * curvature) + middle
    radius = np.sqrt(slope[0] ** 2 + slope[1] ** 2 + 4.0 * curvature**2 * mean_square) / (2.0 * abs(curvature))
    return float(x), float(y), float(radius)

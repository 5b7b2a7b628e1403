"""Measure a contact by the edge of its dark spot, where there are no usable fringes."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.imaging.fringes._circle import fit_circle
from labpipe.imaging.fringes._interference import Optics, distance_at_phase
from labpipe.imaging.fringes._radial_scan import radial_profile

#: Directions of a whole circle in which the edge is looked for, and the fewest that must show it.
#: Of a circle that the frame cuts as many are wanted in what is left, none narrower than this (px).
_SECTORS, _LEAST_SECTORS, _LEAST_ARC = 72, 12, 2.5
#: The spot is searched from this share of its radius to this multiple.
_NEAR, _FAR = 0.6, 1.5
#: The spot's brightness is taken within this share of its radius.
_PLATEAU = 0.7
#: Greatest spread of the brightness within the plateau, as a share of the contrast.
_MOST_UNEVEN = 0.15
#: Least contrast as a share of the light around the spot.
_LEAST_CONTRAST = 0.1
#: Scatter of the edge about the circle (share of the radius) from which it is no circle.
_MOST_SCATTER = 0.03
#: The correction from half brightness to contact is known to this share: it is exact for ideal
#: fringes, and nearly gone where motion has washed them out.
_CORRECTION_UNCERTAINTY = 0.5
#: Half width of the ring in which the edge is looked for, as a share of the radius, and at most
#: (px); pixels used.
_REACH, _MOST_REACH, _MOST_PIXELS = 0.15, 40.0, 40_000
#: Share of the ring in the frame below which the frame cuts it, and share of a line across the
#: ring, from the inside, that the frame must hold.
_CUT, _LEAST_LINE = 0.5, 0.75
#: Greatest uncertainty of the radius as a share of it.
_MOST_UNCERTAINTY = 0.1
#: An ellipse is told when its axes differ from the circle by so many standard deviations, and by so much (px);
#: condition of the equations from which an arc tells none.
_CLEAR_AXES, _LEAST_AXES, _MOST_CONDITION = 6.0, 0.3, 300.0
#: Rounds of centring.
_ROUNDS = 2


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
    leverage : float [1]
        Standard uncertainty of the circle's radius per scatter of a point; large where the frame
        leaves a short arc.
    softness : float [px]
        Width over which the light rises from a quarter to three quarters.
    inside, outside : float [grey levels]
        Brightness of the spot, and of the first ring around it.
    oblique : (float, float)
        Stretch and shear that make a circle of it, where it is an ellipse beyond doubt; else zero.
    """

    x: float
    y: float
    half_radius: float
    scatter: float
    points: int
    leverage: float
    softness: float
    inside: float
    outside: float
    oblique: tuple[float, float] = (0.0, 0.0)


def find_edge(frame: NDArray[np.generic], x: float, y: float, radius: float, black: float = 0.0) -> Edge | None:
    """Circle through the points where the light is half way between spot and surroundings.

    Parameters
    ----------
    frame : array (row, column)
        Grey levels.
    x, y, radius : float [px]
        Where the spot is, to a tenth of its radius.
    black : float, optional
        Grey level of darkness.

    Returns
    -------
    Edge or None
        None when there is no even, round spot.
    """
    edge: Edge | None = None
    for _ in range(_ROUNDS):
        edge = _edge_about(frame, x, y, radius, black)
        if edge is None:
            return None
        x, y, radius = edge.x, edge.y, edge.half_radius
    return edge


def _edge_about(frame: NDArray[np.generic], x: float, y: float, radius: float, black: float) -> Edge | None:
    """One round: profile about the centre, then a point in every direction, then a circle."""
    bins = int(_FAR * radius) + 4
    profile, counts = radial_profile(frame, x, y, 1.0, bins)
    is_seen = counts > 0
    core = profile[: max(int(_PLATEAU * radius), 2)][is_seen[: max(int(_PLATEAU * radius), 2)]]
    near = slice(int(_NEAR * radius), bins)
    if len(core) < 2 or not is_seen[near].all():
        near = slice(int(_NEAR * radius), int(_NEAR * radius) + int(is_seen[near].argmin()))
    if len(core) < 2 or near.stop - near.start < 4:
        return None
    inside, line = float(np.median(core)), profile[near]
    is_dark = inside < float(line.max()) - (inside - float(line.min()))
    outside = float(line.max() if is_dark else line.min())
    contrast = abs(outside - inside)
    light = max(outside, inside) - black
    if contrast < _LEAST_CONTRAST * light or float(core.std()) > _MOST_UNEVEN * contrast:
        return None
    quarter, half, three = (_crossing(line, inside + share * (outside - inside)) for share in (0.25, 0.5, 0.75))
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
    if scatter > max(_MOST_SCATTER * new_radius, 1.0) or not 0.5 < new_radius / radius < 2.0:
        return None
    softness = max(three - quarter, 0.0)
    leverage = _leverage(points, new_x, new_y)
    if scatter * leverage > _MOST_UNCERTAINTY * new_radius:
        return None
    oblique = _oblique(points, new_x, new_y, new_radius)
    return Edge(new_x, new_y, new_radius, scatter, len(points), leverage, softness, inside, outside, oblique)


def _oblique(points: Floats, x: float, y: float, radius: float) -> tuple[float, float]:
    """Stretch and shear of an ellipse through points near a circle; zero unless they are told from chance."""
    across, down = (points - (x, y)).T
    angle = np.arctan2(down, across)
    waves = [np.ones(len(points)), *(wave(n * angle) for n in (1, 2) for wave in (np.cos, np.sin))]
    columns, away = np.stack(waves, axis=1), np.hypot(across, down)
    normal = columns.T @ columns
    if np.linalg.cond(normal) > _MOST_CONDITION:
        return 0.0, 0.0  # an arc shows no axes
    found = np.linalg.solve(normal, columns.T @ away)
    left = away - columns @ found
    variance = float(left @ left) / max(len(points) - len(found), 1)
    deviation = math.sqrt(variance * float(np.linalg.inv(normal)[3:, 3:].trace()))
    if math.hypot(*found[3:]) < max(_CLEAR_AXES * deviation, _LEAST_AXES):
        return 0.0, 0.0
    return -float(found[3]) / radius, -float(found[4]) / radius


def _leverage(points: Floats, x: float, y: float) -> float:
    """Return the standard uncertainty of a circle's radius per scatter of its points, centre fitted too."""
    away = points - (x, y)
    columns = np.column_stack([away / np.hypot(*away.T)[:, None], np.ones(len(points))])
    normal = columns.T @ columns
    # Points in a narrow sector leave the radius free; less than one part in 10^9 is rounding.
    own = float(np.linalg.pinv(normal, rcond=1e-9)[2, 2])
    return math.sqrt(own * len(points) / max(len(points) - 3, 1))


def _crossing(line: Floats, level: float) -> float | None:
    """First place where a line passes a level, between samples; None when it does not."""
    above = line > level
    change = np.flatnonzero(above[1:] != above[:-1])
    if not len(change):
        return None
    k = int(change[0])
    return float(k + (level - line[k]) / (line[k + 1] - line[k]))


def _points(frame: NDArray[np.generic], x: float, y: float, radius: float, level: float) -> Floats:
    """Points of half brightness in sectors around the centre; those outside the frame missing."""
    rows, columns = frame.shape
    reach = min(max(_REACH * radius, 6.0), _MOST_REACH)
    top, bottom = max(0, int(y - radius - reach)), min(rows, int(y + radius + reach) + 2)
    left, right = max(0, int(x - radius - reach)), min(columns, int(x + radius + reach) + 2)
    if bottom <= top or right <= left:
        return np.empty((0, 2))
    # Rows are left out evenly where the ring holds more pixels than the points need.
    stride = max(1, int(4.0 * math.pi * radius * reach / _MOST_PIXELS))
    dy, dx = np.mgrid[top:bottom:stride, left:right].astype(np.float32)
    dy -= np.float32(y)
    dx -= np.float32(x)
    square = dx * dx + dy * dy
    ring = (square > (radius - reach) ** 2) & (square < (radius + reach) ** 2)
    r, dx, dy = np.sqrt(square[ring]), dx[ring], dy[ring]
    grey = frame[top:bottom:stride, left:right][ring].astype(float)
    angle = np.arctan2(dy, dx)
    seen = len(r) * stride / (4.0 * math.pi * radius * reach)
    most = max(int(2.0 * math.pi * radius / (_LEAST_ARC * stride)), _SECTORS)
    sectors = min(int(_SECTORS / max(seen, 1e-3)), most) if seen < _CUT else _SECTORS
    sector = np.minimum(((angle / (2.0 * np.pi) + 0.5) * sectors).astype(int), sectors - 1)
    steps = int(2 * reach)
    place = np.minimum((r - (radius - reach)).astype(int), steps - 1)
    cell = sector * steps + place
    counts = np.bincount(cell, minlength=sectors * steps).reshape(sectors, steps)
    sums = np.bincount(cell, grey, minlength=sectors * steps).reshape(sectors, steps)
    found = []
    for k in range(sectors):
        end = steps if counts[k].all() else int(counts[k].argmin())
        if end < _LEAST_LINE * steps:
            continue
        at = _crossing(_smooth(sums[k, :end] / counts[k, :end]), level)
        if at is not None:
            direction = ((k + 0.5) / sectors - 0.5) * 2.0 * np.pi
            distance = radius - reach + at + 0.5
            found.append((x + distance * np.cos(direction), y + distance * np.sin(direction)))
    return np.array(found).reshape(-1, 2)


def _smooth(line: Floats) -> Floats:
    """Mean of three, so that noise does not cross the level before the edge does."""
    padded = np.concatenate([line[:1], line, line[-1:]])
    return (padded[:-2] + padded[1:-1] + padded[2:]) / 3.0


def corrected_radius(edge: Edge, optics: Optics) -> tuple[float, float]:
    """Contact radius (px) and its standard uncertainty from the circle of half brightness.

    Half way between the contact and the first bright ring the gap is an eighth of the wavelength.
    Pixels and noise matter little here; the uncertainty is that of the correction.

    Parameters
    ----------
    edge : Edge
        Circle of half brightness.
    optics : Optics
        The interference, nominal where the wavelength is not known.
    """
    radius = edge.half_radius
    offset = 0.0
    for _ in range(8):
        offset = distance_at_phase(0.5 * math.pi, radius, optics) - radius
        radius = max(edge.half_radius - offset, 0.0)
    noise = edge.scatter * edge.leverage
    return radius, math.hypot(_CORRECTION_UNCERTAINTY * offset, noise)

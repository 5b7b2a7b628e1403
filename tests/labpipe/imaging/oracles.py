"""Plain numpy and scipy twins of the compiled kernels."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates, spline_filter

from labpipe.arrays import Floats, Integers
from labpipe.imaging.dic._kernels import compose_with_inverse
from labpipe.imaging.dic._spline import NODE_SLOPES, NODE_WEIGHTS
from labpipe.imaging.dic._subsets import _RIGID_FROM_AFFINE
from labpipe.imaging.fringes._interference import (
    BETWEEN_BEAMS,
    HIGHEST,
    SAMPLES_PER_PIXEL,
    Optics,
    RadialTable,
    beyond_third,
    exposure_nodes,
    flat_parts,
    phase_slope,
    pixel_weights,
    scaled_gap,
    table_distances,
)
from labpipe.imaging.fringes._ring_parameters import HARMONICS, LIGHT, Parameter
from labpipe.imaging.fringes._ring_pixels import Ring
from labpipe.imaging.fringes._ring_sums import Sums, by_smear, shrinkage, table_travel


def prefilter_oracle(image: NDArray[np.generic], order: int) -> NDArray[np.float64]:
    """Compute the coefficients with ``scipy.ndimage`` in float64, without border.

    Parameters
    ----------
    image : array (row, column)
        Grey levels.
    order : 3 or 5
        Cubic or quintic.

    Returns
    -------
    array (row, column)
        The coefficients that :func:`prefilter` approximates in float32.
    """
    return np.asarray(spline_filter(image, order, output=np.float64, mode="mirror"))


def solve_oracle(
    reference: NDArray[np.generic],
    image: NDArray[np.generic],
    centre: tuple[int, int],
    half: int,
    is_rigid: bool,
    order: int,
    motion: Floats,
    *,
    tolerance: float = 1e-6,
    max_iterations: int = 30,
) -> tuple[Floats, float]:
    """Match one subset with ``scipy.ndimage`` in float64: the check on ``solve``.

    Parameters
    ----------
    reference, image : arrays (row, column)
        Grey levels.
    centre : (x, y) [px]
        Centre pixel of the subset.
    half : int [px]
        Half width.
    is_rigid : bool
        Translation and rotation, or affine.
    order : 3 or 5
        Spline order.
    motion : array (6,) [px]
        Start.
    tolerance : float [px]
        Step at which to stop.
    max_iterations : int
        Steps allowed.

    Returns
    -------
    motion : array (6,)
        As in :class:`Solution`.
    zncc : float
        Correlation at the solution.
    """
    i, j = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    area = np.s_[centre[1] - half : centre[1] + half + 1, centre[0] - half : centre[0] + half + 1]
    before, after = prefilter_oracle(reference, order), prefilter_oracle(image, order)

    def slope(axis: int) -> Floats:
        result = before
        for along in (0, 1):
            weights = NODE_SLOPES if along == axis else NODE_WEIGHTS
            result = np.apply_along_axis(
                lambda line, w=weights[order]: np.correlate(np.pad(line, len(w) // 2, mode="reflect"), w, "valid"),
                along,
                result,
            )
        return np.asarray(result[area])

    gx, gy = slope(1), slope(0)
    f = np.asarray(reference, float)[area]
    f = f - f.mean()
    images = np.stack([gx, gx * j, gx * i, gy, gy * j, gy * i])
    basis = _RIGID_FROM_AFFINE if is_rigid else np.eye(6)
    jacobian = np.concatenate([np.tensordot(basis, images, 1), f[None], np.ones_like(f)[None]]).reshape(
        len(basis) + 2, -1
    )
    p = np.array(motion, float)
    zncc = math.nan
    for _ in range(max_iterations):
        x = centre[0] + j + p[0] + p[1] * j + p[2] * i
        y = centre[1] + i + p[3] + p[4] * j + p[5] * i
        g = map_coordinates(after, [y, x], order=order, prefilter=False, mode="mirror")
        g = g - g.mean()
        zncc = float((f * g).sum() / math.sqrt((f**2).sum() * (g**2).sum()))
        gain = (f**2).sum() / (f * g).sum()
        found, *_ = np.linalg.lstsq(jacobian.T, (gain * g - f).ravel(), rcond=None)
        step = basis.T @ found[:-2]
        compose_with_inverse(p, step, is_rigid)
        if np.hypot(step[0], step[3]) < tolerance:
            break
    return p, zncc


def plain_lines(
    x: Floats,
    y: Floats,
    along_x: Floats,
    along_y: Floats,
    weight: Floats,
    shape: tuple[int, int],
    cell: float,
    margin: float,
    reach: int,
) -> Floats:
    """Add up the weights of the lines that go through each cell, counted once a cell width.

    The numpy twin of :func:`labpipe.imaging.fringes._vote_kernel.count_lines`, to the same bits.
    """
    rows, columns = shape
    steps = (np.arange(-reach, reach + 1) * cell)[:, None]
    column = np.floor((x + steps * along_x + margin) / cell).astype(np.int64)
    row = np.floor((y + steps * along_y + margin) / cell).astype(np.int64)
    is_inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    weights = np.broadcast_to(weight, column.shape)[is_inside]
    cells = row[is_inside] * columns + column[is_inside]
    votes: Floats = np.bincount(cells, weights, minlength=rows * columns).astype(np.float64)
    return votes.reshape(rows, columns)


def plain_sums(ring: Ring, parameters: Floats, free: Integers, optics: Optics, told: int = 0) -> Sums:
    """Sum over the ring by array operations: the twin of :func:`ring_sums`."""
    radius, x_centre, y_centre, gain, modulation, slope_x, slope_y, bowl = parameters[:8]
    stretch, shear, _, scale, more_blur = parameters[Parameter.STRETCH : Parameter.SECOND]
    spread = optics.spread + float(parameters[Parameter.SPREAD])
    rows, columns = ring.image.shape
    y, x = np.mgrid[0 : rows : ring.stride, 0:columns].astype(float)
    dx, dy = x + ring.first_column - x_centre, y + ring.first_row - y_centre
    u, v = dx * (1.0 + stretch) + dy * shear, dy * (1.0 - stretch) + dx * shear
    r = np.hypot(u, v)
    grey = ring.image[:: ring.stride].astype(float)
    used = (r >= ring.inner) & (r <= ring.outer) & (grey < ring.ceiling)
    phased = replace(
        optics,
        phase=float(parameters[Parameter.PHASE]),
        phase_scale=optics.phase_scale * math.exp(scale) / shrinkage(parameters),
        blur=math.sqrt(max(optics.blur**2 + more_blur, 0.0)),
        spread=max(spread, 0.0),
        focus=optics.focus + float(parameters[Parameter.FOCUS]),
    )
    second, turned, third = (float(parameters[p]) for p in HARMONICS)
    contact = ring.inner, ring.outer, float(radius), table_travel(parameters)
    shape = optics.disc**2 + float(parameters[Parameter.SHAPE])
    table = radial_table(*contact, replace(phased, disc=math.sqrt(shape)), (second, turned, third))
    table.values[0] += min(optics.blur**2 + more_blur, 0.0) * table.values[5] + min(spread, 0.0) * table.values[9]
    table = by_smear(table, parameters)
    if Parameter.SHAPE in free:
        flatter = radial_table(*contact, replace(phased, disc=math.sqrt(shape + 0.02)), (second, turned, third))
        larger = replace(phased, disc=math.sqrt(shape), blur=phased.blur * math.sqrt(1.02))
        wider = radial_table(*contact, larger, (second, turned, third))
        moved = [by_smear(one, parameters).values[0] - table.values[0] for one in (wider, flatter)]
        values = np.vstack((table.values, moved[1] / 0.02))
        values[5] = moved[0] / (0.02 * phased.blur**2)
        table = RadialTable(table.start, values)
    places = table.start + np.arange(table.values.shape[1]) / SAMPLES_PER_PIXEL
    lines = (np.interp(r[used], places, line) for line in table.values)
    term, by_r, by_radius, by_phase, by_square, *rich = lines
    across = (x[used] + ring.first_column - ring.origin[0]) / ring.origin[2]
    down = (y[used] + ring.first_row - ring.origin[1]) / ring.origin[2]
    curve = (across**2 + down**2 - ring.origin[3]) * ring.origin[4]
    powers = np.stack([across**2 - down**2, across * down, across**3, across**2 * down, across * down**2, down**3])
    exponent = slope_x * across + slope_y * down + bowl * curve + parameters[list(LIGHT[:6])] @ powers
    is_uneven = parameters[list(LIGHT)].any() or np.isin(LIGHT, free).any()
    light, tilt = (np.exp(exponent),) * 2 if is_uneven else (1.0 + exponent, np.ones_like(exponent))
    fields = np.stack([across, down, curve])
    seen = 1.0 + parameters[list(LIGHT[6:])] @ fields
    fringes, term = term, term * seen
    core = gain + modulation * term
    u, v, dx, dy, distance = u[used], v[used], dx[used], dy[used], np.maximum(r[used], 1e-9)
    bright = modulation * light * seen
    steep = bright * by_r / distance
    slopes = np.stack(
        [
            bright * by_radius,
            -steep * (u * (1.0 + stretch) + v * shear),
            -steep * (v * (1.0 - stretch) + u * shear),
            light,
            light * term,
            across * core * tilt,
            down * core * tilt,
            curve * core * tilt,
            bright * by_phase,
            steep * (u * dx - v * dy),
            steep * (u * dy + v * dx),
            bright * by_square,
            0.5 * bright * (r[used] * by_r + radius * by_radius),
            *(bright * line for line in rich),
            *(powers * core * tilt),
            *(modulation * light * fringes * fields),
        ]
    )[free]
    residual = grey[used] - light * core
    differences, pairs = 0.0, 0
    if told:
        whole = np.full(r.shape, np.nan)
        whole[used] = residual
        wide = x + ring.first_column - x_centre
        high = y + ring.first_row - y_centre
        steps = _steps_along(whole, wide, high, ring.stride)
        differences, pairs = float((steps**2).sum()), len(steps)
    return Sums(
        slopes @ slopes.T,
        slopes @ residual,
        (slopes[:told] * residual**2) @ slopes[:told].T,
        float((residual**2).sum()),
        int(used.sum()),
        differences,
        pairs,
    )


def _steps_along(whole: Floats, dx: Floats, dy: Floats, stride: int) -> Floats:
    """Differences of residuals between neighbours along the rings."""
    is_flat = np.abs(dy) > 2.0 * np.abs(dx)
    is_upright = np.abs(dx) > 2.0 * np.abs(dy)
    padded = np.pad(whole, ((1, 0), (stride, stride)), constant_values=np.nan)
    above = padded[:-1, stride:-stride]
    diagonal = np.where(dx * dy > 0.0, padded[:-1, 2 * stride :], padded[:-1, : -2 * stride])
    before = np.pad(whole, ((0, 0), (1, 0)), constant_values=np.nan)[:, :-1]
    beside = np.where(is_flat, before, np.where(is_upright, above, diagonal))
    steps = whole - beside
    return np.asarray(steps[np.isfinite(steps)])


def scaled_slopes(distance: Floats, contact_radius: ArrayLike, flat: float = 0.0) -> tuple[Floats, Floats]:
    """Differentiate :func:`scaled_gap` by distance and by contact radius."""
    if flat > 0.0:
        a, r, square, s, root, turn = flat_parts(distance, contact_radius, flat)
        by_distance = 2.0 * (s * root / np.where(r > 0.0, r, 1.0) + r * (0.5 * np.pi - turn)) / np.pi
        by_radius = -2.0 * (2.0 * a * a - square) / np.where(s > 0.0, s, 1.0) * np.arctan2(root, a) / np.pi
        return np.where(r > a, by_distance, 0.0), np.where(r > a, by_radius, 0.0)
    a = np.asarray(contact_radius, float)
    r = np.maximum(distance, a)
    root = np.sqrt(r * r - a * a)
    angle = np.arctan2(root, a)
    by_distance = 2.0 * (a * root / np.where(r > 0.0, r, 1.0) + r * angle) / np.pi
    return np.where(r > a, by_distance, 0.0), np.where(r > a, -4.0 * a * angle / np.pi, 0.0)


def _out_of_focus(
    distance: Floats, contact_radius: float, optics: Optics, by_distance: Floats, by_radius: Floats
) -> tuple[Floats, Floats]:
    """Slopes by distance and contact radius of the gap as it is seen out of focus, from those of the gap.

    Light leaves a gap g at a slope of 2 dg/dr: what is seen at a distance D from there is g - D (dg/dr)².
    """
    if not optics.focus:
        return by_distance, by_radius
    a, r, square, s, root, turn = flat_parts(distance, contact_radius, optics.flat)
    root, twice = np.maximum(root, 1e-9), 2.0 * optics.focus * by_distance
    curve = s / root - s * root / r**2 + 0.5 * np.pi - turn + s * r**2 / (root * (r**2 - square))
    bend = -a * (2.0 * a * a - square) / (s * root * r)
    return by_distance - twice * 2.0 / np.pi * curve, by_radius - twice * 2.0 / np.pi * bend


def radial_table(
    inner: float,
    outer: float,
    contact_radius: float,
    travel: float,
    optics: Optics,
    harmonics: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> RadialTable:
    """Tabulate the interference term between two distances.

    Parameters
    ----------
    inner, outer : float [px]
        Distances from the centre.
    contact_radius : float [px]
        Contact radius in the middle of the exposure.
    travel : float [px]
        Change of the contact radius during the exposure; its square changes evenly with time,
        as the approach of the bodies does.
    optics : Optics
        The interference.
    harmonics : (float, float, float), optional
        Real and imaginary part of the ratio of one harmonic to the one before, and a third harmonic beside.
    """
    if optics.halo[0]:
        rest = contact_radius, travel
        sharp, soft = (radial_table(inner, outer, *rest, seen, harmonics) for seen in optics.before_sharpening)
        return sharp.sharpened(soft, optics.halo[0])
    kernel = pixel_weights(optics.blur, optics.disc, 0.5 * (max(contact_radius, 1.0) + outer))
    start, distance = table_distances(inner, outer, optics.blur, len(kernel) // 2)
    spacing = 2.0 * math.pi / max(phase_slope(outer, contact_radius, optics), 1e-12)
    nodes, weights = exposure_nodes(travel, spacing)
    squares = contact_radius**2 + nodes * contact_radius * travel
    radii = np.sqrt(np.maximum(squares, 0.0))
    raw = np.zeros((11, len(distance)))
    second, turned, third = harmonics
    orders, further = np.arange(4, HIGHEST + 1), (turned == 0.0) * beyond_third(second, third)
    for node, weight, radius in zip(nodes, weights, radii, strict=True):
        by_distance, by_radius = scaled_slopes(distance, radius, optics.flat)
        lag = optics.phase_scale * (scaled_gap(distance, radius, optics.flat) - optics.focus * by_distance**2)
        by_focus = -optics.phase_scale * by_distance**2
        by_distance, by_radius = _out_of_focus(distance, radius, optics, by_distance, by_radius)
        shrunk = 1.0 / (1.0 - 2j * optics.skew * optics.spread * lag)
        wave = np.sqrt(shrunk) * np.exp(1j * (lag + optics.phase) - 0.5 * optics.spread * lag**2 * shrunk)
        # a harmonic leaves at twice the slope, and is behind by four times as much
        again = np.exp(2j * by_focus * optics.focus)
        wave = wave * (1.0 - BETWEEN_BEAMS * (second**2 + turned**2) * (again - 1.0))
        beams = wave / (1.0 - complex(second, turned) * again * wave)
        high = np.stack([wave**order for order in orders])
        steep = weight * (beams**2 / wave + 3.0 * third * wave**3 + (orders * further[:, 0]) @ high)
        sine = -steep.imag
        turned_by = 1j * optics.skew * optics.spread * lag * shrunk
        by_lag = 1j + (1j * optics.skew - lag * (1.0 + turned_by)) * optics.spread * shrunk
        by_spread = (1j * optics.skew - 0.5 * lag * (1.0 + 2.0 * turned_by)) * lag * shrunk
        by_gap = (steep * by_lag).real
        change = optics.phase_scale * by_radius * by_gap
        divisor = 2.0 * max(radius, 1e-6)
        raw[0] += weight * (beams + third * wave**3 + further[:, 0] @ high).real
        raw[6] += weight * (beams**2 * again + further[:, 1] @ high).real
        raw[7] -= weight * (beams**2 * again).imag
        raw[8] += weight * (wave**3 + further[:, 2] @ high).real
        raw[9] += (steep * by_spread).real
        turning = complex(second, turned) * beams**2 * again
        raw[10] += by_focus * (by_gap + 2.0 * weight * (1j * turning).real)
        raw[1] += optics.phase_scale * by_distance * by_gap
        raw[2] += change * (2.0 * contact_radius + node * travel) / divisor
        raw[3] += sine
        raw[4] += change * node * contact_radius / divisor
    averaged = np.stack([np.correlate(line, kernel, mode="valid") for line in raw])
    half = len(kernel) // 2
    middle = np.maximum(distance[half : half + averaged.shape[1]], 1.0)
    averaged[5] = 0.5 * (np.gradient(averaged[1], 1.0 / SAMPLES_PER_PIXEL) + averaged[1] / middle)
    return RadialTable(start, averaged)

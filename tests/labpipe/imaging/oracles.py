"""Plain numpy and scipy twins of the compiled kernels."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from labpipe.arrays import Floats, Integers
from labpipe.imaging.dic._spline import NODE_SLOPES, NODE_WEIGHTS
from labpipe.imaging.dic._subset_kernel import compose_with_inverse
from labpipe.imaging.dic._subset_solver import DEFAULT_ITERATIONS
from labpipe.imaging.dic._subsets import _RIGID_FROM_AFFINE
from labpipe.imaging.fringes._interference import SAMPLES_PER_PIXEL, Optics, radial_table
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
    max_iterations: int = DEFAULT_ITERATIONS,
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
    table = radial_table(
        ring.inner, ring.outer, float(radius), table_travel(parameters), phased, (second, turned, third)
    )
    table.values[0] += min(optics.blur**2 + more_blur, 0.0) * table.values[5] + min(spread, 0.0) * table.values[9]
    table = by_smear(table, parameters)
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

"""Sums over the pixels of a ring: normal equations, residuals, differences of neighbours."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from labpipe.arrays import Floats, Integers
from labpipe.imaging.fringes._interference import (
    SAMPLES_PER_PIXEL,
    Optics,
    RadialTable,
    exposure_nodes,
    phase_slope,
    pixel_weights,
    table_distances,
)
from labpipe.imaging.fringes._ring_noise import MOST_BINS, SECTORS
from labpipe.imaging.fringes._ring_parameters import HARMONICS, LIGHT, Parameter
from labpipe.imaging.fringes._ring_pixels import Ring

#: Travel (px) below which the effect of the smear is taken as proportional to its square, so that
#: noise may also make it negative.
_LEAST_TRAVEL = 0.3
#: Pixels of a cell in the mean, at least.
_PIXELS_PER_CELL = 8
_NO_LIMITS = np.empty(0)
#: Step of the square of a flat, as a share of that of the contact, by which its effect is told.
FLAT_STEP = 0.002
#: Variance of wavenumbers below which its effect is taken as proportional to it: that of a band 2 % wide.
LEAST_BAND = 2e-4


@dataclass(frozen=True)
class Sums:
    """Sums over the ring: normal equations, residuals, differences of neighbours."""

    normal: Floats
    right: Floats
    weighted: Floats
    squares: float
    pixels: int
    differences: float
    pairs: int


def tabulate(ring: Ring, parameters: Floats, free: Integers, optics: Optics) -> tuple[RadialTable, int]:
    """Radial table for the present parameters, by compiled loops, and its kind."""
    from labpipe.imaging.fringes._fit_kernel import PLAIN
    from labpipe.imaging.fringes._table_kernel import fill_table

    kind = kind_of_table(parameters, free)
    is_rich = kind > PLAIN
    radius, travel = float(parameters[Parameter.RADIUS]), table_travel(parameters)
    blur = math.sqrt(max(optics.blur**2 + float(parameters[Parameter.BLUR]), 0.0))
    kernel = pixel_weights(blur, optics.disc, 0.5 * (max(radius, 1.0) + ring.outer))
    start, distance = table_distances(ring.inner, ring.outer, blur, len(kernel) // 2)
    spacing = 2.0 * math.pi / max(phase_slope(ring.outer, radius, optics), 1e-12)
    nodes, weights = exposure_nodes(travel, spacing)
    phase = float(parameters[Parameter.PHASE])
    phase_scale = optics.phase_scale * math.exp(parameters[Parameter.SCALE]) / shrinkage(parameters)
    harmonics = tuple(float(parameters[p]) for p in HARMONICS)
    before = (0.0, 0.0, 0.0) if optics.by_camera else harmonics

    def of_scale(scale: float, flat: float = optics.flat) -> Floats:
        return fill_table(distance, radius, travel, nodes, weights, scale, phase, kernel, *before, is_rich, flat)

    spread = optics.spread + float(parameters[Parameter.SPREAD])
    values = _of_colours(of_scale, (1.0 + 0.5 * spread) * phase_scale, optics)
    plain = values[0].copy()
    if spread or Parameter.SPREAD in free:
        of_both = partial(_of_colours, of_scale, optics=optics)
        values = _of_band(of_both, phase_scale, values, optics.spread, spread)
        # a band even in wavelengths has a mean wavenumber that is larger by its variance: half of that is taken
        at = start + np.arange(values.shape[1]) / SAMPLES_PER_PIXEL
        values[-1] += 0.25 * (at * values[1] + radius * values[2])
    if Parameter.FLAT in free:
        step = FLAT_STEP * radius**2
        worn = partial(of_scale, flat=math.sqrt(optics.flat**2 + step))
        change = _of_colours(worn, (1.0 + 0.5 * spread) * phase_scale, optics)[0] - plain
        by_spread = values[9:] if len(values) > 9 else np.zeros((1, values.shape[1]))
        values = np.vstack([values[:9], by_spread, change / step])
    if is_rich:
        values[0] += min(optics.blur**2 + float(parameters[Parameter.BLUR]), 0.0) * values[5]
    table = by_smear(RadialTable(start, values), parameters)
    if is_rich and optics.by_camera:
        _distort(table.values, float(parameters[Parameter.SECOND]), float(parameters[Parameter.THIRD]))
    return table, kind


def _of_colours(of_scale: Callable[[float], Floats], phase_scale: float, optics: Optics) -> Floats:
    """Table in the light of one colour, or of two."""
    values, (ratio, share) = of_scale(phase_scale), optics.colour
    return values + share * (of_scale(ratio * phase_scale) - values) if share else values


def _of_band(
    of_scale: Callable[[float], Floats], phase_scale: float, middle: Floats, near: float, spread: float
) -> Floats:
    """Table in light whose wavenumbers have a variance, and its derivative by that in a line more.

    Three wavenumbers stand for all, as far apart as Gauss and Hermite lay them for a variance that is ``near``.
    """
    apart, mean = math.sqrt(3.0 * max(near, LEAST_BAND)), (1.0 + 0.5 * spread) * phase_scale
    sides = 0.5 * (of_scale((1.0 - apart) * mean) + of_scale((1.0 + apart) * mean)) - middle
    return np.vstack([middle + spread / apart**2 * sides, sides[:1] / apart**2])


def _distort(values: Floats, second: float, third: float) -> None:
    """Add the harmonics that a camera makes of light that is blurred by then."""
    light = values[0].copy()
    values[6], values[8] = 2.0 * light**2 - 1.0, (4.0 * light**2 - 3.0) * light
    values[0] += second * values[6] + third * values[8]
    steep = 1.0 + 4.0 * second * light + third * (12.0 * light**2 - 3.0)
    values[1:6] *= steep
    values[9:] *= steep


def shrinkage(parameters: Floats) -> float:
    """Factor by which stretch and shear reduce areas, so that the gap is that of equal area."""
    return 1.0 - float(parameters[Parameter.STRETCH]) ** 2 - float(parameters[Parameter.SHEAR]) ** 2


def kind_of_table(parameters: Floats, free: Integers) -> int:
    """Tell whether blur or harmonics are used, and whether light is uneven."""
    from labpipe.imaging.fringes._fit_kernel import PLAIN, RICH, UNEVEN

    if parameters[LIGHT[0] :].any() or (free >= LIGHT[0]).any():
        return UNEVEN
    return RICH if parameters[Parameter.BLUR :].any() or (free >= Parameter.BLUR).any() else PLAIN


def table_travel(parameters: Floats) -> float:
    """Travel at which a table is made."""
    return math.sqrt(max(float(parameters[Parameter.SMEAR]), _LEAST_TRAVEL**2))


def by_smear(table: RadialTable, parameters: Floats) -> RadialTable:
    """Change the derivative by travel into that by its square, and extrapolate down to it."""
    travel = table_travel(parameters)
    table.values[4] /= 2.0 * travel
    table.values[0] += (parameters[Parameter.SMEAR] - travel**2) * table.values[4]
    return table


@dataclass(frozen=True)
class Cells:
    """Sums over the cells of a ring: see the compiled loop."""

    sums: Floats
    counts: Floats
    scores: Floats
    normals: Floats
    pulls: Floats


def ring_cells(ring: Ring, parameters: Floats, free: Integers, optics: Optics, limits: Floats = _NO_LIMITS) -> Cells:
    """Sum residuals over the cells of a ring, and what parts between limits of distance say, by compiled loops."""
    from labpipe.imaging.fringes._cell_kernel import accumulate_cells

    table, kind = tabulate(ring, parameters, free, optics)
    pixels = math.pi * (ring.outer**2 - ring.inner**2) / ring.stride
    bins = max(4, min(MOST_BINS, int(ring.outer - ring.inner), int(pixels / (SECTORS * _PIXELS_PER_CELL))))
    model = parameters, ring.origin, table.values, table.start, free, ring.ceiling, kind
    return Cells(*accumulate_cells(*ring.region, *model, bins, SECTORS, limits))


def ring_sums(ring: Ring, parameters: Floats, free: Integers, optics: Optics, is_last: bool) -> Sums:
    """Sum over the ring, by compiled loops."""
    from labpipe.imaging.fringes._fit_kernel import accumulate

    table, kind = tabulate(ring, parameters, free, optics)
    normal, right, weighted, totals = accumulate(
        *ring.region, parameters, ring.origin, table.values, table.start, free, ring.ceiling, is_last, kind
    )
    squares, pixels, differences, pairs = totals
    return Sums(normal, right, weighted, squares, int(pixels), differences, int(pairs))

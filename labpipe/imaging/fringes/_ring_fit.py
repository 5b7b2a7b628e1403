"""Fit the interference pattern around a Hertz contact to the pixels of one frame."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.imaging.fringes._interference import (
    SAMPLES_PER_PIXEL,
    Optics,
    RadialTable,
    exposure_nodes,
    phase_slope,
    pixel_weights,
    radial_table,
    ring_limits,
    table_distances,
)
from labpipe.imaging.fringes._ring_noise import MOST_BINS, SECTORS, clustered, slow_power
from labpipe.uncertainty import excess_uncertainty


class Parameter(IntEnum):
    """Places in the vector of parameters; lengths in px, angles in rad, light in grey levels.

    The light is (GAIN + MODULATION · cos) (1 + SLOPE_X x + SLOPE_Y y + BOWL b), x and y and b of
    order 1 over the ring. STRETCH and SHEAR make circles elliptic. SMEAR is the square of the
    change of the radius during the exposure (px²), SCALE the logarithm of a factor of the phase
    scale. BLUR is the square of the blur (px²) beyond that of the optics, SECOND and THIRD are
    harmonics of the cosine (many beams, a camera that is not linear), LIGHT_ the higher powers of
    x and y in the light: x² - y², xy, x³, x²y, xy², y³.
    """

    RADIUS = 0
    X = 1
    Y = 2
    GAIN = 3
    MODULATION = 4
    SLOPE_X = 5
    SLOPE_Y = 6
    BOWL = 7
    PHASE = 8
    STRETCH = 9
    SHEAR = 10
    SMEAR = 11
    SCALE = 12
    BLUR = 13
    SECOND = 14
    THIRD = 15
    LIGHT_XX = 16
    LIGHT_XY = 17
    LIGHT_XXX = 18
    LIGHT_XXY = 19
    LIGHT_XYY = 20
    LIGHT_YYY = 21


#: Length of the vector of parameters.
PARAMETERS = len(Parameter)


#: What is fitted in every frame.
USUAL = (
    Parameter.RADIUS,
    Parameter.X,
    Parameter.Y,
    Parameter.GAIN,
    Parameter.MODULATION,
    Parameter.SLOPE_X,
    Parameter.SLOPE_Y,
    Parameter.BOWL,
    Parameter.SMEAR,
)

#: Harmonics of the interference, and the higher powers of place in the light.
HARMONICS = (Parameter.SECOND, Parameter.THIRD)
LIGHT = tuple(p for p in Parameter if p.name.startswith("LIGHT_"))

#: What is taken for granted in a frame; the fit tells how the radius depends on it.
ASSUMED = (Parameter.PHASE, Parameter.SCALE)

#: Damping at the start (so small that a radius which hardly differs from a shift of the centre is
#: not held back), least after a bad step, and its change after good and bad steps.
_DAMPING, _BAD_DAMPING, _LESS, _MORE, _MOST_DAMPING = 1e-8, 1e-3, 0.01, 10.0, 1e6
#: Travel (px) below which the effect of the smear is taken as proportional to its square, so that
#: noise may also make it negative.
_LEAST_TRAVEL = 0.3
#: Pixels left out at the border of the frame, in standard deviations of the blur.
_BORDER = 2.0
#: Distance (px) from saturated pixels up to which others are left out: more takes whole fringes away.
_NEAR = 1
#: Expected gain of a step, in variances of a pixel, below which the iteration ends: the fit is then
#: within a tenth of its uncertainty of the minimum, and the step itself is still made.
_SMALL_GAIN = 0.01
#: Share of the errors of the model that noise with a memory must reach to be told from them.
_OWN_SHARE = 0.3
#: Misfit from which noise with a memory is looked for, and from which nothing is explained.
_NOTABLE_MISFIT, _HOPELESS_MISFIT = 0.01, 1.0
#: Standard deviations by which the residual exceeds the noise before that counts as an error of
#: the model; their ratio, squared, scatters by one over the root of the number of pixels.
_BY_CHANCE = 5.0
#: Greatest logarithm of the phase scale, stretch and shear, and square of the blur (px²) in an
#: iteration: far beyond any view.
_MOST_LOG_SCALE, _MOST_OBLIQUE, _MOST_BLUR = 1.0, 0.5, 150.0


@dataclass(frozen=True)
class FitSettings:
    """How a frame is fitted.

    Attributes
    ----------
    fringes : float
        Fringes used, half a wavelength of gap each. Three hold nearly all that is known about
        the radius; more of them multiply the effect of an error in R or the wavelength.
    least_spacing : float [px]
        Finest fringes used; below two pixels they alias.
    free : tuple of Parameter
        What is fitted.
    max_pixels : int
        Rows are left out evenly when the ring holds more pixels.
    max_iterations : int
        Evaluations of the ring.
    tolerance : float [px]
        Step of radius and centre at which the iteration ends even where there is no noise.
    tells_memory : bool
        Tell noise with a memory from errors of the model; a fit of which only the residual counts
        needs it not.
    is_compiled : bool
        Use the compiled loops (the others are there to test them).
    """

    fringes: float = 3.0
    least_spacing: float = 2.0
    free: tuple[Parameter, ...] = USUAL
    max_pixels: int = 100_000
    max_iterations: int = 25
    tolerance: float = 2e-4
    tells_memory: bool = True
    is_compiled: bool = True


@dataclass(frozen=True)
class RingFit:
    """Result of a fit.

    Attributes
    ----------
    parameters : array (13,)
        See :class:`Parameter`.
    free : tuple of Parameter
        Those that were fitted.
    covariance : array (free, free)
        From the residuals, pixel by pixel, so that it holds for any noise without memory.
    sensitivity : dict
        Change of the radius (px) per change of each of :data:`ASSUMED` that was not fitted.
    residual, noise : float [grey levels]
        Root mean square residual, and the noise seen between neighbours along the rings.
    pixels : int
        Pixels used.
    leverage : float [px per grey level]
        Change of the radius by a pattern of errors of unit length that pulls at it most: its
        uncertainty is this times the noise.
    is_converged : bool
        False when the iteration did not settle or left the frame.
    evaluations : int
        Evaluations of the ring.
    inverse : array (free, free)
        Of the normal matrix.
    between : float [grey levels]
        Noise between neighbours along the rings, also where noise has a memory.
    slow : float or None [grey levels]
        Root mean square of the residual that changes slowly along the rings, an error of the
        model; None where the noise between neighbours tells it.
    curvature : float [px²]
        Half the difference of the squares of the ring's limits, in which BOWL is told.
    spread : float [px]
        What is known from elsewhere about errors of the model, as a standard uncertainty.
    """

    parameters: Floats
    free: tuple[Parameter, ...]
    covariance: Floats
    sensitivity: dict[Parameter, float]
    residual: float
    noise: float
    pixels: int
    leverage: float
    is_converged: bool
    evaluations: int
    inverse: Floats
    between: float
    curvature: float
    slow: float | None = None
    spread: float = 0.0

    def deviation(self, parameter: Parameter) -> float:
        """Return the standard uncertainty from noise; 0 for what was not fitted."""
        if parameter not in self.free:
            return 0.0
        place = self.free.index(parameter)
        return math.sqrt(max(float(self.covariance[place, place]), 0.0))

    @property
    def model_deviation(self) -> float:
        """Shift of the radius (px) that errors of the model may cause, 0 when none are seen.

        Errors as large as what the fit leaves beyond noise, in the pattern that moves the radius
        most. Measured: 0.1 to 1 of it for blur, light of low coherence, and gaps that are not
        Hertz's.
        """
        if self.slow is not None:
            return math.hypot(self.slow * math.sqrt(self.pixels) * self.leverage, self.spread)
        by_chance = _BY_CHANCE / math.sqrt(max(self.pixels, 1))
        excess = self.residual**2 - self.noise**2 * (1.0 + by_chance)
        return math.hypot(math.sqrt(max(excess, 0.0) * self.pixels) * self.leverage, self.spread)

    @property
    def misfit(self) -> float:
        """Residual beyond the noise as a share of the modulation [1]."""
        modulation = abs(float(self.parameters[Parameter.MODULATION]))
        excess = excess_uncertainty(self.residual, self.noise)
        return excess / max(modulation, 1e-12)


@dataclass(frozen=True)
class Ring:
    """The pixels of one fit: a piece of the frame, two distances, and every how many rows."""

    image: Floats32
    first_row: int
    first_column: int
    stride: int
    inner: float
    outer: float
    origin: Floats
    ceiling: float


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


def pixels_in_ring(shape: tuple[int, int], x: float, y: float, inner: float, outer: float) -> int:
    """Count, to a row's rounding, the pixels of a frame between two distances."""
    dy = np.arange(shape[0]) - y

    def inside(distance: float) -> float:
        half = np.sqrt(np.maximum(distance**2 - dy**2, 0.0))
        right = np.minimum(x + half, shape[1] - 0.5)
        return float(np.maximum(right - np.maximum(x - half, -0.5), 0.0).sum())

    return int(inside(outer) - inside(inner))


def cut_ring(
    frame: NDArray[np.generic],
    start: Floats,
    inner: float,
    outer: float,
    ceiling: float,
    max_pixels: int,
    margin: int = 0,
) -> Ring | None:
    """Cut the piece of a frame that holds a ring, or None when they do not meet.

    Pixels that are less than ``margin`` from the border of the frame are left out.
    """
    rows, columns = frame.shape
    x, y = start[Parameter.X], start[Parameter.Y]
    slack = 2.0 + outer * (abs(start[Parameter.STRETCH]) + abs(start[Parameter.SHEAR]))
    top = max(margin, math.floor(y - outer - slack))
    bottom = min(rows - margin, math.ceil(y + outer + slack) + 1)
    left = max(margin, math.floor(x - outer - slack))
    right = min(columns - margin, math.ceil(x + outer + slack) + 1)
    if bottom - top < 2 or right - left < 2:
        return None
    count = pixels_in_ring((rows, columns), float(x), float(y), inner, outer)
    stride = max(1, math.ceil(count / max_pixels))
    piece = _without_neighbours(np.ascontiguousarray(frame[top:bottom, left:right], np.float32), ceiling)
    middle, spread = 0.5 * (outer**2 + inner**2), 0.5 * (outer**2 - inner**2)
    origin = np.array([x, y, outer, middle / outer**2, outer**2 / spread])
    return Ring(piece, top, left, stride, inner, outer, origin, ceiling)


def _without_neighbours(piece: Floats32, ceiling: float) -> Floats32:
    """Set what lies near saturated pixels to the ceiling, so that it is left out with them.

    Noise decides which of the pixels just below the ceiling reach it: those that do not are darker than
    their light in the mean.
    """
    import cv2

    is_saturated = (piece >= ceiling).astype(np.uint8)
    if not is_saturated.any():
        return piece
    near = cv2.dilate(is_saturated, np.ones((2 * _NEAR + 1, 2 * _NEAR + 1), np.uint8))
    return np.where(near > 0, np.float32(ceiling), piece)


def tabulate(ring: Ring, parameters: Floats, optics: Optics, *, is_rich: bool) -> RadialTable:
    """Radial table for the present parameters, by compiled loops."""
    from labpipe.imaging.fringes._fit_kernel import fill_table

    radius, travel = float(parameters[Parameter.RADIUS]), _travel(parameters)
    blur = math.sqrt(max(optics.blur**2 + float(parameters[Parameter.BLUR]), 0.0))
    start, distance = table_distances(ring.inner, ring.outer, blur)
    spacing = 2.0 * math.pi / max(phase_slope(ring.outer, radius, optics), 1e-12)
    nodes, weights = exposure_nodes(travel, spacing)
    phase = float(parameters[Parameter.PHASE])
    phase_scale = optics.phase_scale * math.exp(parameters[Parameter.SCALE]) / _shrinkage(parameters)
    kernel = pixel_weights(blur)
    second, third = (float(parameters[p]) for p in HARMONICS)
    values = fill_table(
        distance, radius, travel, nodes, weights, phase_scale, phase, kernel, second, third, is_rich, optics.flat
    )
    if is_rich:
        values[0] += min(optics.blur**2 + float(parameters[Parameter.BLUR]), 0.0) * values[5]
    return by_smear(RadialTable(start, values), parameters)


def _shrinkage(parameters: Floats) -> float:
    """Factor by which stretch and shear reduce areas, so that the gap is that of equal area."""
    return 1.0 - float(parameters[Parameter.STRETCH]) ** 2 - float(parameters[Parameter.SHEAR]) ** 2


def _is_rich(parameters: Floats, free: Integers) -> bool:
    """Tell whether blur, harmonics or higher powers of the light are used."""
    return bool(parameters[Parameter.BLUR :].any() or (free >= Parameter.BLUR).any())


def _travel(parameters: Floats) -> float:
    """Travel at which a table is made."""
    return math.sqrt(max(float(parameters[Parameter.SMEAR]), _LEAST_TRAVEL**2))


def by_smear(table: RadialTable, parameters: Floats) -> RadialTable:
    """Change the derivative by travel into that by its square, and extrapolate down to it."""
    travel = _travel(parameters)
    table.values[4] /= 2.0 * travel
    table.values[0] += (parameters[Parameter.SMEAR] - travel**2) * table.values[4]
    return table


def compiled_sums(ring: Ring, parameters: Floats, free: Integers, optics: Optics, is_last: bool) -> Sums:
    """Sum over the ring by compiled loops."""
    from labpipe.imaging.fringes._fit_kernel import accumulate

    is_rich = _is_rich(parameters, free)
    table = tabulate(ring, parameters, optics, is_rich=is_rich)
    normal, right, weighted, totals = accumulate(
        ring.image,
        ring.first_row,
        ring.first_column,
        ring.stride,
        ring.inner,
        ring.outer,
        parameters,
        ring.origin,
        table.values,
        table.start,
        free,
        ring.ceiling,
        is_last,
        is_rich,
    )
    squares, pixels, differences, pairs = totals
    return Sums(normal, right, weighted, squares, int(pixels), differences, int(pairs))


def plain_sums(ring: Ring, parameters: Floats, free: Integers, optics: Optics, is_last: bool) -> Sums:
    """Sum over the ring by array operations: the reference for :func:`compiled_sums`."""
    radius, x_centre, y_centre, gain, modulation, slope_x, slope_y, bowl = parameters[:8]
    stretch, shear, _, scale, more_blur, second, third = parameters[Parameter.STRETCH : Parameter.LIGHT_XX]
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
        phase_scale=optics.phase_scale * math.exp(scale) / _shrinkage(parameters),
        blur=math.sqrt(max(optics.blur**2 + more_blur, 0.0)),
    )
    harmonics = (float(second), float(third))
    table = radial_table(ring.inner, ring.outer, float(radius), _travel(parameters), phased, harmonics)
    table.values[0] += min(optics.blur**2 + more_blur, 0.0) * table.values[5]
    table = by_smear(table, parameters)
    places = table.start + np.arange(table.values.shape[1]) / SAMPLES_PER_PIXEL
    lines = (np.interp(r[used], places, line) for line in table.values)
    term, by_r, by_radius, by_phase, by_square, by_blur, two, three = lines
    across = (x[used] + ring.first_column - ring.origin[0]) / ring.origin[2]
    down = (y[used] + ring.first_row - ring.origin[1]) / ring.origin[2]
    curve = (across**2 + down**2 - ring.origin[3]) * ring.origin[4]
    powers = np.stack([across**2 - down**2, across * down, across**3, across**2 * down, across * down**2, down**3])
    light = 1.0 + slope_x * across + slope_y * down + bowl * curve + parameters[list(LIGHT)] @ powers
    core = gain + modulation * term
    u, v, dx, dy, distance = u[used], v[used], dx[used], dy[used], np.maximum(r[used], 1e-9)
    steep = modulation * light * by_r / distance
    slopes = np.stack(
        [
            modulation * light * by_radius,
            -steep * (u * (1.0 + stretch) + v * shear),
            -steep * (v * (1.0 - stretch) + u * shear),
            light,
            light * term,
            across * core,
            down * core,
            curve * core,
            modulation * light * by_phase,
            steep * (u * dx - v * dy),
            steep * (u * dy + v * dx),
            modulation * light * by_square,
            0.5 * modulation * light * (r[used] * by_r + radius * by_radius),
            modulation * light * by_blur,
            modulation * light * two,
            modulation * light * three,
            *(powers * core),
        ]
    )[free]
    residual = grey[used] - light * core
    differences, pairs = 0.0, 0
    if is_last:
        whole = np.full(r.shape, np.nan)
        whole[used] = residual
        wide = x + ring.first_column - x_centre
        high = y + ring.first_row - y_centre
        steps = _steps_along(whole, wide, high, ring.stride)
        differences, pairs = float((steps**2).sum()), len(steps)
    return Sums(
        slopes @ slopes.T,
        slopes @ residual,
        (slopes * residual**2) @ slopes.T,
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


def fit_ring(ring: Ring, start: Floats, optics: Optics, settings: FitSettings) -> RingFit:
    """Least squares over the pixels of a ring, by damped Gauss–Newton steps.

    Parameters
    ----------
    ring : Ring
        The pixels.
    start : array (13,)
        Parameters to start from, right to a third of a fringe.
    optics : Optics
        The interference; its phase is replaced by that of the parameters.
    settings : FitSettings
        What is fitted and how.
    """
    sums_of: Callable[..., Sums] = compiled_sums if settings.is_compiled else plain_sums
    free = np.array(settings.free, np.int64)
    reported = np.array([*settings.free, *(p for p in ASSUMED if p not in settings.free)], np.int64)
    moves = np.isin(free, (Parameter.RADIUS, Parameter.X, Parameter.Y))
    best = start.astype(float).copy()
    damping, evaluations, is_settled, is_small = _DAMPING, 1, False, False
    sums = sums_of(ring, best, free, optics, False)
    while evaluations < settings.max_iterations and damping < _MOST_DAMPING:
        if sums.pixels <= len(free):
            break
        step = _solve(sums, damping)
        if step is None:
            break
        trial = best.copy()
        trial[free] += step
        if not _is_possible(trial) or trial[Parameter.RADIUS] > ring.outer:
            damping = max(damping * _MORE, _BAD_DAMPING)
            continue
        gain = float(sums.right @ step) * sums.pixels
        is_small = damping < _BAD_DAMPING and (
            gain < _SMALL_GAIN * sums.squares or np.abs(step[moves]).max() < settings.tolerance
        )
        tried = sums_of(ring, trial, reported if is_small else free, optics, is_small)
        evaluations += 1
        # The pixels at the limits change with the centre: means are compared, not sums.
        if is_small or tried.squares * sums.pixels <= sums.squares * tried.pixels:
            best, sums, damping = trial, tried, damping * _LESS
        elif gain < sums.squares:
            # What is left is less than one variance: pixels that come and go at the limits.
            is_settled = True
            break
        else:
            damping = max(damping * _MORE, _BAD_DAMPING)
        if is_small:
            is_settled = True
            break
    if not is_small:
        sums = sums_of(ring, best, reported, optics, True)
        evaluations += 1
    curvature = 0.5 * (ring.outer**2 - ring.inner**2)
    found = _result(best, sums, settings.free, is_settled, evaluations, curvature)
    return _with_memory(found, ring, optics) if settings.tells_memory else found


def _with_memory(fit: RingFit, ring: Ring, optics: Optics) -> RingFit:
    """Count as noise what changes along the rings, where more is left than pixels scatter alone."""
    if not _NOTABLE_MISFIT <= fit.misfit < _HOPELESS_MISFIT or fit.model_deviation == 0.0:
        return fit
    from labpipe.imaging.fringes._fit_kernel import accumulate_cells

    free = np.array(fit.free, np.int64)
    is_rich = _is_rich(fit.parameters, free)
    table = tabulate(ring, fit.parameters, optics, is_rich=is_rich)
    sums, counts, scores = accumulate_cells(
        ring.image,
        ring.first_row,
        ring.first_column,
        ring.stride,
        ring.inner,
        ring.outer,
        fit.parameters,
        ring.origin,
        table.values,
        table.start,
        free,
        ring.ceiling,
        is_rich,
        max(4, min(MOST_BINS, int(ring.outer - ring.inner))),
        SECTORS,
    )
    power = slow_power(sums, counts)
    beyond = fit.residual**2 - fit.noise**2
    if power is None or beyond - power < _OWN_SHARE * power:
        return fit  # errors of the model make up nearly all of it
    covariance = clustered(scores, fit.inverse)
    place = fit.free.index(Parameter.RADIUS) if Parameter.RADIUS in fit.free else 0
    if covariance[place, place] < fit.covariance[place, place]:
        covariance = fit.covariance
    return replace(fit, noise=math.sqrt(fit.residual**2 - power), covariance=covariance, slow=math.sqrt(power))


def _is_possible(parameters: Floats) -> bool:
    """Tell whether an iteration has not run away."""
    oblique = np.abs(parameters[[Parameter.STRETCH, Parameter.SHEAR]]).max()
    return bool(
        np.isfinite(parameters).all()
        and parameters[Parameter.RADIUS] >= 0.0
        and abs(parameters[Parameter.SCALE]) <= _MOST_LOG_SCALE
        and oblique <= _MOST_OBLIQUE
        and parameters[Parameter.BLUR] <= _MOST_BLUR
    )


def _solve(sums: Sums, damping: float) -> Floats | None:
    """Step of the damped normal equations, scaled by their diagonal; None when they have none."""
    scale = np.sqrt(np.maximum(np.diag(sums.normal), 1e-300))
    matrix = sums.normal / np.outer(scale, scale)
    matrix[np.diag_indices_from(matrix)] += damping
    try:
        return np.asarray(np.linalg.solve(matrix, sums.right / scale) / scale)
    except np.linalg.LinAlgError:
        return None


def _result(
    parameters: Floats, sums: Sums, free: tuple[Parameter, ...], is_converged: bool, evaluations: int, curvature: float
) -> RingFit:
    """Covariance, residuals and sensitivities at the end of an iteration."""
    count = len(free)
    spare = max(sums.pixels - count, 1)
    residual = math.sqrt(sums.squares / spare)
    noise = math.sqrt(sums.differences / (2.0 * sums.pairs)) if sums.pairs else residual
    scale = np.sqrt(np.maximum(np.diag(sums.normal)[:count], 1e-300))
    outer = np.outer(scale, scale)
    inverse = np.linalg.pinv(sums.normal[:count, :count] / outer) / outer
    covariance = inverse @ sums.weighted[:count, :count] @ inverse
    changes = inverse @ sums.normal[:count, count:]
    place = free.index(Parameter.RADIUS) if Parameter.RADIUS in free else None
    assumed = [parameter for parameter in ASSUMED if parameter not in free]
    sensitivity = dict.fromkeys(ASSUMED, 0.0)
    if place is not None:
        sensitivity |= {p: float(changes[place, k]) for k, p in enumerate(assumed)}
    return RingFit(
        parameters,
        free,
        covariance,
        sensitivity,
        residual,
        noise,
        sums.pixels,
        0.0 if place is None else math.sqrt(max(float(inverse[place, place]), 0.0)),
        is_converged,
        evaluations,
        inverse,
        noise,
        curvature,
    )


def fit_contact(
    frame: NDArray[np.generic], start: Floats, optics: Optics, settings: FitSettings, ceiling: float = math.inf
) -> RingFit | None:
    """Fit one frame with the ring laid around the start.

    Parameters
    ----------
    frame : array (row, column)
        Grey levels.
    start : array (13,)
        Parameters to start from.
    optics : Optics
        The interference.
    settings : FitSettings
        What is fitted and how.
    ceiling : float, optional
        Grey level from which a pixel is saturated and left out.

    Returns
    -------
    RingFit or None
        None when the ring lies outside the frame.
    """
    radius = float(start[Parameter.RADIUS])
    inner, outer = ring_limits(radius, optics, settings.fringes, settings.least_spacing)
    # A filter of the camera or of a program makes up what lies beyond the border.
    margin = math.ceil(_BORDER * optics.blur)
    ring = cut_ring(frame, start, inner, outer, ceiling, settings.max_pixels, margin)
    return None if ring is None else fit_ring(ring, start, optics, settings)

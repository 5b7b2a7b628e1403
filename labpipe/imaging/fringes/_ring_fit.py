"""Least-squares fit of the interference pattern around a Hertz contact to the pixels of one frame."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.imaging.fringes._ring_model import (
    Optics,
    distance_at_phase,
    exposure_nodes,
    phase_of_gap,
    pixel_weights,
    ring_limits,
    table_distances,
)
from labpipe.uncertainty import excess_uncertainty


class Parameter(IntEnum):
    """Places in the vector of parameters; lengths in px, angles in rad, light in grey levels.

    The light is (GAIN + MODULATION · term) (1 + SLOPE_X x + SLOPE_Y y + BOWL b + SADDLE (x² - y²) + CROSS x y), x and
    y and b of order 1 over the ring. STRETCH and SHEAR make circles elliptic. SMEAR is the square of the change of
    the radius during the exposure (px²). SCALE is the logarithm of a factor of the phase scale of the optics; what is
    added to them are BLUR, to its square (px²), BEAMS and SPREAD, and FLAT, to its fourth power (px⁴), with which the
    gap changes. BEND, which is never fitted, is half the second derivative of a² by time, times the square of half the
    exposure (px²).
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
    SADDLE = 13
    CROSS = 14
    BLUR = 15
    BEAMS = 16
    SPREAD = 17
    FLAT = 18
    BEND = 19


CIRCLE = (Parameter.RADIUS, Parameter.X, Parameter.Y)
#: Parameters that are fitted in every frame.
_OWN_LIGHT = (Parameter.GAIN, Parameter.MODULATION, Parameter.SLOPE_X, Parameter.SLOPE_Y, Parameter.BOWL)
USUAL = (*CIRCLE, *_OWN_LIGHT, Parameter.SMEAR)
AXES = (Parameter.STRETCH, Parameter.SHEAR)
LIGHT = (Parameter.SADDLE, Parameter.CROSS)
#: Properties of the optics by which the radial table is differentiated numerically.
OPTICAL = (Parameter.BLUR, Parameter.BEAMS, Parameter.SPREAD, Parameter.FLAT)
#: Parameters that are taken as known in every frame.
ASSUMED = (Parameter.PHASE, Parameter.SCALE)

#: Damping at the start (so small that a radius which hardly differs from a shift of the centre is not held back),
#: least after a bad step, and its change after good and bad steps.
_DAMPING, _BAD_DAMPING, _LESS, _MORE, _MOST_DAMPING = 1e-8, 1e-3, 0.01, 10.0, 1e6
#: Travel (px) below which the effect of the smear is taken as proportional to its square, so that noise may also
#: make it negative.
_LEAST_TRAVEL = 0.3


@dataclass(frozen=True)
class FitSettings:
    """Settings of the fit of a frame.

    ``fringes``, half a wavelength of gap each, are used down to a ``least_spacing`` (px): below two pixels they alias.
    Rows are left out evenly when a ring holds more than ``max_pixels``. An iteration is an evaluation of the ring.
    ``assumed`` are parameters that are taken as known in a frame; the fit returns how the radius depends on them.
    """

    fringes: float = 3.0
    least_spacing: float = 2.0
    free: tuple[Parameter, ...] = USUAL
    assumed: tuple[Parameter, ...] = ASSUMED
    max_pixels: int = 100_000
    max_iterations: int = 25

    @property
    def quick(self) -> "FitSettings":
        """The same on fewer pixels, for a first look."""
        return replace(self, max_pixels=12_000, max_iterations=12)


@dataclass(frozen=True)
class RingFit:
    """Result of a fit.

    ``covariance`` (free, free): sandwich estimate from the residuals, summed over blocks of pixels that may share their
    noise. ``sensitivity``: change of the radius (px) per change of each assumed parameter.
    ``residual``, ``noise`` [grey levels]: root mean square residual, and the noise between neighbours along the rings.
    ``is_converged``: False when the iteration did not settle or left the frame. ``evaluations``: of the ring.
    ``model_deviation`` [px]: standard uncertainty of the radius from errors of the model.
    """

    parameters: Floats
    free: tuple[Parameter, ...]
    covariance: Floats
    sensitivity: dict[Parameter, float]
    residual: float
    noise: float
    pixels: int
    is_converged: bool
    evaluations: int
    model_deviation: float = 0.0

    def value(self, parameter: Parameter) -> float:
        """Return one parameter."""
        return float(self.parameters[parameter])

    @property
    def radius(self) -> float:
        """Contact radius [px]."""
        return float(self.parameters[Parameter.RADIUS])

    @property
    def centre(self) -> tuple[float, float]:
        """Column and row of the centre [px]."""
        return float(self.parameters[Parameter.X]), float(self.parameters[Parameter.Y])

    @property
    def travel(self) -> float:
        """Change of the radius during the exposure, without sign [px]."""
        return math.sqrt(max(float(self.parameters[Parameter.SMEAR]), 0.0))

    def visibility(self, black: float) -> float:
        """Return the visibility of the fringes, for a grey level of darkness."""
        return abs(self.value(Parameter.MODULATION)) / max(self.value(Parameter.GAIN) - black, 1e-12)

    def deviation(self, parameter: Parameter) -> float:
        """Return the standard uncertainty from noise; 0 for a parameter that was not fitted."""
        if parameter not in self.free:
            return 0.0
        place = self.free.index(parameter)
        return math.sqrt(max(float(self.covariance[place, place]), 0.0))

    @property
    def is_doubtful(self) -> bool:
        """Whether the residual exceeds the noise by more than chance: the square of their ratio scatters by √(2/n)."""
        by_chance = 5.0 / math.sqrt(max(self.pixels, 1))
        return self.residual**2 > self.noise**2 * (1.0 + by_chance)

    @property
    def misfit(self) -> float:
        """Residual beyond the noise as a share of the modulation [1]."""
        modulation = abs(self.value(Parameter.MODULATION))
        return excess_uncertainty(self.residual, self.noise) / max(modulation, 1e-12)


@dataclass(frozen=True)
class Ring:
    """Pixels of one fit: a piece of the frame with its corner and stride, two distances, and units of the light."""

    image: Floats32
    corner: tuple[int, int, int]
    inner: float
    outer: float
    origin: Floats
    ceiling: float


@dataclass(frozen=True)
class Sums:
    """Sums over the ring: normal equations, products of scores, residuals, differences of neighbours."""

    normal: Floats
    right: Floats
    middle: Floats
    squares: float
    pixels: int
    differences: float
    pairs: int


def cut_ring(
    frame: NDArray[np.generic], start: Floats, inner: float, outer: float, ceiling: float, max_pixels: int
) -> Ring | None:
    """Cut the piece of a frame (row, column) that holds a ring, or None when they do not meet."""
    rows, columns = frame.shape
    x, y = float(start[Parameter.X]), float(start[Parameter.Y])
    slack = 2.0 + outer * (abs(start[Parameter.STRETCH]) + abs(start[Parameter.SHEAR]))
    top, bottom = max(0, math.floor(y - outer - slack)), min(rows, math.ceil(y + outer + slack) + 1)
    left, right = max(0, math.floor(x - outer - slack)), min(columns, math.ceil(x + outer + slack) + 1)
    if bottom - top < 2 or right - left < 2:
        return None
    dy = np.arange(rows) - y
    count = 0.0
    for distance, sign in ((outer, 1.0), (inner, -1.0)):
        half = np.sqrt(np.maximum(distance**2 - dy**2, 0.0))
        width = np.minimum(x + half, columns - 0.5) - np.maximum(x - half, -0.5)
        count += sign * float(np.maximum(width, 0.0).sum())
    stride = max(1, math.ceil(count / max_pixels))
    piece = np.ascontiguousarray(frame[top:bottom, left:right], np.float32)
    middle, spread = 0.5 * (outer**2 + inner**2), 0.5 * (outer**2 - inner**2)
    origin = np.array([x, y, outer, middle / outer**2, outer**2 / spread])
    return Ring(piece, (top, left, stride), inner, outer, origin, ceiling)


def changed_optics(optics: Optics, parameters: Floats) -> Optics:
    """Return optics with the phase of a vector of parameters, and with its changes."""
    p = parameters
    return Optics(
        optics.phase_scale * math.exp(p[Parameter.SCALE]),
        float(p[Parameter.PHASE]),
        math.sqrt(max(optics.blur**2 + float(p[Parameter.BLUR]), 0.0)),
        min(max(optics.beams + float(p[Parameter.BEAMS]), -0.8), 0.8),
        max(optics.spread + float(p[Parameter.SPREAD]), 0.0),
        max(optics.flat**4 + float(p[Parameter.FLAT]), 0.0) ** 0.25,
    )


def tabulate(
    limits: tuple[float, float], parameters: Floats, optics: Optics, active: Sequence[int] | Integers = ()
) -> tuple[float, Floats]:
    """Radial table (line, sample) of the interference term and its derivatives, with the distance of its first sample.

    The derivatives are by distance, contact radius, phase, and the square of the travel, from which the term is
    extrapolated to small travels; where any of :data:`OPTICAL` are active, four more lines are those by them.
    """
    start, table = _table(limits, parameters, optics)
    steps = {
        Parameter.BLUR: 0.1,
        Parameter.BEAMS: 0.01,
        Parameter.SPREAD: 1e-4,
        Parameter.FLAT: (0.3 * float(parameters[Parameter.RADIUS])) ** 4,
    }
    used = sorted(set(OPTICAL).intersection(map(int, active)))
    lines = np.zeros((len(OPTICAL) if used else 0, table.shape[1]))
    for parameter in used:
        moved = parameters.copy()
        moved[parameter] += steps[parameter]
        difference = _table(limits, moved, optics)[1][0] - table[0]
        lines[parameter - Parameter.BLUR] = difference / steps[parameter]
    return start, np.concatenate([table, lines])


def _table(limits: tuple[float, float], parameters: Floats, optics: Optics) -> tuple[float, Floats]:
    """Return the first five lines of a table."""
    from labpipe.imaging.fringes._kernels import fill_table

    inner, outer = limits
    radius, smear = float(parameters[Parameter.RADIUS]), float(parameters[Parameter.SMEAR])
    travel = math.sqrt(max(smear, _LEAST_TRAVEL**2))
    spacing = 2.0 * math.pi / max(phase_of_gap(outer, radius, optics)[1], 1e-12)
    nodes, weights = exposure_nodes(travel, spacing)
    seen = changed_optics(optics, parameters)
    start, distance = table_distances(inner, outer, seen.blur)
    # Stretch and shear reduce areas: the gap is that of equal area.
    area = 1.0 - float(parameters[Parameter.STRETCH]) ** 2 - float(parameters[Parameter.SHEAR]) ** 2
    wave = seen.phase_scale / area, seen.phase, seen.flat, seen.spread, seen.beams
    motion = travel, float(parameters[Parameter.BEND])
    table = fill_table(distance, radius, motion, nodes, weights, wave, pixel_weights(seen.blur))
    table[4] /= 2.0 * travel
    table[0] += (smear - travel**2) * table[4]
    return start, table


def ring_sums(
    ring: Ring,
    parameters: Floats,
    active: Integers,
    optics: Optics,
    scored: int = 0,
    part: tuple[float, float] | None = None,
) -> Sums:
    """Sum over the ring, or over a part of it between two distances; scores and noise where some are ``scored``."""
    from labpipe.imaging.fringes._kernels import accumulate

    limits = ring.inner, ring.outer
    start, table = tabulate(limits, parameters, optics, active)
    normal, right, middle, totals = accumulate(
        ring.image, ring.corner, part or limits, parameters, ring.origin, table, start, active, ring.ceiling, scored
    )
    return Sums(normal, right, middle, totals[0], int(totals[1]), totals[2], int(totals[3]))


def fit_ring(ring: Ring, start: Floats, optics: Optics, settings: FitSettings) -> RingFit:
    """Least squares over the pixels of a ring, by damped Gauss–Newton steps.

    The start must be right to a third of a fringe; the phase of the optics is replaced by that of the parameters.
    """
    free = np.array(settings.free, np.int64)
    reported = np.array([*settings.free, *(p for p in settings.assumed if p not in settings.free)], np.int64)
    moves = np.isin(free, CIRCLE)
    best = start.astype(float).copy()
    damping, evaluations, is_settled, is_reported = _DAMPING, 1, False, False
    sums = ring_sums(ring, best, free, optics)
    while evaluations < settings.max_iterations and damping < _MOST_DAMPING and sums.pixels > len(free):
        # the damped normal equations, scaled by their diagonal; the iteration ends when they have no solution
        scale = np.sqrt(np.maximum(np.diag(sums.normal), 1e-300))
        matrix = sums.normal / np.outer(scale, scale)
        matrix[np.diag_indices_from(matrix)] += damping
        try:
            step = np.linalg.solve(matrix, sums.right / scale) / scale
        except np.linalg.LinAlgError:
            break
        trial = best.copy()
        trial[free] += step
        has_run_away = abs(trial[Parameter.SCALE]) > 1.0 or np.abs(trial[list(AXES)]).max() > 0.5
        if has_run_away or not (np.isfinite(trial).all() and 0.0 <= trial[Parameter.RADIUS] <= ring.outer):
            damping = max(damping * _MORE, _BAD_DAMPING)
            continue
        # The iteration ends when a step gains less than a hundredth of the variance of a pixel: it is then within a
        # tenth of its uncertainty of the minimum. The step itself is still made.
        gain = float(sums.right @ step) * sums.pixels
        is_small = damping < _BAD_DAMPING and (gain < 0.01 * sums.squares or np.abs(step[moves]).max() < 2e-4)
        tried = ring_sums(ring, trial, reported if is_small else free, optics, len(free) if is_small else 0)
        evaluations += 1
        # The pixels at the limits change with the centre: means are compared, not sums.
        if is_small or tried.squares * sums.pixels <= sums.squares * tried.pixels:
            best, sums, damping = trial, tried, damping * _LESS
            is_reported = is_settled = is_small
        elif gain < sums.squares:
            is_settled = True  # what is left is less than one variance: pixels that come and go at the limits
        else:
            damping = max(damping * _MORE, _BAD_DAMPING)
        if is_settled:
            break
    if not is_reported:
        sums = ring_sums(ring, best, reported, optics, len(free))
        evaluations += 1
    return _result(best, sums, settings, is_settled, evaluations)


def _result(parameters: Floats, sums: Sums, settings: FitSettings, is_converged: bool, evaluations: int) -> RingFit:
    """Covariance, residuals and sensitivities at the end of an iteration."""
    free, count = settings.free, len(settings.free)
    residual = math.sqrt(sums.squares / max(sums.pixels - count, 1))
    noise = math.sqrt(sums.differences / (2.0 * sums.pairs)) if sums.pairs else residual
    inverse = inverse_of(sums.normal[:count, :count])
    covariance = inverse @ sums.middle @ inverse
    changes = inverse @ sums.normal[:count, count:]
    sensitivity = dict.fromkeys(settings.assumed, 0.0)
    if Parameter.RADIUS in free:
        row = changes[free.index(Parameter.RADIUS)]
        sensitivity |= {p: float(row[k]) for k, p in enumerate(p for p in settings.assumed if p not in free)}
    return RingFit(parameters, free, covariance, sensitivity, residual, noise, sums.pixels, is_converged, evaluations)


def inverse_of(normal: Floats) -> Floats:
    """Inverse of a normal matrix, scaled by its diagonal."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    outer = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(normal / outer) / outer)


def fit_contact(
    frame: NDArray[np.generic], start: Floats, optics: Optics, settings: FitSettings, ceiling: float = math.inf
) -> RingFit | None:
    """Fit one frame (row, column) with the ring laid around the start (parameter,); None where it lies outside.

    ``ceiling`` is the grey level from which a pixel is saturated and left out. A doubtful fit gets a model deviation:
    errors of the model that differ from part to part of the ring pull at the radius in the parts as they do in the
    whole, so it follows from how the radius changes as quarters of fringes, or the dark inside, are left out (the
    jackknife, B. Efron 1982, chapter 3, https://doi.org/10.1137/1.9781611970319).
    """
    limits = ring_limits(float(start[Parameter.RADIUS]), optics, settings.fringes, settings.least_spacing)
    ring = cut_ring(frame, start, *limits, ceiling, settings.max_pixels)
    if ring is None:
        return None
    fit = fit_ring(ring, start, optics, settings)
    if not fit.is_doubtful or settings.max_pixels != FitSettings.max_pixels or Parameter.RADIUS not in settings.free:
        return fit
    steps = int(phase_of_gap(ring.outer, fit.radius, optics)[0] / (0.5 * math.pi)) + 1
    quarters = [distance_at_phase(0.5 * math.pi * k, fit.radius, optics) for k in range(1, steps)]
    free = np.array(fit.free, np.int64)
    parts = [
        ring_sums(ring, fit.parameters, free, optics, part=(low, high))
        for low, high in itertools.pairwise([ring.inner, fit.radius, *quarters, ring.outer])
        if high > low
    ]
    place = fit.free.index(Parameter.RADIUS)
    total = np.sum([part.normal for part in parts], axis=0)
    ridge = 1e-9 * np.diag(np.diag(total))
    changes = [float((inverse_of(total - part.normal + ridge) @ part.right)[place]) for part in parts if part.pixels]
    variance = sum(change**2 for change in changes) * (len(changes) - 1) / max(len(changes), 1)
    excess = math.sqrt(max(variance - fit.deviation(Parameter.RADIUS) ** 2, 0.0))
    return replace(fit, model_deviation=excess)

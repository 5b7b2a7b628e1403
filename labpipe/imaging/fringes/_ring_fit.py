"""Fit the interference pattern around a Hertz contact to the pixels of one frame."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._interference import Optics, part_limits, ring_limits
from labpipe.imaging.fringes._ring_noise import clustered, slow_power, unsteadiness
from labpipe.imaging.fringes._ring_parameters import ASSUMED, LIGHT, USUAL, Parameter
from labpipe.imaging.fringes._ring_pixels import Ring, cut_ring
from labpipe.imaging.fringes._ring_sums import Cells, Sums, ring_cells, ring_sums
from labpipe.uncertainty import excess_uncertainty

#: Damping at the start (so small that a radius which hardly differs from a shift of the centre is
#: not held back), least after a bad step, and its change after good and bad steps.
_DAMPING, _BAD_DAMPING, _LESS, _MORE, _MOST_DAMPING = 1e-8, 1e-3, 0.01, 10.0, 1e6
#: Pixels left out at the border of the frame, in standard deviations of the blur.
_BORDER = 2.0
#: Expected gain of a step, in variances of a pixel, below which the iteration ends: the fit is then
#: within a tenth of its uncertainty of the minimum, and the step itself is still made.
_SMALL_GAIN = 0.01
#: The same where only what is left counts: the squares fall as expected to a tenth of that.
_ROUGH_GAIN = 1.0
#: Share of the errors of the model that noise with a memory must reach to be told from them.
_OWN_SHARE = 0.3
#: Misfit from which noise with a memory is looked for, and from which nothing is explained.
_NOTABLE_MISFIT, _HOPELESS_MISFIT = 0.01, 0.35
#: Standard deviations by which the residual exceeds the noise before that counts as an error of
#: the model; their ratio, squared, scatters by one over the root of the number of pixels.
_BY_CHANCE = 5.0
#: Greatest logarithm of the phase scale, stretch and shear, and square of the blur (px²) in an
#: iteration: far beyond any view.
_MOST_LOG_SCALE, _MOST_OBLIQUE, _MOST_BLUR = 1.0, 0.5, 150.0
#: Greatest ratio of a harmonic to the one before.
_MOST_RATIO = 0.9


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
    is_rough : bool
        Whether only what is left counts, and where: the last step is taken, but not what is left there summed.
    asks : tuple of Parameter
        What is not fitted but told of: how the radius depends on it, and what fitting it would gain.
    """

    fringes: float = 3.0
    least_spacing: float = 2.0
    free: tuple[Parameter, ...] = USUAL
    max_pixels: int = 100_000
    max_iterations: int = 25
    tolerance: float = 2e-4
    tells_memory: bool = True
    is_rough: bool = False
    asks: tuple[Parameter, ...] = ASSUMED


@dataclass(frozen=True)
class RingFit:
    """Result of a fit.

    Attributes
    ----------
    parameters : array (parameter,)
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
    unsteady : float or None [px]
        What errors of the model make of the radius, from how it changes as parts of the ring are left
        out; None where this was not asked for.
    spread : float [px]
        What is known from elsewhere about errors of the model, as a standard uncertainty.
    doubts : dict
        What errors of the model make of phase, scale and focus where these were fitted, from parts of the ring.
    asked : tuple of Parameter
        What was not fitted but asked for.
    slope, bend : arrays (asked,), (asked, asked)
        How the squares fall, and how that changes, with what was asked for and all else following.
    by_memory : array (asked,) or None
        Standard deviation of the slope by noise with a memory, where there is some.
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
    unsteady: float | None = None
    spread: float = 0.0
    doubts: dict[Parameter, float] = field(default_factory=dict)
    asked: tuple[Parameter, ...] = ()
    slope: Floats | None = None
    bend: Floats | None = None
    by_memory: Floats | None = None

    def expected_gain(self, parameters: tuple[Parameter, ...]) -> float:
        """Return by how many variances the squares would fall, to first order, with these fitted as well."""
        return explained([self.along(parameters, max(self.noise, 1e-6) ** 2)])

    def along(self, parameters: Iterable[Parameter], unit: float) -> tuple[Floats, Floats]:
        """Return how the squares fall, and how that changes, in a unit of squares, along some of what was asked for."""
        rows = [self.asked.index(p) for p in dict.fromkeys(parameters) if p in self.asked]
        if self.slope is None or self.bend is None:
            return np.zeros(0), np.zeros((0, 0))
        return self.slope[rows] / unit, self.bend[np.ix_(rows, rows)] / unit

    def deviation(self, parameter: Parameter, known: tuple[Parameter, ...] = ()) -> float:
        """Return the standard uncertainty from noise, some others being known; 0 for what was not fitted."""
        if parameter not in self.free:
            return 0.0
        places = [self.free.index(p) for p in (parameter, *known) if p in self.free]
        if len(places) == 1:
            return math.sqrt(max(float(self.covariance[places[0], places[0]]), 0.0))
        return 1.0 / math.sqrt(max(float(np.linalg.pinv(self.covariance[np.ix_(places, places)])[0, 0]), 1e-300))

    @property
    def worst_deviation(self) -> float:
        """Shift of the radius (px) by errors of the model at worst, 0 when none are seen.

        Errors as large as what the fit leaves beyond noise, in the pattern that moves the radius
        most.
        """
        if self.slow is not None:
            return self.slow * math.sqrt(self.pixels) * self.leverage
        by_chance = _BY_CHANCE / math.sqrt(max(self.pixels, 1))
        excess = self.residual**2 - self.noise**2 * (1.0 + by_chance)
        return math.sqrt(max(excess, 0.0) * self.pixels) * self.leverage

    @property
    def model_deviation(self) -> float:
        """Shift of the radius (px) that errors of the model are expected to cause, 0 when none are seen."""
        expected = self.worst_deviation
        if self.unsteady is not None:
            expected = min(expected, self.unsteady)
        return math.hypot(expected, self.spread)

    @property
    def has_negative_light(self) -> bool:
        """Whether the light falls off so steeply that a plane would make it negative within the ring."""
        slope = math.hypot(*(float(self.parameters[p]) for p in (Parameter.SLOPE_X, Parameter.SLOPE_Y)))
        return slope > 1.0 and LIGHT[0] not in self.free

    @property
    def misfit(self) -> float:
        """Residual beyond the noise as a share of the modulation [1]."""
        modulation = abs(float(self.parameters[Parameter.MODULATION]))
        excess = excess_uncertainty(self.residual, self.noise)
        return excess / max(modulation, 1e-12)


def explained(along: Iterable[tuple[Floats, Floats]]) -> float:
    """Return by how much the squares of several frames would fall, to first order: see :meth:`RingFit.along`."""
    return sum(float(slope @ np.linalg.lstsq(bend, slope)[0]) for slope, bend in along if len(slope))


def fit_ring(ring: Ring, start: Floats, optics: Optics, settings: FitSettings) -> RingFit:
    """Least squares over the pixels of a ring, by damped Gauss–Newton steps from what is right to a third of a fringe.

    The phase of the optics is replaced by that of the parameters.
    """
    free = np.array(settings.free, np.int64)
    asked = () if settings.is_rough else tuple(p for p in settings.asks if p not in settings.free)
    reported = np.array([*settings.free, *asked], np.int64)
    moves = np.isin(free, (Parameter.RADIUS, Parameter.X, Parameter.Y))
    best = start.astype(float).copy()
    is_all = settings.max_iterations <= 1
    damping, evaluations, is_settled, is_small = _DAMPING, 1, False, is_all
    first = (reported, optics, len(free)) if is_all else (free, optics)
    sums = ring_sums(ring, best, *first)
    if not _is_finite(sums):
        # A field of light told by fewer pixels can run out of all numbers beyond them.
        best[[Parameter.SLOPE_X, Parameter.SLOPE_Y, Parameter.BOWL, *LIGHT]] = 0.0
        sums = ring_sums(ring, best, *first)
    least_gain = _ROUGH_GAIN if settings.is_rough else _SMALL_GAIN
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
            gain < least_gain * sums.squares or np.abs(step[moves]).max() < settings.tolerance
        )
        if is_small and settings.is_rough:
            best, sums, is_settled = trial, replace(sums, squares=sums.squares - float(sums.right @ step)), True
            break
        tried = ring_sums(ring, trial, reported if is_small else free, optics, len(free) if is_small else 0)
        evaluations += 1
        if not _is_finite(tried):
            is_small, damping = False, max(damping * _MORE, _BAD_DAMPING)
            continue
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
    curvature = 0.5 * (ring.outer**2 - ring.inner**2)
    if not (is_small or settings.is_rough):
        sums = ring_sums(ring, best, reported, optics, len(free))
        evaluations += 1
    found = _result(best, sums, settings.free, asked, is_settled, evaluations, curvature)
    return _with_doubts(_with_memory(found, ring, optics, sums), ring, optics) if settings.tells_memory else found


def _with_doubts(fit: RingFit, ring: Ring, optics: Optics) -> RingFit:
    """Tell what errors of the model make of phase, scale and focus: they are held for all frames."""
    told = [p for p in (*ASSUMED, Parameter.FOCUS) if p in fit.free]
    if fit.worst_deviation == 0.0 or not told:
        return fit
    cells = cells_of_parts(fit, ring, optics)
    places = [fit.free.index(p) for p in told]
    along = clustered(cells.scores, fit.inverse)[places, places]
    across = np.array([unsteadiness(cells.normals, cells.pulls, place) for place in places])
    by_noise = fit.noise**2 * fit.inverse[places, places]
    doubts = np.sqrt(np.maximum(across - by_noise, 0.0) + np.maximum(along - by_noise, 0.0))
    return replace(fit, doubts=dict(zip(told, doubts.tolist(), strict=True)))


def _with_memory(fit: RingFit, ring: Ring, optics: Optics, sums: Sums) -> RingFit:
    """Count as noise what changes along the rings, where more is left than pixels scatter alone."""
    if not _NOTABLE_MISFIT <= fit.misfit < _HOPELESS_MISFIT or fit.worst_deviation == 0.0:
        return fit
    cells = ring_cells(ring, fit.parameters, np.array([*fit.free, *fit.asked], np.int64), optics)
    power = slow_power(cells.sums, cells.counts)
    beyond = fit.residual**2 - fit.noise**2
    if power is None or beyond - power < _OWN_SHARE * power:
        return fit  # errors of the model make up nearly all of it
    noise, count = math.sqrt(fit.residual**2 - power), len(fit.free)
    own = cells.scores[:, :count]
    rest = cells.scores[:, count:] - own @ (fit.inverse @ sums.normal[:count, count:])
    covariance = shared_covariance(fit, own)
    by_memory = np.sqrt(np.diag(clustered(rest, np.eye(len(fit.asked)))))
    return replace(fit, noise=noise, covariance=covariance, slow=math.sqrt(power), by_memory=by_memory)


def cells_of_parts(fit: RingFit, ring: Ring, optics: Optics) -> Cells:
    """Sum what a fit leaves over the cells of its ring, and over the quarters of its fringes."""
    limits = part_limits(float(fit.parameters[Parameter.RADIUS]), ring.inner, ring.outer, optics)
    return ring_cells(ring, fit.parameters, np.array(fit.free, np.int64), optics, limits)


def shared_covariance(fit: RingFit, scores: Floats) -> Floats:
    """Covariance of a fit for noise that neighbouring pixels share, where that tells the radius worse."""
    covariance = clustered(scores, fit.inverse)
    place = fit.free.index(Parameter.RADIUS) if Parameter.RADIUS in fit.free else 0
    return fit.covariance if covariance[place, place] < fit.covariance[place, place] else covariance


def _is_possible(parameters: Floats) -> bool:
    """Tell whether an iteration has not run away."""
    oblique = np.abs(parameters[[Parameter.STRETCH, Parameter.SHEAR]]).max()
    return bool(
        np.isfinite(parameters).all()
        and parameters[Parameter.RADIUS] >= 0.0
        and abs(parameters[Parameter.SCALE]) <= _MOST_LOG_SCALE
        and oblique <= _MOST_OBLIQUE
        and parameters[Parameter.BLUR] <= _MOST_BLUR
        and math.hypot(parameters[Parameter.SECOND], parameters[Parameter.TURNED]) <= _MOST_RATIO
    )


def _is_finite(sums: Sums) -> bool:
    """Tell whether the model is finite in all pixels."""
    return bool(np.isfinite(sums.normal).all()) and math.isfinite(sums.squares)


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
    parameters: Floats,
    sums: Sums,
    free: tuple[Parameter, ...],
    asked: tuple[Parameter, ...],
    is_converged: bool,
    evaluations: int,
    curvature: float,
) -> RingFit:
    """Covariance, residuals and sensitivities at the end of an iteration."""
    count = len(free)
    spare = max(sums.pixels - count, 1)
    residual = math.sqrt(sums.squares / spare)
    noise = math.sqrt(sums.differences / (2.0 * sums.pairs)) if sums.pairs else residual
    scale = np.sqrt(np.maximum(np.diag(sums.normal)[:count], 1e-300))
    outer = np.outer(scale, scale)
    inverse = np.linalg.pinv(sums.normal[:count, :count] / outer) / outer
    covariance = inverse @ sums.weighted @ inverse if len(sums.weighted) else residual**2 * inverse
    changes = inverse @ sums.normal[:count, count:]
    place = free.index(Parameter.RADIUS) if Parameter.RADIUS in free else None
    sensitivity = dict.fromkeys(ASSUMED, 0.0)
    if place is not None:
        sensitivity |= {p: float(changes[place, k]) for k, p in enumerate(asked)}
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
        asked=asked,
        slope=sums.right[count:] - changes.T @ sums.right[:count],
        bend=sums.normal[count:, count:] - sums.normal[count:, :count] @ changes,
    )


def fit_contact(
    frame: NDArray[np.generic],
    start: Floats,
    optics: Optics,
    settings: FitSettings,
    levels: tuple[float, float] = (-math.inf, math.inf),
) -> RingFit | None:
    """Fit one frame with the ring laid around the start; None when that lies outside the frame.

    Pixels are left out where they are clipped at one of the grey ``levels``.
    """
    ring = ring_around(frame, start, optics, settings, levels)
    return None if ring is None else fit_ring(ring, start, optics, settings)


def ring_around(
    frame: NDArray[np.generic], start: Floats, optics: Optics, settings: FitSettings, levels: tuple[float, float]
) -> Ring | None:
    """Cut the ring around a contact; None when it lies outside the frame."""
    radius = float(start[Parameter.RADIUS])
    inner, outer = ring_limits(radius, optics, settings.fringes, settings.least_spacing)
    # A filter of the camera or of a program makes up what lies beyond the border.
    margin = math.ceil(_BORDER * optics.blur)
    return cut_ring(frame, start, inner, outer, levels, settings.max_pixels, margin)

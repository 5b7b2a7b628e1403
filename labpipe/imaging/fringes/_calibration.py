"""Calibration of the optics from a whole film: phase, phase scale, blur, ellipticity, harmonics, flat.

Each of them is taken from the largest contacts and then held for all frames. Left free in every
frame they would multiply the effect of every other error.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from labpipe.arrays import Floats
from labpipe.imaging.fringes._ring_fit import RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import HARMONICS, LIGHT, Parameter
from labpipe.imaging.fringes._search import View

#: Frames that are used, the largest contacts first.
_FRAMES = 8
#: A freed quantity is believed when it lowers the squared misfit by this factor, ...
_FACTOR = 2.0
#: ... the sum of squares by this many variances per frame, ...
_VARIANCES = 30.0
#: ... and differs from its assumed value by this many standard uncertainties.
_SIGNIFICANT = 5.0
#: Variances in all from which a phase is hinted at.
_HINT = 25.0
#: Greatest logarithm of the phase scale that is believed: a factor of two.
_MOST_SCALE = 0.7
#: Rounds in which the blur is found, its least (px), the relative change at which they end (with
#: all else free), the step by which its effect is told, and the square of an even motion over its
#: variance.
_BLUR_ROUNDS, _LEAST_BLUR, _SAME_BLUR, _SETTLED_BLUR, _BLUR_STEP, _EVEN = 4, 0.2, 0.02, 0.003, 0.1, 12.0
#: Flats that are tried as shares of the smallest contact, until one leaves so much more than
#: another; frames and pixels for that, and variances by which one must lower the sum of squares.
_FLATS, _WORSE = (0.35, 0.5, 0.62, 0.74, 0.86, 0.96), 1.2
_FLAT_FRAMES, _FLAT_PIXELS, _FLAT_VARIANCES, _FLAT_ROUNDS = 4, 12_000, 40.0, 2
#: Things that are found one after the other at most.
_ROUNDS = 4

_AXES = (Parameter.STRETCH, Parameter.SHEAR)


@dataclass(frozen=True)
class Calibration:
    """What a film tells about its optics.

    Attributes
    ----------
    phase_shift, u_phase_shift : float [rad]
        Phase in the contact relative to the assumed one.
    log_scale, u_log_scale : float [1]
        Logarithm of the phase scale relative to the assumed one.
    ellipse : (float, float)
        Stretch and shear of circles.
    blur : float [px]
        Standard deviation of the image of a point.
    harmonics : (float, float)
        Of the interference, relative to the first.
    flat : float [px]
        Radius of a flat worn into the sphere.
    has_uneven_light : bool
        Whether the light needs higher powers of place.
    radii, u_shared : tuples of float [px]
        What the uncertainty of blur, harmonics and flat makes of contacts of these radii.
    frames : tuple of int
        Frames that were used.
    doubted_phase : float [rad]
        What the film shows where the caller's phase was kept; NaN when they agree.
    """

    phase_shift: float = 0.0
    u_phase_shift: float = 0.0
    log_scale: float = 0.0
    u_log_scale: float = 0.0
    ellipse: tuple[float, float] = (0.0, 0.0)
    blur: float = 0.0
    harmonics: tuple[float, float] = (0.0, 0.0)
    flat: float = 0.0
    has_uneven_light: bool = False
    radii: tuple[float, ...] = ()
    u_shared: tuple[float, ...] = ()
    frames: tuple[int, ...] = ()
    doubted_phase: float = math.nan

    @property
    def is_usual(self) -> bool:
        """Whether all is as it was assumed."""
        is_plain = (*self.ellipse, *self.harmonics) == (0.0, 0.0, 0.0, 0.0) and not self.has_uneven_light
        return is_plain and (self.phase_shift, self.log_scale, self.blur, self.flat) == (0.0, 0.0, 0.0, 0.0)

    def with_shared(self, trial: "_Trial", shifts: Floats | float) -> "Calibration":
        """Add to what is shared the shifts of the radius (px) in the frames of a trial."""
        radii = np.array([fit.parameters[Parameter.RADIUS] for fit in trial.fits])
        before = np.array([self.shared(float(radius)) for radius in radii])
        total = np.hypot(before, np.abs(shifts))
        order = np.argsort(radii)
        return replace(self, radii=tuple(radii[order].tolist()), u_shared=tuple(total[order].tolist()))

    def shared(self, radius: float) -> float:
        """Return the standard uncertainty (px) that blur, harmonics and flat give to a radius (px)."""
        return float(np.interp(radius, self.radii, self.u_shared)) if self.radii else 0.0

    def applied(self, view: View) -> View:
        """Return the view with what was found."""
        optics = replace(
            view.optics,
            phase=view.optics.phase + self.phase_shift,
            phase_scale=view.optics.phase_scale * math.exp(self.log_scale),
            blur=self.blur,
            flat=self.flat,
        )
        settings = view.settings
        if self.has_uneven_light:
            settings = replace(settings, free=tuple(dict.fromkeys((*settings.free, *LIGHT))))
        return replace(
            view, optics=optics, settings=settings, ellipse=self.ellipse, harmonics=self.harmonics, alternatives=()
        )


@dataclass(frozen=True)
class _Trial:
    """Fits of the same frames with one set of free parameters."""

    fits: tuple[RingFit, ...]

    @property
    def left(self) -> float:
        """Sum of squares, in variances of a pixel by the noise of the first frame of all trials."""
        return sum(fit.residual**2 * fit.pixels / max(fit.between, 1e-6) ** 2 for fit in self.fits)

    @property
    def pixels(self) -> int:
        """Pixels of all frames."""
        return sum(fit.pixels for fit in self.fits)

    @property
    def excess(self) -> float:
        """Mean squared misfit."""
        return float(np.mean([fit.misfit**2 for fit in self.fits]))

    @property
    def rough_excess(self) -> float:
        """Mean square, in amplitudes of the fringes, of what is left beyond differences of neighbours.

        An ellipse taken for a circle leaves what changes along the rings as quickly as speckle does.
        """
        beyond = [max(fit.residual**2 - fit.between**2, 0.0) for fit in self.fits]
        amplitudes = [max(abs(float(fit.parameters[Parameter.MODULATION])), 1e-12) for fit in self.fits]
        return float(np.mean(np.array(beyond) / np.array(amplitudes) ** 2))

    def mean(self, parameter: Parameter) -> tuple[float, float]:
        """Weighted mean over the frames, and its uncertainty from their scatter."""
        values = np.array([fit.parameters[parameter] for fit in self.fits])
        weights = np.array([1.0 / max(fit.deviation(parameter), 1e-12) ** 2 for fit in self.fits])
        mean = float((weights * values).sum() / weights.sum())
        chi_square = float((weights * (values - mean) ** 2).sum()) / max(len(values) - 1, 1)
        return mean, math.sqrt(max(chi_square, 1.0) / float(weights.sum()))

    def shift_of_radius(self, parameters: Sequence[Parameter]) -> float:
        """Return the standard uncertainty (px) of the radius from that of the means of some parameters."""
        shares = []
        for fit in self.fits:
            rows = [fit.free.index(p) for p in parameters]
            place = fit.free.index(Parameter.RADIUS)
            own = fit.covariance[np.ix_(rows, rows)]
            shares.append(fit.covariance[place, rows] @ np.linalg.pinv(own))
        mean = np.mean(shares, axis=0)
        deviations = np.array([self.mean(p)[1] for p in parameters])
        return float(np.sqrt(((mean * deviations) ** 2).sum()))

    def changes(self, other: "_Trial") -> Floats:
        """Return the changes of the radius (px) against another trial of the same frames."""
        place = Parameter.RADIUS
        return np.array([a.parameters[place] - b.parameters[place] for a, b in zip(self.fits, other.fits, strict=True)])

    def gain_over(self, other: "_Trial") -> float:
        """Return the drop of the sum of squares, in variances of a pixel."""
        return sum(
            (a.residual**2 - b.residual**2) * b.pixels / max(b.noise, 1e-6) ** 2
            for a, b in zip(other.fits, self.fits, strict=True)
        )

    def is_better_than(self, other: "_Trial") -> bool:
        """Tell whether the misfit is much lower, and not by chance."""
        is_significant = self.gain_over(other) > _VARIANCES * len(self.fits)
        return is_significant and self.excess * _FACTOR < other.excess


class _Attempt(Protocol):
    """Fits the chosen frames with further parameters free, some things being known."""

    def __call__(
        self, extra: Sequence[Parameter], known: Calibration, count: int = ..., pixels: int = ...
    ) -> _Trial | None:
        """Return the fits, or None when one of them fails."""


def calibrate(
    frame_of: Callable[[int], NDArray[np.generic]],
    fits: dict[int, RingFit],
    view: View,
    *,
    is_phase_free: bool,
    shape: str,
    rough: Sequence[Parameter] = (),
) -> Calibration:
    """Find phase, scale and ellipticity of a film.

    Parameters
    ----------
    frame_of : callable
        Reads a frame.
    fits : dict
        Fits by frame.
    view : View
        The view they were made with.
    is_phase_free : bool
        Whether the phase may be changed.
    shape : "auto", "circle" or "ellipse"
        Whether circles may be ellipses: if the film says so, no, or yes in every frame.
    rough : sequence of Parameter
        Which of phase and scale the view has from single frames, so that they are found anew.

    Returns
    -------
    Calibration
        What differs from the assumptions beyond doubt; the assumptions else.
    """
    chosen = _choose(fits)
    if not chosen:
        return Calibration()
    images = [frame_of(index) for index in chosen]
    starts = [fits[index] for index in chosen]

    made: dict[tuple[object, ...], _Trial | None] = {}

    def attempt(
        extra: Sequence[Parameter], known: Calibration, count: int = _FRAMES, pixels: int | None = None
    ) -> _Trial | None:
        key = (tuple(extra), known, count, pixels)
        if key not in made:
            seen = known.applied(view)
            if pixels is not None:
                seen = replace(seen, settings=replace(seen.settings, max_pixels=pixels, tells_memory=False))
            made[key] = _attempt(images[:count], starts[:count], seen, tuple(extra))
        return made[key]

    def begin_from(trial: _Trial) -> None:
        starts[:] = trial.fits
        made.clear()

    plain_axes = _AXES if shape == "ellipse" else ()
    result = Calibration(frames=chosen)
    best = attempt(plain_axes, result)
    if best is None:
        return Calibration()
    if shape == "auto":
        best, result = _find_ellipse(attempt, result, best)
    if rough:
        trial = attempt((*plain_axes, *rough), result)
        if trial is not None:
            result = _with_rough(trial, result, rough, view)
            best = attempt(plain_axes, result) or best
    # One may hide behind another: whatever explains most comes first.
    for _ in range(_ROUNDS):
        candidates = [
            *_find_shape_of_light(attempt, plain_axes, result, best),
            _find_optics(attempt, plain_axes, result, best, Parameter.PHASE, view),
            _find_optics(attempt, plain_axes, result, best, Parameter.SCALE, view),
            _find_blur(attempt, plain_axes, result, best),
            _find_flat(attempt, plain_axes, result, best),
        ]
        better = [candidate for candidate in candidates if candidate is not None]
        if not better:
            break
        # What differs from frame to frame fits better than what holds for all: compare the latter.
        reference = best
        held = [(attempt(plain_axes, found) or trial, found) for trial, found in better]
        trial, found = max(held, key=lambda candidate: candidate[0].gain_over(reference))
        if found.phase_shift != result.phase_shift and not is_phase_free:
            # The scale would be bent to make up for a phase that is not what it is said to be.
            return replace(result, doubted_phase=view.optics.phase + found.phase_shift)
        result, best = found, trial
        begin_from(best)
    settled, result = _settle_blur(attempt, plain_axes, result, best)
    if settled is not best:
        best = settled
        begin_from(best)
    result = _with_order_of_blur(attempt, plain_axes, _refine(attempt, plain_axes, result, view))
    # What a sharp film shows beyond the third harmonic looks like a small phase.
    is_cut = result.harmonics != (0.0, 0.0) and not result.blur
    if not is_phase_free or result.phase_shift != 0.0 or is_cut:
        return result
    return _with_hidden_phase(attempt, plain_axes, result, view)


def _with_hidden_phase(attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, view: View) -> Calibration:
    """Count what a phase that the film hints at, but not beyond doubt, would make of the radius."""
    trial = attempt((*axes, Parameter.PHASE), known)
    best = attempt(tuple(axes), known)  # with all that is known by now, or its gain would be the phase's
    if trial is None or best is None or trial.gain_over(best) < _HINT:
        return known
    phase, deviation = trial.mean(Parameter.PHASE)
    if abs(phase - view.optics.phase) <= _SIGNIFICANT * deviation:
        return known
    return known.with_shared(trial, float(np.median(trial.changes(best))))


def _with_order_of_blur(attempt: _Attempt, axes: Sequence[Parameter], known: Calibration) -> Calibration:
    """Count as uncertain all that harmonics make of the radius where the lens blurs as well.

    Those of many beams are blurred as they are here, those of a camera that is not linear arise after
    the lens, and are smaller where the fringes are fine.
    """
    if not known.blur or known.harmonics == (0.0, 0.0):
        return known
    trial, without = (attempt(axes, seen) for seen in (known, replace(known, harmonics=(0.0, 0.0))))
    return known if trial is None or without is None else known.with_shared(trial, trial.changes(without))


def _find_ellipse(attempt: _Attempt, known: Calibration, best: _Trial) -> tuple[_Trial, Calibration]:
    """Ellipse that explains the frames much better than circles, its area being right or not.

    A view that is oblique, or scaled along one axis, changes the area that a contact of known fringes
    covers: then neither ellipse nor scale explains anything without the other.
    """
    for extra in (_AXES, (*_AXES, Parameter.SCALE)):
        oblique = attempt(extra, known)
        if oblique is None or oblique.gain_over(best) <= _VARIANCES * len(best.fits):
            continue
        if oblique.rough_excess * _FACTOR >= best.rough_excess:
            continue
        (stretch, u_stretch), (shear, u_shear) = (oblique.mean(axis) for axis in _AXES)
        if max(abs(stretch) / u_stretch, abs(shear) / u_shear) <= _SIGNIFICANT:
            continue
        found = replace(known, ellipse=(stretch, shear))
        if Parameter.SCALE in extra:
            scale, u = oblique.mean(Parameter.SCALE)
            if abs(scale) <= _SIGNIFICANT * u or abs(scale) > _MOST_SCALE:
                continue
            found = replace(found, log_scale=scale, u_log_scale=u)
        return attempt((), found) or oblique, found
    return best, known


def _with_rough(trial: _Trial, known: Calibration, rough: Sequence[Parameter], view: View) -> Calibration:
    """Take phase and scale from a trial that left them free."""
    if Parameter.PHASE in rough:
        phase, u = trial.mean(Parameter.PHASE)
        known = replace(known, phase_shift=phase - view.optics.phase, u_phase_shift=u)
    if Parameter.SCALE in rough:
        scale, u = trial.mean(Parameter.SCALE)
        known = replace(known, log_scale=scale, u_log_scale=u)
    return known


def _find_shape_of_light(
    attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, best: _Trial
) -> Iterator[tuple[_Trial, Calibration]]:
    """Yield harmonics and uneven light, each when it explains the frames much better than none."""
    if not any(fit.model_deviation > 0.0 for fit in best.fits):
        return
    if not known.has_uneven_light:
        uneven = replace(known, has_uneven_light=True)
        trial = attempt(axes, uneven)
        if trial is not None and trial.is_better_than(best):
            yield trial, uneven
    if known.harmonics == (0.0, 0.0):
        trial = attempt((*axes, *HARMONICS), known)
        if trial is not None and trial.is_better_than(best):
            harmonics = (trial.mean(Parameter.SECOND)[0], trial.mean(Parameter.THIRD)[0])
            found = replace(known, harmonics=harmonics)
            yield trial, found.with_shared(trial, trial.shift_of_radius(HARMONICS))


def _find_blur(
    attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, best: _Trial
) -> tuple[_Trial, Calibration] | None:
    """Blur of the lens, when it explains the frames much better than none.

    A lens and a contact that moves evenly blur nearly alike: what is seen is the sum of their
    variances. The frame in which it is least is taken for one without motion.
    """
    if known.blur or not any(fit.model_deviation > 0.0 for fit in best.fits):
        return None
    lens = _blur_of_lens(attempt, axes, known, best)
    if lens is None or not lens.trial.is_better_than(best):
        return None
    return lens.trial, lens.known(attempt, axes, known)


@dataclass(frozen=True)
class _Lens:
    """Fits with a blur of the lens (px), and the uncertainty of its square."""

    trial: _Trial
    blur: float
    u_square: float

    def known(self, attempt: _Attempt, axes: Sequence[Parameter], known: Calibration) -> Calibration:
        """Return what is known with this blur, and what its uncertainty makes of the radius."""
        sharper = attempt(axes, replace(known, blur=(1.0 - _BLUR_STEP) * self.blur))
        slope = 0.0 if sharper is None else self.trial.changes(sharper) / (_BLUR_STEP * self.blur)
        own = slope * self.u_square / (2.0 * self.blur)
        uneven = np.array([_shift_by_uneven_light(fit, self.blur) for fit in self.trial.fits])
        return replace(known, blur=self.blur).with_shared(self.trial, np.hypot(own, uneven))


def _shift_by_uneven_light(fit: RingFit, blur: float) -> float:
    """Return u of the radius (px) where blurred rings lie in light that falls off outwards.

    To first order the blur moves them by its variance times the relative slope of the light, if that
    is how the light falls on the body; not if the camera darkens its corners.
    """
    radius, bowl = (float(fit.parameters[p]) for p in (Parameter.RADIUS, Parameter.BOWL))
    return blur**2 * bowl * 2.0 * radius / fit.curvature / math.sqrt(3.0)


def _seen_blurs(trial: _Trial, blur: float) -> list[tuple[float, float]]:
    """Variance (px²) of lens and motion together in every frame with its uncertainty, least first."""
    return sorted(
        (blur**2 + float(fit.parameters[Parameter.SMEAR]) / _EVEN, fit.deviation(Parameter.SMEAR) / _EVEN)
        for fit in trial.fits
    )


def _blur_of_lens(attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, best: _Trial) -> _Lens | None:
    """Fit the frames with a lens that blurs as much as the one of least blur shows."""
    trial, blur, u_square = best, known.blur, 0.0
    for _ in range(_BLUR_ROUNDS):
        variances = _seen_blurs(trial, blur)
        if variances[0][0] <= _LEAST_BLUR**2:
            return None
        change = math.sqrt(variances[0][0]) - blur
        blur += change
        # Two frames at rest see the same blur; they differ by what is known of it.
        u_square = max(variances[0][1], variances[min(1, len(variances) - 1)][0] - variances[0][0])
        found = attempt(axes, replace(known, blur=blur))
        if found is None:
            return None
        trial = found
        if abs(change) < _SAME_BLUR * blur:
            break
    return _Lens(trial, blur, u_square)


def _settle_blur(
    attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, best: _Trial
) -> tuple[_Trial, Calibration]:
    """Lay a blur that every frame shows to the lens or to motion, as the frames tell.

    Either explains the frames nearly as well, with radii some hundredths of a pixel apart: what is
    likelier is taken, and the other counts as what may be wrong.
    """
    least, deviation = _seen_blurs(best, 0.0)[0]
    if known.blur or least <= max(_LEAST_BLUR**2, _SIGNIFICANT * deviation):
        return best, known
    lens = _blur_of_lens(attempt, axes, known, best)
    if lens is None:
        return best, known
    gain = sum(
        (a.residual**2 / b.residual**2 - 1.0) * b.pixels for a, b in zip(best.fits, lens.trial.fits, strict=True)
    )
    # The probability of the less likely one; logarithms of likelihoods go with half the squares.
    doubt = 1.0 / (1.0 + math.exp(min(0.5 * abs(gain), 700.0)))
    changes = lens.trial.changes(best) * math.sqrt(doubt)
    if gain <= 0.0:
        return best, known.with_shared(best, changes)
    return lens.trial, lens.known(attempt, axes, known).with_shared(lens.trial, changes)


def _refine(attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, view: View) -> Calibration:
    """Find again, with the blur, what was found while motion stood in for it."""
    groups = (
        ((Parameter.PHASE,), known.phase_shift != 0.0),
        ((Parameter.SCALE,), known.log_scale != 0.0),
        (HARMONICS, known.harmonics != (0.0, 0.0)),
        (_AXES, known.ellipse != (0.0, 0.0)),
    )
    free = [parameter for group, is_found in groups if is_found for parameter in group]
    if not known.blur or not free:
        return known
    blur = known.blur
    for _ in range(_BLUR_ROUNDS):
        trial = attempt((*axes, *free), known)
        if trial is None:
            return known
        known = _with_rough(trial, known, [p for p in free if p is Parameter.PHASE], view)
        if Parameter.SCALE in free:
            change, u = trial.mean(Parameter.SCALE)
            known = replace(known, log_scale=known.log_scale + change, u_log_scale=u)
        if Parameter.SECOND in free:
            known = replace(known, harmonics=(trial.mean(Parameter.SECOND)[0], trial.mean(Parameter.THIRD)[0]))
        if Parameter.STRETCH in free:
            known = replace(known, ellipse=(trial.mean(Parameter.STRETCH)[0], trial.mean(Parameter.SHEAR)[0]))
        square = _seen_blurs(trial, known.blur)[0][0]
        known = replace(known, blur=math.sqrt(max(square, _LEAST_BLUR**2)))
        if abs(known.blur - blur) < _SETTLED_BLUR * blur:
            break
        blur = known.blur
    return known


def _find_flat(
    attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, best: _Trial
) -> tuple[_Trial, Calibration] | None:
    """Flat that leaves least in all frames, when it explains them better than a whole sphere."""
    if known.flat or not any(fit.model_deviation > 0.0 for fit in best.fits):
        return None
    smallest = min(float(fit.parameters[Parameter.RADIUS]) for fit in best.fits)

    def left(flat: float) -> float:
        trial = attempt(axes, replace(known, flat=flat), _FLAT_FRAMES, _FLAT_PIXELS)
        return math.inf if trial is None else trial.left

    tried = [(0.0, left(0.0))]
    for share in _FLATS:
        tried.append((share * smallest, left(share * smallest)))
        if tried[-1][1] > _WORSE * min(value for _, value in tried):
            break
    near = min(range(len(tried)), key=lambda place: tried[place][1])
    if near == 0:
        return None
    low, high = tried[near - 1][0], tried[min(near + 1, len(tried) - 1)][0]
    width = high - low
    flat = float(minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": 0.01 * width}).x)
    trial = attempt(axes, replace(known, flat=flat))
    if trial is None or trial.gain_over(best) < _FLAT_VARIANCES:
        return None
    # a wrong wavelength or ruler is commoner than wear, and moves rings nearly alike
    scaled = attempt((*axes, Parameter.SCALE), known)
    if scaled is not None and scaled.gain_over(best) >= trial.gain_over(best):
        return None
    # All pixels of all frames place the minimum better: the vertex of ever narrower parabolas.
    step = 0.1 * width
    for _ in range(_FLAT_ROUNDS):
        smaller, larger = (attempt(axes, replace(known, flat=size)) for size in (flat - step, flat + step))
        if smaller is None or larger is None:
            return None
        bend = max((smaller.left + larger.left - 2.0 * trial.left) / step**2, 1e-9)
        flat += float(np.clip((smaller.left - larger.left) / (2.0 * step * bend), -step, step))
        trial = attempt(axes, replace(known, flat=flat)) or trial
        u_flat = min(math.sqrt(2.0 * max(trial.left / trial.pixels, 1.0) / bend), width)
        slopes = larger.changes(smaller) / (2.0 * step)
        step = min(step, 5.0 * u_flat)
    return trial, replace(known, flat=flat).with_shared(trial, slopes * u_flat)


def _find_optics(
    attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, best: _Trial, parameter: Parameter, view: View
) -> tuple[_Trial, Calibration] | None:
    """Phase or scale that the film shows, when it explains the frames much better."""
    trial = attempt((*axes, parameter), known)
    if trial is None or not trial.is_better_than(best):
        return None
    value, deviation = trial.mean(parameter)
    if parameter is Parameter.PHASE:
        shift = value - view.optics.phase
        if abs(shift - known.phase_shift) <= _SIGNIFICANT * deviation:
            return None
        return trial, replace(known, phase_shift=shift, u_phase_shift=deviation)
    scale = known.log_scale + value
    if abs(value) <= _SIGNIFICANT * deviation or abs(scale) > _MOST_SCALE:
        return None
    return trial, replace(known, log_scale=scale, u_log_scale=deviation)


def _choose(fits: dict[int, RingFit]) -> tuple[int, ...]:
    """Frames whose radius is best known among the larger contacts."""
    radius = {index: float(fit.parameters[Parameter.RADIUS]) for index, fit in fits.items()}
    if not radius:
        return ()
    largest = max(radius.values())
    large = [index for index, value in radius.items() if value > 0.5 * largest]
    # Contacts that hardly move and are seen from all sides come first.
    large.sort(key=lambda index: (fits[index].deviation(Parameter.RADIUS), index))
    return tuple(sorted(large[:_FRAMES]))


def _attempt(
    images: Sequence[NDArray[np.generic]], starts: Sequence[RingFit], view: View, extra: tuple[Parameter, ...]
) -> _Trial | None:
    """Fit all frames with further parameters free; None when one of them fails."""
    free = tuple(dict.fromkeys(view.settings.free + extra))
    settings = replace(view.settings, free=free)
    fits = []
    for image, start in zip(images, starts, strict=True):
        parameters = start.parameters.copy()
        if Parameter.STRETCH not in extra:
            parameters[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
        parameters[Parameter.PHASE] = view.optics.phase
        parameters[Parameter.SCALE] = 0.0
        parameters[Parameter.BLUR] = 0.0
        if Parameter.SECOND not in extra:
            parameters[list(HARMONICS)] = view.harmonics
        fit = fit_contact(image, parameters, view.optics, settings, view.white)
        if fit is None:
            return None
        fits.append(fit)
    return _Trial(tuple(fits))

"""Fits of a film's chosen frames with one or another thing assumed about its optics, and what they tell."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.fringes._ring_fit import RingFit, explained
from labpipe.imaging.fringes._ring_parameters import HARMONICS, LIGHT, Parameter
from labpipe.imaging.fringes._view import View

#: Variances in all from which something is hinted at.
HINT = 25.0
#: The same, beyond two for each frame, where pixels scatter alone.
WEAK_HINT = 10.0
#: Frames that are used, the largest contacts first.
MOST_FRAMES = 8
#: Share of the largest below which a part of a systematic uncertainty counts as that much, and sum of squares of
#: logarithms of radii that tell no power.
_LEAST_PART, _NO_POWER = 0.03, 0.01
#: A freed quantity is believed when it lowers the squared misfit by this factor, ...
FACTOR = 2.0
#: ... the sum of squares by this many variances per frame, ...
VARIANCES = 30.0
#: ... this many times as many where noise has a memory ...
_BY_MEMORY = 20.0
#: ... and differs from its assumed value by this many standard uncertainties.
SIGNIFICANT = 5.0
#: What is left beyond noise, in variances over the root of the number of pixels, that may be there by chance: the
#: ratio of both squares scatters by about 2.
_CHANCE = 4.0
#: What is left beyond differences of neighbours, in amplitudes, below which noise with a memory plays no part.
_QUIET = 0.01
#: Frames and pixels of a first look, the share of the squared misfit that it must leave less than, and
#: the share of the gain wanted that it must promise, or whole frames are not tried.
FEW_FRAMES, FEW_PIXELS, PROMISE, HALF = 4, 12_000, 0.8, 0.5
#: Where all pixels count, but only what is left.
ALL_PIXELS = 10**9
#: The same share where these frames show errors of the model beyond chance, which whole ones must halve.
_CLEAR_PROMISE = 0.65


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
    blur, disc : float [px], [1]
        Standard deviation of the image of a point, and the share of its variance that is a disc's.
    harmonics : (float, float, float)
        See :data:`HARMONICS`.
    by_camera : bool
        Whether they arise behind the lens that blurs.
    colour : (float, float)
        Wavenumber of a second colour over that of the first, and its share of the fringes.
    spread : float
        Variance of the wavenumbers, relative to the square of their mean.
    skew : float
        See :class:`.Optics`.
    focus : float
        See :class:`.Optics`.
    flat : float [px]
        Radius of a flat worn into the sphere.
    halo : (float, float)
        See :class:`.Optics`.
    has_uneven_light : bool
        Whether the light needs higher powers of place.
    radii, u_shared : tuples of float [px]
        What the uncertainty of blur, harmonics and flat makes of contacts of these radii.
    frames : tuple of int
        Frames that were used.
    fits : tuple of RingFit
        Fits of these with what was found.
    doubted_phase : float [rad]
        What the film shows where the caller's phase was kept; NaN when they agree.
    """

    phase_shift: float = 0.0
    u_phase_shift: float = 0.0
    log_scale: float = 0.0
    u_log_scale: float = 0.0
    ellipse: tuple[float, float] = (0.0, 0.0)
    blur: float = 0.0
    disc: float = 0.0
    harmonics: tuple[float, float, float] = (0.0, 0.0, 0.0)
    by_camera: bool = False
    colour: tuple[float, float] = (1.0, 0.0)
    spread: float = 0.0
    skew: float = 0.5
    focus: float = 0.0
    flat: float = 0.0
    halo: tuple[float, float] = (0.0, 0.0)
    has_uneven_light: bool = False
    radii: tuple[float, ...] = ()
    u_shared: tuple[float, ...] = ()
    frames: tuple[int, ...] = ()
    fits: tuple[RingFit, ...] = ()
    doubted_phase: float = math.nan

    @property
    def is_usual(self) -> bool:
        """Whether all is as it was assumed."""
        is_plain = not any(
            (*self.ellipse, *self.harmonics, self.colour[1], self.spread, self.focus, *self.halo, self.has_uneven_light)
        )
        return is_plain and (self.phase_shift, self.log_scale, self.blur, self.flat) == (0.0, 0.0, 0.0, 0.0)

    def with_shared(self, trial: "Trial", shifts: Floats | float) -> "Calibration":
        """Add to what is shared the shifts of the radius (px) in the frames of a trial."""
        radii = np.array([fit.parameters[Parameter.RADIUS] for fit in trial.fits])
        before = np.array([self.shared(float(radius)) for radius in radii])
        total = np.hypot(before, np.abs(shifts))
        order = np.argsort(radii)
        return replace(self, radii=tuple(radii[order].tolist()), u_shared=tuple(total[order].tolist()))

    def shared(self, radius: float) -> float:
        """Return the standard uncertainty (px) that blur, harmonics and flat give to a radius (px)."""
        if not self.radii:
            return 0.0
        value = float(np.interp(radius, self.radii, self.u_shared))
        beyond = math.log(max(radius, 1.0) / min(max(radius, self.radii[0], 1.0), self.radii[-1]))
        if beyond == 0.0 or value == 0.0:
            return value
        # what a flat or a scale makes of a radius goes with a power of it
        sizes, parts = np.log(self.radii), np.log(np.maximum(self.u_shared, _LEAST_PART * max(self.u_shared)))
        away = sizes - sizes.mean()
        power = float(away @ parts) / (float(away @ away) + _NO_POWER)
        return value * math.exp(max(power * beyond, 0.0))

    def applied(self, view: View) -> View:
        """Return the view with what was found."""
        optics = replace(
            view.optics,
            phase=view.optics.phase + self.phase_shift,
            phase_scale=view.optics.phase_scale * math.exp(self.log_scale),
            blur=self.blur,
            disc=self.disc,
            by_camera=self.by_camera,
            colour=self.colour,
            spread=self.spread,
            skew=self.skew,
            focus=self.focus,
            flat=self.flat,
            halo=self.halo,
        )
        settings = view.settings
        if self.has_uneven_light:
            settings = replace(settings, free=tuple(dict.fromkeys((*settings.free, *LIGHT))))
        return replace(
            view, optics=optics, settings=settings, ellipse=self.ellipse, harmonics=self.harmonics, alternatives=()
        )


@dataclass(frozen=True)
class Trial:
    """Fits of the same frames with one set of free parameters, and the noise (grey levels) in which they are weighed.

    That is one for all trials that are compared: what a fit leaves is noise to it as well. What is much better lowers
    the squared misfit by the factor.
    """

    fits: tuple[RingFit, ...]
    noise: tuple[float, ...]
    factor: float = FACTOR

    @property
    def left(self) -> float:
        """Sum of squares, in variances of a pixel."""
        return float(self.left_of_each.sum())

    @property
    def left_of_each(self) -> Floats:
        """The same of every frame."""
        pairs = zip(self.fits, self.noise, strict=True)
        return np.array([fit.residual**2 * fit.pixels / max(noise, 1e-6) ** 2 for fit, noise in pairs])

    @property
    def pixels(self) -> int:
        """Pixels of all frames."""
        return sum(fit.pixels for fit in self.fits)

    @property
    def is_doubtful(self) -> bool:
        """Whether errors of the model are seen in any of the frames."""
        return any(fit.worst_deviation > 0.0 for fit in self.fits)

    @property
    def is_all_noise(self) -> bool:
        """Whether no more is left in all frames than noise leaves by chance."""
        beyond = sum((fit.residual**2 / max(fit.noise, 1e-6) ** 2 - 1.0) * fit.pixels for fit in self.fits)
        return beyond < _CHANCE * math.sqrt(self.pixels)

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

    @property
    def is_quiet(self) -> bool:
        """Whether noise with a memory plays no part: it hints at anything in single frames."""
        return self.rough_excess < _QUIET**2

    def mean(self, parameter: Parameter) -> tuple[float, float]:
        """Weighted mean over the frames, and its uncertainty from their scatter and from errors of the model."""
        values = np.array([fit.parameters[parameter] for fit in self.fits])
        weights = np.array([1.0 / max(fit.deviation(parameter), 1e-12) ** 2 for fit in self.fits])
        mean = float((weights * values).sum() / weights.sum())
        chi_square = float((weights * (values - mean) ** 2).sum()) / max(len(values) - 1, 1)
        doubts = [fit.doubts.get(parameter, 0.0) for fit in self.fits]
        by_chance = math.sqrt(max(chi_square, 1.0) / float(weights.sum()))
        return mean, math.hypot(by_chance, float(np.average(doubts, weights=weights)))

    @property
    def harmonics(self) -> tuple[float, float, float]:
        """Return the mean harmonics."""
        second, turned, third = (self.mean(p)[0] for p in HARMONICS)
        return second, turned, third

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

    def hinted(self, parameter: Parameter, beside: Sequence[Parameter] = ()) -> tuple[float, float]:
        """Return what a parameter that was asked for would be, to first order, and its standard uncertainty.

        What was asked for ``beside`` it follows.
        """
        pairs = [fit.along((parameter, *beside), max(fit.noise, 1e-6) ** 2) for fit in self.fits]
        slope, bend = (np.sum(parts, axis=0) for parts in zip(*pairs, strict=True))
        if not len(slope):
            return 0.0, math.inf
        inverse = np.linalg.pinv(bend)
        values = inverse @ slope
        # frames may differ by more than noise
        apart = explained((own - curve @ values, curve) for own, curve in pairs)
        variance = inverse[0, 0] * max(apart / max(len(values) * (len(pairs) - 1), 1), 1.0)
        # what makes noise remember stands still: it is one in all frames
        told = [(f, f.by_memory) for f in self.fits if f.by_memory is not None]
        shared = sum(float(memory[f.asked.index(parameter)]) / max(f.noise, 1e-6) ** 2 for f, memory in told)
        return float(values[0]), max(shared * inverse[0, 0], math.sqrt(variance))

    def slopes(self, parameter: Parameter, beside: Sequence[Parameter] = ()) -> Floats:
        """Return the change of the radius (px) per change of what was asked for, all else following."""
        asked = [p for p in dict.fromkeys((parameter, *beside)) if p in self.fits[0].asked]
        along = [np.linalg.pinv(fit.along(asked, 1.0)[1])[0] for fit in self.fits]
        radii = [np.array([fit.sensitivity[p] for p in asked]) for fit in self.fits]
        return np.array([own @ way / way[0] for own, way in zip(radii, along, strict=True)])

    def changes_by_mean(self, parameter: Parameter) -> Floats:
        """Return the changes of the radius (px) from 0 to the mean of what each frame had free."""
        mean = self.mean(parameter)[0]
        places = [(fit.free.index(Parameter.RADIUS), fit.free.index(parameter), fit) for fit in self.fits]
        return np.array([mean * fit.inverse[radius, own] / fit.inverse[own, own] for radius, own, fit in places])

    def changes(self, other: "Trial") -> Floats:
        """Return the changes of the radius (px) against another trial of the same frames."""
        place = Parameter.RADIUS
        return np.array([a.parameters[place] - b.parameters[place] for a, b in zip(self.fits, other.fits, strict=True)])

    def gain_over(self, other: "Trial") -> float:
        """Return the drop of the sum of squares, in variances of a pixel."""
        return sum(
            (a.residual**2 - b.residual**2) * b.pixels / max(b.noise, 1e-6) ** 2
            for a, b in zip(other.fits, self.fits, strict=True)
        )

    def may_gain(self, parameters: tuple[Parameter, ...], least: float = HINT) -> bool:
        """Tell whether it is worth while to fit more: errors of the model are seen, or such a fit hints at."""
        return self.is_doubtful or self.expected_gain(parameters) > least

    def expected_gain(self, parameters: tuple[Parameter, ...]) -> float:
        """Return by how many variances the squares would fall, to first order, with these fitted as well."""
        return sum(fit.expected_gain(parameters) for fit in self.fits)

    @property
    def least_gain(self) -> float:
        """Variances by which the squares fall at least from here to what :meth:`is_better_than` this.

        Beside noise with a memory much of the misfit is then explained, which the squares hold, or some of it and far
        more than such noise.
        """
        least = VARIANCES * len(self.fits)
        if all(fit.slow is None for fit in self.fits):
            return least
        squares = [(fit.slow or 0.0) ** 2 * fit.pixels / max(fit.noise, 1e-6) ** 2 for fit in self.fits]
        beyond_memory = max(_BY_MEMORY * least, (1.0 - PROMISE) * sum(squares))
        much = (1.0 - 1.0 / FACTOR) * sum(squares)
        return max(least, min(much, beyond_memory) if much else beyond_memory)

    def is_better_than(self, other: "Trial") -> bool:
        """Tell whether the misfit is much lower, and not by chance.

        Noise with a memory hides how much of the residual is misfit: there the sum of squares must
        fall by far more than such noise makes it fall, and what misfit is seen beside it must fall as well.
        """
        gain, needed = self.gain_over(other), VARIANCES * len(self.fits)
        is_hidden = any(fit.slow is not None for fit in (*self.fits, *other.fits))
        is_beyond_memory = is_hidden and gain > _BY_MEMORY * needed and self.excess <= PROMISE * other.excess
        is_much = self.excess * other.factor < other.excess or is_beyond_memory
        return gain > needed and is_much


class Attempt(Protocol):
    """Fits the chosen frames with further parameters free, some things being known."""

    def __call__(
        self, extra: Sequence[Parameter], known: Calibration, count: int = ..., pixels: int = ...
    ) -> Trial | None:
        """Return the fits, or None when one of them fails; of so many pixels, only what is left counts, and where."""


def is_promising(
    attempt: Attempt,
    before: tuple[Sequence[Parameter], Calibration],
    after: tuple[Sequence[Parameter], Calibration],
    best: Trial,
) -> bool:
    """Tell by some pixels of a few frames whether another explanation may be much better than the best one.

    What it leaves there costs a sixth of what whole frames do, and most explanations are wrong. Where noise with a
    memory may hide how much of the misfit is explained, the squares must fall as far as it would make them.
    """
    one, other = (attempt(*way, FEW_FRAMES, FEW_PIXELS) for way in (before, after))
    if one is None or other is None:
        return True
    share = best.pixels / max(other.pixels, 1)
    if any(fit.slow is not None for fit in best.fits):
        return share * _gain_in_noise(one, other, best) > HALF * best.least_gain
    gain = other.gain_over(one) * share
    promise = _CLEAR_PROMISE if one.is_doubtful else PROMISE
    return other.excess < promise * one.excess and gain > HALF * VARIANCES * len(best.fits)


def _gain_in_noise(one: Trial, other: Trial, best: Trial) -> float:
    """Drop of the sum of squares from one trial to another, in the noise that the best one tells, or less."""
    trios = zip(one.fits, other.fits, best.fits, strict=False)
    return sum(
        (a.residual**2 - b.residual**2) * b.pixels / max(min(b.residual, c.noise), 1e-6) ** 2 for a, b, c in trios
    )


def doubt(gain: float) -> float:
    """Probability of the less likely of two explanations; logarithms of likelihoods go with half the squares."""
    return 1.0 / (1.0 + math.exp(min(0.5 * abs(gain), 700.0)))

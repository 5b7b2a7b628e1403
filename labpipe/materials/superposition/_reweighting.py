"""Iterate one joint fit: noise levels, outliers and smoothing estimated from the residuals."""

import math
from dataclasses import dataclass, replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials.superposition._joint_fit import (
    Fit,
    Points,
    evaluate,
    grid_for,
    minimise,
    outer_problem,
    sensitivity,
)
from labpipe.materials.superposition._noise import Noise, Scatter, next_noise
from labpipe.materials.superposition._shift_parameters import OuterModel, expected_shifts
from labpipe.materials.superposition._step_search import Probe
from labpipe.materials.superposition._two_processes import TwoProcesses
from labpipe.materials.superposition._vertical_law import Vertical
from labpipe.uncertainty import propagated_variance

# Passes of noise, outliers and smoothing around the joint fit, and when they have settled.
_MAX_PASSES = 6
_NOISE_SETTLED = 0.02
# Residuals beyond this many standard deviations count with their root only (Huber); normal
# noise exceeds it once in 370 points, so clean data lose nothing.
_HUBER = 3.0
# First and extreme standard deviations of the levels (relative): clamping a sample anew moves its
# modulus by some percent.
FIRST_LEVELS, _LEAST_LEVELS, _MOST_LEVELS = 0.02, 0.002, 0.1


@dataclass(frozen=True, slots=True)
class Superposition:
    """A settled joint fit with the covariance of its outer parameters.

    ``covariance`` (parameter, parameter): Of the outer parameters, the spectrum having followed. ``standardised`` (2
    point,): Residuals in units of the noise, storage first, outliers not weakened. ``starts``: Name of every start,
    its final cost in units of the noise, and how far its shifts end from the best ones (largest difference, decades).
    ``probe``: What a walk along the barely determined steps found. ``alternatives``: log10 a_T with the model
    changed, where superposition does not hold to the scatter. ``violation``: Noise of the fit over scatter of the
    sweeps, of the worse modulus. ``run_length``: How many neighbouring readings are worth one; the covariance holds
    it. ``rival``: Two processes that describe the sweeps as well as superposition does, or better. ``refused``:
    Vertical laws that fit only with factors of no material. ``slopes``: Of a glass with little loss: relative
    likelihood and log10 a_T of fits from other slopes of its modulus.
    """

    model: OuterModel
    fit: Fit
    noise: Noise
    covariance: Floats
    standardised: Floats
    starts: tuple[tuple[str, float, float], ...]
    probe: Probe | None = None
    alternatives: tuple[tuple[str, Floats], ...] = ()
    violation: float = 1.0
    run_length: float = 1.0
    rival: TwoProcesses | None = None
    refused: tuple[Vertical, ...] = ()
    slopes: tuple[tuple[float, Floats], ...] = ()

    @property
    def spread_of_slopes(self) -> Floats:
        """Second moment of log10 a_T (isotherm, isotherm) over fits from other slopes, about this one."""
        moved = np.array([math.sqrt(share) * (shifts - self.fit.state.log10_aT) for share, shifts in self.slopes])
        return np.asarray(moved.T @ moved)


@dataclass(frozen=True, slots=True)
class Options:
    """What may be chosen by the residuals, and what the user has fixed; see ``superpose``."""

    verticals: tuple[Vertical, ...]
    delay: bool | None
    levels: bool | None
    robust: bool
    noise_ratio: float | None
    scatter: Scatter | None


@dataclass(frozen=True, slots=True)
class Candidate:
    """A model with a first fit, and how all starts ended."""

    model: OuterModel
    fit: Fit
    starts: tuple[tuple[str, float, float], ...]


def settled(
    points: Points, candidate: Candidate, noise: Noise, options: Options, density: float | None = None
) -> Superposition:
    """Repeat fit, noise and smoothing until the noise levels stand still.

    ``density`` is that of the terms per decade; default the candidate's.
    """
    fit, model = candidate.fit, candidate.model
    density = density or fit.grid.terms_per_decade
    expected = fit.predicted
    near: float | None = None
    measured = np.concatenate([points.storage, points.loss])
    standardised = (measured - expected) * weights_of(points, noise, expected)
    for _ in range(_MAX_PASSES):
        plain = weights_of(points, noise, expected)
        weight = plain * _root_of_influence(standardised, options)
        model = replace(model, expectation=expected_shifts(model.temperature, fit.state.log10_aT))
        grid = grid_for(points, fit.state, density)
        fit = evaluate(points, weight, grid, fit.state, None, near)
        fit = minimise(points, weight, fit, model)
        near, expected = fit.solution.strength, fit.predicted
        residual = (measured - expected) * plain
        if options.robust:
            residual = np.clip(residual, -_HUBER, _HUBER)
        covariance, factors = _covariance_and_noise(points, fit, model, residual)
        model = _with_spread(model, fit, covariance)
        last, noise = noise, next_noise(noise, factors, options.scatter, options.noise_ratio)
        standardised = (measured - expected) * weights_of(points, noise, expected)
        change = np.abs(np.log([noise.storage / last.storage, noise.loss / last.loss]))
        if np.max(change) < _NOISE_SETTLED:
            break
    return Superposition(model, fit, noise, covariance, standardised, candidate.starts)


def _with_spread(model: OuterModel, fit: Fit, covariance: Floats) -> OuterModel:
    """Estimate the spread of the levels from the levels, as noise from residuals."""
    if model.level_spread <= 0:
        return model
    levels = model.levels(fit.state.parameters)
    variance = np.diag(covariance)[model.level_slice]
    determined = max(float(np.sum(1.0 - variance / model.level_spread**2)), 1.0)
    spread = float(np.sqrt(np.sum(levels**2) / determined))
    return replace(model, level_spread=float(np.clip(spread, _LEAST_LEVELS, _MOST_LEVELS)))


def weights_of(points: Points, noise: Noise, expected: Floats | None = None) -> Floats:
    """One over the standard deviation of every modulus; relative to the model once there is one.

    Weights from the measured values themselves would favour low readings.
    """
    size = np.concatenate([points.storage, points.loss]) if expected is None else expected
    half = points.omega.size
    sigma = np.concatenate([np.full(half, noise.storage), np.full(half, noise.loss)])
    return np.asarray(points.certainty / (sigma * np.maximum(np.abs(size), np.finfo(float).tiny)))


def weights_in(points: Points, current: Superposition, options: Options) -> Floats:
    """Weights of a settled fit: of its noise, and such that few outliers do not decide."""
    plain = weights_of(points, current.noise, current.fit.predicted)
    return np.asarray(plain * _root_of_influence(current.standardised, options))


def _root_of_influence(standardised: Floats, options: Options) -> Floats:
    """One within the limit, beyond it such that the squared residual counts linearly."""
    if not options.robust:
        return np.ones(standardised.size)
    return np.asarray(np.sqrt(_HUBER / np.maximum(np.abs(standardised), _HUBER)))


def influences(points: Points, fit: Fit, model: OuterModel) -> list[tuple[Floats, Floats]]:
    """Return the parts G, C of the influence G C Gᵀ of the readings on the fit: of spectrum, and of the rest."""
    inverse = np.asarray(np.linalg.pinv(fit.normal, hermitian=True))
    parts = [(fit.rows, inverse)]
    if model.size:
        change = sensitivity(points, fit, model)
        normal, _ = outer_problem(points, fit, model)
        rest = change - fit.rows @ (inverse @ (fit.rows.T @ change))
        parts.append((rest, np.asarray(np.linalg.pinv(normal, hermitian=True))))
    return parts


def _covariance_and_noise(
    points: Points, fit: Fit, model: OuterModel, residual: Floats
) -> tuple[Floats, tuple[float, float]]:
    """Return the covariance of the outer parameters and the factors on both noise levels.

    Each modulus has as many free residuals as it has points, less its share of the fitted
    freedom (its leverage); so a noise ratio comes out right even when one modulus dominates.
    """
    parts = influences(points, fit, model)
    leverage = np.sum([propagated_variance(*part) for part in parts], axis=0)
    covariance = parts[1][1] if model.size else np.empty((0, 0))
    half = points.omega.size
    factors = []
    for part in (slice(0, half), slice(half, None)):
        freedom = max(half - float(np.sum(leverage[part])), 1.0)
        factors.append(float(np.sqrt(np.sum(residual[part] ** 2) / freedom)))
    return covariance, (factors[0], factors[1])

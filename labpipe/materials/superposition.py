"""The whole fit of a master curve: starts, noise levels, smoothing, and which laws the data need.

The joint fit of :mod:`labpipe.materials.joint_fit` is run from several starts; around it turn the
things that only the residuals can tell: how noisy either modulus is, which points are outliers,
how smooth the spectrum is, and whether the data need a vertical shift or an instrument delay.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.materials.joint_fit import (
    Fit,
    Points,
    evaluate,
    grid_for,
    minimise,
    outer_problem,
    sensitivity,
    total_cost,
)
from labpipe.materials.outer_model import OuterModel, State, Vertical, expected_shifts
from labpipe.materials.shift_law import fit_law
from labpipe.materials.shift_start import overlapped_shifts, scanned_shifts
from labpipe.materials.spectrum import MARGIN_DECADES, TERMS_PER_DECADE

Array = NDArray[np.float64]

# Before the first fit the shifts may still move: the grid of times reaches further out.
_FIRST_MARGIN = 1.5
# Smoothing for comparing starts, in units of the noise; cross-validation follows.
_FIRST_STRENGTH = 100.0
# Passes of noise, outliers and smoothing around the joint fit, and when they have settled.
_MAX_PASSES = 6
_NOISE_SETTLED = 0.02
# Relative noise is never taken below this: cleaner data are limited by the grid of times.
_LEAST_NOISE = 1e-6
_ASSUMED_NOISE = 0.02
# Residuals beyond this many standard deviations count with their root only (Huber); normal
# noise exceeds it once in 370 points, so clean data lose nothing.
_HUBER = 3.0
# Vertical law, delay and levels are added one at a time, and may each be revised once.
_MAX_EXTENSIONS = 5
# First and extreme standard deviations of the levels (relative): clamping a sample anew moves its
# modulus by some percent.
_FIRST_LEVELS, _LEAST_LEVELS, _MOST_LEVELS = 0.02, 0.002, 0.1
# Evidence (difference of Schwarz's criterion) that counts as strong, Kass & Raftery, J. Am. Stat.
# Assoc. 90 (1995) 773: a smoothed spectrum leaves small systematic residuals of its own.
_STRONG_EVIDENCE = 6.0
# Candidates are compared before they have settled to the last digit: tolerance and iterations.
_SCREENING = (1e-3, 8)
# A law through the best start is a third start; it needs more isotherms than it has constants.
_LAW_NEEDS = 3
_LAW_ROUGHNESS = 0.1


@dataclass(frozen=True, slots=True)
class Noise:
    """Relative noise of storage and loss, as estimated from the residuals."""

    storage: float
    loss: float


@dataclass(frozen=True, slots=True)
class Superposition:
    """A settled joint fit with the covariance of its outer parameters.

    Attributes
    ----------
    model : OuterModel
    fit : Fit
    noise : Noise
    covariance : array (parameter, parameter)
        Of the outer parameters, the spectrum having followed.
    standardised : array (2 point,)
        Residuals in units of the noise, storage first, outliers not weakened.
    starts : tuple of (str, float, float)
        Name of every start, its final cost in units of the noise, and how far its shifts end
        from the best ones (largest difference, decades).
    """

    model: OuterModel
    fit: Fit
    noise: Noise
    covariance: Array
    standardised: Array
    starts: tuple[tuple[str, float, float], ...]


def superpose(
    points: Points,
    model: OuterModel,
    *,
    starts: Sequence[tuple[str, Array]] | None = None,
    verticals: Sequence[Vertical] = ("none",),
    delay: bool | None = False,
    levels: bool | None = False,
    robust: bool = True,
    noise_ratio: float | None = None,
) -> Superposition:
    """Fit shifts, spectrum and the laws that the data need.

    Parameters
    ----------
    points : Points
    model : OuterModel
        Horizontal law; its vertical law and delay are chosen here.
    starts : sequence of (str, array (isotherm,)), optional
        Named first estimates of log10 a_T; default the pairwise scan and the overlap.
    verticals : sequence of str
        Candidate vertical laws; one is taken as it is, of several the criterion chooses.
    delay : bool or None
        Whether the instrument's phase has a delay; None lets the criterion decide.
    levels : bool or None
        Whether every isotherm has a small level of its own; None lets the criterion decide.
    robust : bool
        Weaken outliers.
    noise_ratio : float, optional
        Relative noise of the loss over that of the storage modulus; default estimated.
    """
    noise = _model_free_noise(points)
    if noise_ratio is not None:
        noise = _at_ratio(noise, noise_ratio)
    options = _Options(tuple(verticals), delay, levels, robust, noise_ratio)
    base = replace(
        model,
        vertical=verticals[0],
        has_delay=delay is True,
        level_spread=_FIRST_LEVELS if levels is True else 0.0,
    )
    best = _best_start(points, base, noise, starts)
    current = _settled(points, best, noise, options)
    for _ in range(_MAX_EXTENSIONS):
        extended = _extended(points, current, options, starts)
        if extended is None:
            break
        current = _settled(points, extended, current.noise, options)
    return current


@dataclass(frozen=True, slots=True)
class _Options:
    verticals: tuple[Vertical, ...]
    delay: bool | None
    levels: bool | None
    robust: bool
    noise_ratio: float | None


@dataclass(frozen=True, slots=True)
class _Candidate:
    model: OuterModel
    fit: Fit
    starts: tuple[tuple[str, float, float], ...]


def _best_start(
    points: Points,
    model: OuterModel,
    noise: Noise,
    starts: Sequence[tuple[str, Array]] | None,
) -> _Candidate:
    """Run the joint fit from every start and keep the best."""
    ln_bT = model.fixed_ln_bT()
    if starts is None:
        starts = (
            ("overlap", overlapped_shifts(points, model.temperature, ln_bT)),
            ("scan", scanned_shifts(points, model.temperature, ln_bT)),
        )
    weight = _weights(points, noise)
    runs = [_run(points, weight, model, name, shifts) for name, shifts in starts]
    if len(runs) > 1 and model.horizontal == "free" and model.temperature.size > _LAW_NEEDS:
        best = min(runs, key=lambda run: run.cost)
        runs.append(_run(points, weight, model, "law", _smoothed(points, best)))
    runs.sort(key=lambda run: run.cost)
    best_shifts = runs[0].fit.state.log10_aT
    report = tuple(
        (run.name, run.cost, float(np.max(np.abs(run.fit.state.log10_aT - best_shifts))))
        for run in runs
    )
    return _Candidate(runs[0].model, runs[0].fit, report)


@dataclass(frozen=True, slots=True)
class _Run:
    name: str
    cost: float
    fit: Fit
    model: OuterModel


def _run(points: Points, weight: Array, model: OuterModel, name: str, shifts: Array) -> _Run:
    """Run the joint fit from one start with a stiff spectrum."""
    expectation = expected_shifts(model.temperature, shifts)
    started = replace(model, given=shifts - shifts[model.reference], expectation=expectation)
    state = started.start()
    grid = grid_for(points, state, TERMS_PER_DECADE, _FIRST_MARGIN)
    first = evaluate(points, weight, grid, state, _FIRST_STRENGTH)
    fit = minimise(points, weight, first, started)
    return _Run(name, total_cost(fit, started), fit, started)


def _smoothed(points: Points, run: _Run) -> Array:
    """Put shifts on the WLF law through those that the data determine."""
    model, state = run.model, run.fit.state
    normal, _ = outer_problem(points, run.fit, model)
    covariance = np.linalg.pinv(normal, hermitian=True)
    keep = np.arange(model.temperature.size) != model.reference
    full = np.zeros((keep.size, keep.size))
    free = slice(0, model.horizontal_size)
    full[np.ix_(keep, keep)] = covariance[free, free]
    # A law is never exact: its own roughness keeps the best shifts from ruling alone.
    full += _LAW_ROUGHNESS**2 * np.eye(keep.size)
    T_ref = float(model.temperature[model.reference])
    law = fit_law("wlf", model.temperature, state.log10_aT, full, T_ref)
    return law.log10_aT(model.temperature)


def _settled(
    points: Points, candidate: _Candidate, noise: Noise, options: _Options
) -> Superposition:
    """Repeat fit, noise and smoothing until the noise levels stand still."""
    fit, model = candidate.fit, candidate.model
    expected = fit.predicted
    near: float | None = None
    standardised = np.zeros(expected.size)
    for _ in range(_MAX_PASSES):
        weight = _weights(points, noise, expected)
        if options.robust:
            weight = weight * np.sqrt(
                np.minimum(1.0, _HUBER / np.maximum(np.abs(standardised), _HUBER))
            )
        model = replace(model, expectation=expected_shifts(model.temperature, fit.state.log10_aT))
        grid = grid_for(points, fit.state, TERMS_PER_DECADE, MARGIN_DECADES)
        fit = evaluate(points, weight, grid, fit.state, None, near)
        fit = minimise(points, weight, fit, model)
        near, expected = fit.solution.strength, fit.predicted
        covariance, factors = _covariance_and_noise(points, fit, model)
        model = _with_spread(model, fit, covariance)
        if options.noise_ratio is not None:
            factors = (float(np.hypot(*factors) / np.sqrt(2.0)),) * 2
        plain = _weights(points, noise, expected)
        noise = Noise(
            max(noise.storage * factors[0], _LEAST_NOISE),
            max(noise.loss * factors[1], _LEAST_NOISE),
        )
        measured = np.concatenate([points.storage, points.loss])
        half = points.omega.size
        standardised = (measured - expected) * plain
        standardised[:half] /= factors[0]
        standardised[half:] /= factors[1]
        if max(abs(f - 1.0) for f in factors) < _NOISE_SETTLED:
            break
    return Superposition(model, fit, noise, covariance, standardised, candidate.starts)


def _with_spread(model: OuterModel, fit: Fit, covariance: Array) -> OuterModel:
    """Estimate the spread of the levels from the levels, as noise from residuals."""
    if model.level_spread <= 0:
        return model
    levels = model.levels(fit.state.parameters)
    variance = np.diag(covariance)[model.level_slice]
    determined = max(float(np.sum(1.0 - variance / model.level_spread**2)), 1.0)
    spread = float(np.sqrt(np.sum(levels**2) / determined))
    return replace(model, level_spread=float(np.clip(spread, _LEAST_LEVELS, _MOST_LEVELS)))


def _weights(points: Points, noise: Noise, expected: Array | None = None) -> Array:
    """One over the standard deviation of every modulus; relative to the model once there is one.

    Weights from the measured values themselves would favour low readings.
    """
    size = np.concatenate([points.storage, points.loss]) if expected is None else expected
    half = points.omega.size
    sigma = np.concatenate([np.full(half, noise.storage), np.full(half, noise.loss)])
    return np.asarray(1.0 / (sigma * np.maximum(np.abs(size), np.finfo(float).tiny)))


def _covariance_and_noise(
    points: Points, fit: Fit, model: OuterModel
) -> tuple[Array, tuple[float, float]]:
    """Return the covariance of the outer parameters and the factors on both noise levels.

    Each modulus has as many free residuals as it has points, less its share of the fitted
    freedom (its leverage); so a noise ratio comes out right even when one modulus dominates.
    """
    inverse = np.linalg.inv(fit.normal)
    leverage = np.einsum("ij,jk,ik->i", fit.rows, inverse, fit.rows)
    covariance = np.empty((0, 0))
    if model.size:
        change = sensitivity(points, fit, model)
        normal, _ = outer_problem(points, fit, model)
        covariance = np.linalg.pinv(normal, hermitian=True)
        followed = change - fit.rows @ (inverse @ (fit.rows.T @ change))
        leverage += np.einsum("ij,jk,ik->i", followed, covariance, followed)
    half = points.omega.size
    factors = []
    for part in (slice(0, half), slice(half, None)):
        freedom = max(half - float(np.sum(leverage[part])), 1.0)
        factors.append(float(np.sqrt(np.sum(fit.residual[part] ** 2) / freedom)))
    return covariance, (factors[0], factors[1])


def _model_free_noise(points: Points) -> Noise:
    """Scatter of either modulus about a parabola per isotherm; it only starts the iteration."""
    levels = []
    for values in (points.storage, points.loss):
        squares, freedom = 0.0, 0
        for k in range(points.count):
            mask = points.isotherm == k
            if np.count_nonzero(mask) < 5:
                continue
            x, y = np.log(points.omega[mask]), np.log(values[mask])
            residual = y - np.polyval(np.polyfit(x - x.mean(), y, 2), x - x.mean())
            squares += float(residual @ residual)
            freedom += x.size - 3
        levels.append(np.sqrt(squares / freedom) if freedom else _ASSUMED_NOISE)
    return Noise(max(levels[0], _LEAST_NOISE), max(levels[1], _LEAST_NOISE))


def _at_ratio(noise: Noise, ratio: float) -> Noise:
    """Keep the mean square of both levels in units of the noise, at a given ratio."""
    level = float(np.sqrt(0.5 * (noise.storage**2 + (noise.loss / ratio) ** 2)))
    return Noise(level, ratio * level)


def _extended(
    points: Points,
    current: Superposition,
    options: _Options,
    starts: Sequence[tuple[str, Array]] | None,
) -> _Candidate | None:
    """Return the single change of laws that the criterion favours most, None if there is none."""
    moves = _moves(current.model, options)
    if not moves or not _may_gain(points, current, moves):
        return None
    weight = _weights(points, current.noise, current.fit.predicted) * _huber(current, options)
    best: _Candidate | None = None
    # The present model is fitted anew as well: only costs of equal weights can be compared.
    present = _screened(points, weight, current, current.model, current.fit.state)
    least = _criterion(points, present, current.model)
    for model in [move for move in moves if move.has_delay > current.model.has_delay]:
        fit = _screened(points, weight, current, model, current.fit.state)
        if _criterion(points, fit, model) < least:
            # A delay bends the loss of every sweep; the other laws are judged without it.
            return _Candidate(model, fit, current.starts)
    restarts = _restarts(points, current) if starts is None else []
    for model in [move for move in moves if move.has_delay <= current.model.has_delay]:
        for first in [current.fit.state, *restarts]:
            fit = _screened(points, weight, current, model, first)
            score = _criterion(points, fit, model)
            if score < least:
                best, least = _Candidate(model, fit, current.starts), score
    return best


def _moves(model: OuterModel, options: _Options) -> list[OuterModel]:
    """List the models one change away from the present one."""
    moves = [replace(model, vertical=v) for v in options.verticals if v != model.vertical]
    if options.delay is None:
        moves.append(replace(model, has_delay=not model.has_delay))
    if options.levels is None:
        moves.append(replace(model, level_spread=0.0 if model.level_spread else _FIRST_LEVELS))
    return moves


def _may_gain(points: Points, current: Superposition, moves: list[OuterModel]) -> bool:
    """Ask the gradient first whether any further parameter could be worth its price.

    One look at the residuals instead of a fit per candidate; data that need nothing pay nothing.
    """
    price = float(np.log(2 * points.omega.size))
    for model in moves:
        extra = model.law_size - current.model.law_size
        if extra <= 0 and not model.level_spread > current.model.level_spread:
            # Nothing to ask: a law that was needed before another came may be idle now.
            if current.model.has_delay or current.model.level_spread:
                return True
            continue
        probe = replace(current.fit, state=model.start(current.fit.state))
        normal, gradient = outer_problem(points, probe, model)
        gain = float(gradient @ np.linalg.pinv(normal, hermitian=True) @ gradient)
        if gain > price * max(extra, 1) + _STRONG_EVIDENCE:
            return True
    return False


def _restarts(points: Points, current: Superposition) -> list[State]:
    """Start anew under b ∝ T, the phase's present delay taken out of the data."""
    model, delay = current.model, current.fit.state.delay
    turned = (points.storage + 1j * points.loss) * np.exp(-1j * points.omega * delay)
    if not (turned.imag > 0).all():
        turned = points.storage + 1j * points.loss
    clean = replace(points, storage=turned.real, loss=turned.imag)
    ln_bT = replace(model, vertical="rho_T").fixed_ln_bT()
    found = (
        overlapped_shifts(clean, model.temperature, ln_bT),
        scanned_shifts(clean, model.temperature, ln_bT),
    )
    return [State(np.empty(0), shifts - shifts[model.reference], ln_bT, delay) for shifts in found]


def _screened(
    points: Points, weight: Array, current: Superposition, model: OuterModel, first: State
) -> Fit:
    """Fit another model from a state, well enough to compare it."""
    strength = current.fit.solution.strength
    state = model.start(first)
    grid = grid_for(points, state, TERMS_PER_DECADE, _FIRST_MARGIN)
    stiff = evaluate(points, weight, grid, state, max(strength, _FIRST_STRENGTH))
    stiff = minimise(points, weight, stiff, model, *_SCREENING)
    grid = grid_for(points, stiff.state, TERMS_PER_DECADE, MARGIN_DECADES)
    fit = evaluate(points, weight, grid, stiff.state, strength)
    return minimise(points, weight, fit, model, *_SCREENING)


def _criterion(points: Points, fit: Fit, model: OuterModel) -> float:
    """Schwarz's criterion; every law beyond horizontal shifts has to have strong evidence.

    The law b ∝ T has no number, but choosing it is half a parameter.
    Levels are random, not chosen: their price is the evidence lost by having to determine them
    (how much narrower the data make them than their spread), and one parameter, the spread.
    """
    price = float(np.log(2 * points.omega.size))
    count = model.law_size + (0.5 if model.vertical == "rho_T" else 0.0)
    laws = (model.vertical != "none") + model.has_delay + (model.level_spread > 0)
    score = total_cost(fit, model) + count * price + laws * _STRONG_EVIDENCE
    if model.level_spread > 0:
        normal, _ = outer_problem(points, fit, model)
        at = model.level_slice
        covariance = np.linalg.pinv(normal, hermitian=True)[at, at]
        score += price - float(np.linalg.slogdet(covariance / model.level_spread**2)[1])
    return score


def _huber(current: Superposition, options: _Options) -> Array:
    """Square root of the weight of every residual: one, less beyond the limit."""
    size = np.abs(current.standardised)
    if not options.robust:
        return np.ones(size.size)
    return np.asarray(np.sqrt(np.minimum(1.0, _HUBER / np.maximum(size, _HUBER))))


def free_shifts_gain(points: Points, found: Superposition) -> float:
    """Return the F statistic of replacing the shift law by free shifts.

    About one when the law holds; large when it does not.
    """
    law = found.model
    shifts = found.fit.state.log10_aT
    free = replace(
        law,
        horizontal="free",
        given=shifts - shifts[law.reference],
        expectation=expected_shifts(law.temperature, shifts),
    )
    weight = _weights(points, found.noise, found.fit.predicted)
    tied = evaluate(points, weight, found.fit.grid, found.fit.state, found.fit.solution.strength)
    state = replace(free.start(), ln_bT=found.fit.state.ln_bT, delay=found.fit.state.delay)
    state = free.start(replace(state, log10_aT=shifts))
    first = evaluate(points, weight, found.fit.grid, state, found.fit.solution.strength)
    loose = minimise(points, weight, first, free)
    extra = free.size - law.size
    rest = max(2 * points.omega.size - loose.solution.freedom - free.size, 1.0)
    return float(((tied.cost - loose.cost) / extra) / (loose.solution.misfit / rest))

"""Which laws the data need beyond horizontal shifts: vertical factor, delay, levels of sweeps."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials.superposition._first_shifts import overlapped_shifts, scanned_shifts
from labpipe.materials.superposition._joint_fit import (
    Fit,
    Points,
    evaluate,
    grid_for,
    minimise,
    outer_problem,
    total_cost,
)
from labpipe.materials.superposition._reweighting import (
    FIRST_LEVELS,
    Candidate,
    Options,
    Superposition,
    weights_in,
    weights_of,
)
from labpipe.materials.superposition._shift_parameters import SLOPE_SPREAD, OuterModel, State, expected_shifts
from labpipe.materials.superposition._vertical_law import Vertical, is_physical, vertical_values
from labpipe.units import ZERO_CELSIUS

# Smoothing for comparing starts, in units of the noise; cross-validation follows.
FIRST_STRENGTH = 100.0
#: Evidence (difference of Schwarz's criterion) that counts as strong, Kass & Raftery, J. Am. Stat.
# Assoc. 90 (1995) 773: a smoothed spectrum leaves small systematic residuals of its own.
STRONG_EVIDENCE = 6.0
# Smoothing, in units of the noise, that biases no shift: below it their covariance hardly depends on it.
_UNBIASED = 1.0
# Odds of a slope before the data; even odds would make the limits of materials without one too wide.
_ODDS = 1.0 / 3.0
# Exponent at which odds are certain.
_SURE = 50.0
# Starts that differ by less (decades) end in the same minimum.
_SAME_BASIN = 0.3
# So many of the candidates that a stiff spectrum fits best are fitted with the present smoothing.
_MOST_FITTED = 3
# Candidates are compared before they have settled to the last digit: tolerance and iterations.
_SCREENING = (1e-3, 8)


def extended_by_a_law(
    points: Points, current: Superposition, options: Options, starts: Sequence[tuple[str, Floats]] | None
) -> Candidate | None:
    """Return the single change of laws that the criterion favours most, None if there is none."""
    moves = _moves(current.model, options)
    if not moves or not _may_gain(points, current, moves):
        return None
    weight = weights_in(points, current, options)
    best: Candidate | None = None
    # The present model is fitted anew as well: only costs of equal weights can be compared.
    present = screened(points, weight, current, current.model, current.fit.state)
    least = _criterion(points, present, current.model)
    for model in [move for move in moves if move.has_delay > current.model.has_delay]:
        fit = screened(points, weight, current, model, current.fit.state)
        if _criterion(points, fit, model) < least:
            # A delay bends the loss of every sweep; the other laws are judged without it.
            return Candidate(model, fit, current.starts)
    # Without a vertical law the shifts may have gone far to make up for it: start anew as well.
    stiffness = float(points.storage.min())
    is_plain = current.model.vertical == "none" and not current.model.level_spread
    clean = entropic_ln_bT(current.model)
    first_states = [
        first
        for first in (restarts(points, current, clean) if is_plain and starts is None else [])
        if not _are_alike(first.log10_aT, current.fit.state.log10_aT)
    ]
    tried: list[tuple[float, OuterModel, Fit]] = []
    for model in [move for move in moves if move.has_delay <= current.model.has_delay]:
        is_removal = (model.vertical, model.level_spread) == (current.model.vertical, current.model.level_spread)
        for first in [current.fit.state, *([] if is_removal else first_states)]:
            if tried and not points.work.goes_on():
                break
            fit = _stiff(points, weight, current, model, first)
            tried.append((_criterion(points, fit, model), model, fit))
    tried.sort(key=lambda one: one[0])
    for _, model, stiff in tried[:_MOST_FITTED]:
        fit = _loosened(points, weight, current, model, stiff)
        score = _criterion(points, fit, model)
        if score < least and is_physical(fit.state.ln_bT, model.temperature, model.T_ref, stiffness):
            best, least = Candidate(model, fit, current.starts), score
    return best


def _moves(model: OuterModel, options: Options) -> list[OuterModel]:
    """List the models one change away from the present one.

    A delay may have come in the place of another law: of a liquid that flows, it changes the
    storage modulus as a vertical factor would. So a law may come and the delay go at once.
    """
    moves = [under_law(model, v, options.verticals) for v in options.verticals if v != model.vertical]
    if options.delay is None:
        if model.has_delay:
            moves += [replace(move, has_delay=False) for move in moves]
        moves.append(replace(model, has_delay=not model.has_delay))
    if options.levels is None:
        moves.append(replace(model, level_spread=0.0 if model.level_spread else FIRST_LEVELS))
    return moves


def under_law(model: OuterModel, vertical: Vertical, among: Sequence[Vertical]) -> OuterModel:
    """Return a model under another vertical law, one among several.

    Where a modulus grows as T does, the density falls as well, and a glass softens: by slopes that are
    known in size.
    """
    is_sloped = vertical == "rho_T" or "rho_T" not in among
    return replace(model, vertical=vertical, slope_spread=SLOPE_SPREAD if is_sloped else 0.0)


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
        if gain > price * max(extra, 1) + STRONG_EVIDENCE:
            return True
    return False


def restarts(points: Points, current: Superposition, ln_bT: Floats) -> list[State]:
    """Start anew under a vertical law, the phase's present delay taken out of the data.

    Of two starts that are alike, one will do.
    """
    model, delay = current.model, current.fit.state.delay
    turned = (points.storage + 1j * points.loss) * np.exp(-1j * points.omega * delay)
    if not (turned.imag > 0).all():
        turned = points.storage + 1j * points.loss
    clean = replace(points, storage=turned.real, loss=turned.imag)
    found = [start(clean, model.temperature, ln_bT) for start in (overlapped_shifts, scanned_shifts)]
    found = [shifts - shifts[model.reference] for shifts in found]
    kept = found[: 1 if _are_alike(*found) else 2]
    return [State(np.empty(0), shifts, ln_bT, delay) for shifts in kept]


def _are_alike(one: Floats, other: Floats) -> bool:
    """Tell whether two starts will end in the same minimum."""
    return float(np.max(np.abs(one - other))) < _SAME_BASIN


def entropic_ln_bT(model: OuterModel) -> Floats:
    """Return ln b of the law b ∝ T."""
    found = vertical_values("rho_T", np.empty(0), model.temperature, model.T_ref)
    return np.zeros(model.temperature.size) if found is None else found


def screened(points: Points, weight: Floats, current: Superposition, model: OuterModel, first: State) -> Fit:
    """Fit another model from a state, well enough to compare it."""
    return _loosened(points, weight, current, model, _stiff(points, weight, current, model, first))


def _stiff(points: Points, weight: Floats, current: Superposition, model: OuterModel, first: State) -> Fit:
    """Fit another model from a state with a spectrum that hardly bends."""
    state = model.start(first)
    grid = grid_for(points, state, current.fit.grid.terms_per_decade)
    fit = evaluate(points, weight, grid, state, max(current.fit.solution.strength, FIRST_STRENGTH))
    return minimise(points, weight, fit, model, *_SCREENING)


def _loosened(points: Points, weight: Floats, current: Superposition, model: OuterModel, stiff: Fit) -> Fit:
    """Go on from a stiff fit with the smoothing of the present one."""
    grid = grid_for(points, stiff.state, current.fit.grid.terms_per_decade)
    fit = evaluate(points, weight, grid, stiff.state, current.fit.solution.strength)
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
    score = total_cost(fit, model) + count * price + laws * STRONG_EVIDENCE
    if model.level_spread > 0 or model.has_slope:
        normal, _ = outer_problem(points, fit, model)
        covariance = np.linalg.pinv(normal, hermitian=True)
    if model.level_spread > 0:
        at = model.level_slice
        score += price - float(np.linalg.slogdet(covariance[at, at] / model.level_spread**2)[1])
    if model.has_slope:
        score -= float(np.log(covariance[model.horizontal_size, model.horizontal_size]))
    return score


class PossibleSlope(NamedTuple):
    """A slope of ln b about a vertical law without numbers, in its standard deviations.

    ``along`` are the changes of all parameters with it; ``gain`` is what it would take off the cost.
    """

    model: OuterModel
    fit: Fit
    value: float
    variance: float
    along: Floats

    @property
    def gain(self) -> float:
        """Squared residuals that the slope explains."""
        return self.value**2 / self.variance


def possible_slope(points: Points, found: Superposition) -> PossibleSlope | None:
    """Return the slope that a fit may have beside its vertical law; None where the law has one."""
    if found.model.has_slope:
        return None
    model = replace(found.model, slope_spread=SLOPE_SPREAD)
    if not model.has_slope or not model.horizontal_size:
        return None
    at, state = model.horizontal_size, found.fit.state
    fit = replace(found.fit, state=replace(state, parameters=np.insert(state.parameters, at, 0.0)))
    normal, gradient = outer_problem(points, fit, model)
    joint = np.linalg.pinv(normal, hermitian=True)
    variance = float(joint[at, at])
    if variance <= 0.0:
        return None
    return PossibleSlope(model, fit, float(joint[at] @ gradient), variance, joint[at] / variance)


def less_smoothed(points: Points, current: Superposition, options: Options) -> Fit | None:
    """Evaluate a fit with a spectrum that is free to bend; None where it is free already.

    Cross-validation smooths until the moduli are predicted best, and trades bias for variance. The
    flat loss of a glass is predicted best by a spectrum that hardly bends; as if that were known of
    the material, its shifts would look far better determined than the sweeps determine them.

    References
    ----------
    Hall, Ann. Stat. 20 (1992) 675, doi:10.1214/aos/1176348651.
    """
    if current.fit.solution.strength <= _UNBIASED:
        return None
    weight = weights_in(points, current, options)
    return evaluate(points, weight, current.fit.grid, current.fit.state, _UNBIASED)


def with_possible_slope(points: Points, found: Superposition, options: Options) -> Superposition:
    """Widen a fit whose vertical law has no numbers by the slope that it may have all the same.

    Sweeps of a broad spectrum hardly tell a vertical slope from shifts that all differ by a share,
    and what is not told is left out by the criterion. No modulus is the same at all temperatures,
    though: with odds of one to three before the data there is a slope of :data:`SLOPE_SPREAD`, and with
    even odds that of entropy and density. With the odds after them the variance of either, and its best
    value squared, are part of the covariance. The fit stays. (A glass always has a slope.)
    """
    loose = less_smoothed(points, found, options)
    slope = possible_slope(points, replace(found, fit=loose or found.fit))
    if slope is None:
        return found
    variance = slope.variance
    priors = [(_ODDS, 0.0), (1.0, 1.0 / (found.model.T_ref + ZERO_CELSIUS) / SLOPE_SPREAD)]
    # Prior slopes of unit variance about zero and about that of entropy: where they end, and their evidence.
    means = [slope.value + mean * variance for _, mean in priors]
    gains = [0.5 * (mean**2 / variance - prior**2) for mean, (_, prior) in zip(means, priors, strict=True)]
    odds = [
        before * np.sqrt(variance) * np.exp(min(gain, _SURE)) for gain, (before, _) in zip(gains, priors, strict=True)
    ]
    second = sum(odd * (variance + mean**2) for odd, mean in zip(odds, means, strict=True)) / (1.0 + sum(odds))
    at = slope.model.horizontal_size
    covariance = np.insert(np.insert(found.covariance, at, 0.0, axis=0), at, 0.0, axis=1)
    covariance = covariance + second * np.outer(slope.along, slope.along)
    # The parameters have one more, of value zero; the spectrum stays the one that predicts best.
    return replace(found, model=slope.model, fit=replace(found.fit, state=slope.fit.state), covariance=covariance)


def free_shifts_gain(points: Points, found: Superposition) -> float:
    """Return the F statistic of replacing the shift law by free shifts.

    About one when the law holds; large when it does not.
    """
    law = found.model
    shifts = found.fit.state.log10_aT
    given, expected = shifts - shifts[law.reference], expected_shifts(law.temperature, shifts)
    free = replace(law, horizontal="free", given=given, expectation=expected)
    weight = weights_of(points, found.noise, found.fit.predicted)
    tied = evaluate(points, weight, found.fit.grid, found.fit.state, found.fit.solution.strength)
    state = replace(free.start(), ln_bT=found.fit.state.ln_bT, delay=found.fit.state.delay)
    state = free.start(replace(state, log10_aT=shifts))
    first = evaluate(points, weight, found.fit.grid, state, found.fit.solution.strength)
    loose = minimise(points, weight, first, free)
    extra = free.size - law.size
    rest = max(2 * points.omega.size - loose.solution.freedom - free.size, 1.0)
    return float(((tied.cost - loose.cost) / extra) / (loose.solution.misfit / rest))

"""The whole fit of a master curve: starts, noise levels, smoothing, and the laws that the data need.

The joint fit of :mod:`._joint_fit` is run from two or three starts, then repeated with the noise levels and
the smoothing that its residuals ask for. A vertical factor and a delay of the instrument's phase are added one at a
time, as long as Schwarz's criterion is strongly in favour of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials._shift_law import fit_law
from labpipe.materials.spectrum import TERMS_PER_DECADE
from labpipe.materials.superposition._joint_fit import (
    Fit,
    Points,
    evaluate,
    grid_for,
    minimise,
    outer_problem,
    predictive_cost,
    sensitivity,
    total_cost,
)
from labpipe.materials.superposition._noise import (
    ASSUMED_NOISE,
    Noise,
    Scatter,
    design_effect,
    next_noise,
    scatter_of_sweeps,
)
from labpipe.materials.superposition._pairwise_shifts import overlapped_shifts, scanned_shifts
from labpipe.materials.superposition._parameters import (
    SLOPE_SPREAD,
    VERTICAL_SIZE,
    OuterModel,
    State,
    Vertical,
    expected_shifts,
    is_physical,
)
from labpipe.uncertainty import propagated_variance
from labpipe.units import ZERO_CELSIUS

# Vertical law and delay are added one at a time, and may each be revised once.
_MAX_EXTENSIONS = 4
#: Evidence (difference of Schwarz's criterion) that counts as strong, Kass & Raftery, J. Am. Stat.
#: Assoc. 90 (1995) 773: a smoothed spectrum leaves small systematic residuals of its own.
STRONG_EVIDENCE = 6.0
#: Starts and solutions that differ by less (decades) are the same.
SAME_SOLUTION = 0.15
# Smoothing for comparing starts, in units of the noise, and one that biases no shift.
_STIFF, _UNBIASED = 100.0, 1.0
# Starts and candidates are compared before they have settled to the last digit: tolerance and iterations.
_SCREENING = 1e-3, 8
# A law through the best start is a third start; it needs more isotherms than it has constants.
_LAW_NEEDS, _LAW_ROUGHNESS = 3, 0.1
# Passes of noise and smoothing around the joint fit, and the change of noise at which they have settled.
_MAX_PASSES, _NOISE_SETTLED = 6, 0.02
_ROUGHER = 0.01  # of the smoothing, by which its effect on the shifts is seen
# Odds of a slope before the data; even odds would make the limits of materials without one too wide.
_ODDS = 1.0 / 3.0
# Delay (s) of the phase of an instrument, in order of size: public exports show 20 to 120 microseconds.
_DELAY = 5e-5


@dataclass(frozen=True, slots=True)
class Options:
    """Choices of the user; of several ``verticals``, and of ``delay`` None, the criterion chooses.

    ``moduli_per_parameter``, ``least_noise``: of tests over time, whose moduli come from few terms.
    """

    verticals: tuple[Vertical, ...] = ("none",)
    delay: bool | None = False
    moduli_per_parameter: float = 1.0
    least_noise: float = 0.0
    scatter: Scatter | None = None


@dataclass(frozen=True, slots=True)
class Superposition:
    """A settled joint fit with the covariance of its outer parameters.

    ``covariance`` (parameter, parameter): Of the outer parameters, the spectrum having followed. ``starts``: Name of
    every start, its final cost in units of the noise, and the largest difference of its shifts from the best ones
    (decades). ``violation``: Noise of the fit over scatter of the sweeps, of the worse modulus; one where sweeps are
    too short. ``lack_of_fit``: Factor on variances by the lack of fit. ``refused``: Vertical laws that fit only with
    factors of no material.
    """

    model: OuterModel
    fit: Fit
    noise: Noise
    covariance: Floats
    starts: tuple[tuple[str, float, float], ...] = ()
    violation: float = 1.0
    lack_of_fit: float = 1.0
    refused: tuple[Vertical, ...] = ()


def superpose(points: Points, model: OuterModel, options: Options) -> Superposition:
    """Fit shifts, spectrum and the laws that the data need; ``model`` holds the horizontal law and a glass's slope."""
    scatter = scatter_of_sweeps(points)
    noise = scatter or Noise(ASSUMED_NOISE, ASSUMED_NOISE)
    options = replace(options, scatter=scatter)
    base = replace(model, vertical=options.verticals[0], has_delay=options.delay is True)
    first, ends = _best_start(points, base, noise)
    current = _settled(points, *first, noise, options)
    refused: tuple[Vertical, ...] = ()
    for _ in range(_MAX_EXTENSIONS):
        extended = _extended(points, current, options)
        if extended is None:
            break
        law = extended[0].vertical
        further = _settled(points, *extended, current.noise, options)
        if is_physical(further.fit.state.ln_bT, base.temperature, base.T0, float(points.storage.min())):
            current = further
        elif law == current.model.vertical:
            break
        else:
            # It made up for sweeps that do not superpose: better a misfit that shows.
            options = replace(options, verticals=tuple(v for v in options.verticals if v != law))
            refused = (*refused, law)
    noise = current.noise
    widened = design_effect(noise, scatter, points) * options.moduli_per_parameter
    violation = 1.0 if scatter is None else max(noise.storage / scatter.storage, noise.loss / scatter.loss)
    found = replace(
        current,
        covariance=widened * current.covariance,
        starts=ends,
        violation=violation,
        lack_of_fit=widened,
        refused=refused,
    )
    # A law that the user has chosen holds as it is; one without numbers was chosen for want of evidence.
    return _with_possible_laws(points, _with_model_uncertainty(points, found, options), options)


def _best_start(
    points: Points, model: OuterModel, noise: Noise
) -> tuple[tuple[OuterModel, Fit], tuple[tuple[str, float, float], ...]]:
    """Run the joint fit from every start; return the best one, and the ends of all."""
    weight, arguments = _weights(points, noise), (points, model.temperature, model.start().ln_bT)
    starts = [("given", model.given)]
    if points.count > 1:
        starts = [("overlap", overlapped_shifts(*arguments)), ("scan", scanned_shifts(*arguments))]
        apart = starts[0][1] - starts[1][1]
        starts = starts[: 1 if float(np.max(np.abs(apart - apart[model.reference]))) < SAME_SOLUTION else 2]
    runs = [_run(points, weight, model, name, shifts) for name, shifts in starts]
    if model.horizontal == "free" and np.unique(model.temperature).size > _LAW_NEEDS:
        # A sweep without loss in common with its neighbours fits anywhere: start from the WLF law of all others too. A
        # law is never exact: its own roughness keeps the best shifts from ruling alone.
        *_, fit, best = min(runs, key=lambda run: run[1])
        covariance = np.linalg.pinv(outer_problem(points, fit, best)[0], hermitian=True)
        keep = np.arange(best.temperature.size) != best.reference
        full = _LAW_ROUGHNESS**2 * np.eye(keep.size)
        full[np.ix_(keep, keep)] += covariance[: best.horizontal_size, : best.horizontal_size]
        law = fit_law("wlf", best.temperature, fit.state.log10_aT, full, best.T0)
        runs.append(_run(points, weight, model, "law", law.log10_aT(best.temperature)))
    runs.sort(key=lambda run: run[1])
    shifts = runs[0][2].state.log10_aT
    report = tuple((name, cost, float(np.max(np.abs(fit.state.log10_aT - shifts)))) for name, cost, fit, _ in runs)
    return (runs[0][3], runs[0][2]), report


def _run(
    points: Points, weight: Floats, model: OuterModel, name: str, shifts: Floats
) -> tuple[str, float, Fit, OuterModel]:
    """Run the joint fit from one start, the spectrum stiff."""
    expectation = expected_shifts(model.temperature, shifts)
    started = replace(model, given=shifts - shifts[model.reference], expectation=expectation)
    state = started.start()
    grid = grid_for(points, state)
    fit = minimise(points, weight, evaluate(points, weight, grid, state, _STIFF), started, *_SCREENING)
    return name, predictive_cost(fit, started), fit, started


def _settled(points: Points, model: OuterModel, fit: Fit, noise: Noise, options: Options) -> Superposition:
    """Repeat fit, noise and smoothing until the noise levels do not change any more."""
    near: float | None = None
    half = points.omega.size
    for _ in range(_MAX_PASSES):
        weight = _weights(points, noise, fit.predicted)
        model = replace(model, expectation=expected_shifts(model.temperature, fit.state.log10_aT))
        grid = grid_for(points, fit.state)
        fit = minimise(points, weight, evaluate(points, weight, grid, fit.state, None, near), model)
        near = fit.solution.strength
        inverse, covariance = np.asarray(np.linalg.pinv(fit.normal, hermitian=True)), np.empty((0, 0))
        leverage = propagated_variance(fit.rows, inverse)
        if model.size:
            change = sensitivity(points, fit, model)
            rest = change - fit.rows @ (inverse @ (fit.rows.T @ change))
            covariance = np.asarray(np.linalg.pinv(outer_problem(points, fit, model)[0], hermitian=True))
            leverage = leverage + propagated_variance(rest, covariance)
        # Each modulus has as many free residuals as points, less its share of the fitted freedom (leverage),
        # so that a noise ratio comes out right even when one modulus dominates.
        storage, loss = (
            float(np.sqrt(np.sum(fit.residual[part] ** 2) / max(half - float(np.sum(leverage[part])), 1.0)))
            for part in (slice(half), slice(half, None))
        )
        last, noise = noise, next_noise(noise, (storage, loss), options.scatter)
        noise = Noise(max(noise.storage, options.least_noise), max(noise.loss, options.least_noise))
        if max(abs(np.log(noise.storage / last.storage)), abs(np.log(noise.loss / last.loss))) < _NOISE_SETTLED:
            break
    return Superposition(model, fit, noise, covariance)


def _weights(points: Points, noise: Noise, expected: Floats | None = None) -> Floats:
    """One over the standard deviation of every modulus; relative to the model once there is one.

    Weights from the measured values themselves would favour low readings.
    """
    size = np.concatenate([points.storage, points.loss]) if expected is None else expected
    sigma = np.repeat([noise.storage, noise.loss], points.omega.size)
    return np.asarray(1.0 / (sigma * np.maximum(np.abs(size), np.finfo(float).tiny)))


def _extended(points: Points, current: Superposition, options: Options) -> tuple[OuterModel, Fit] | None:
    """Return the single change of laws that the criterion favours most, None if there is none."""
    moves = _moves(current.model, options)
    weight = _weights(points, current.noise, current.fit.predicted) / np.sqrt(options.moduli_per_parameter)
    # The present model is fitted anew as well: only costs of equal weights can be compared.
    present = _screened(points, weight, current, current.model, current.fit.state)
    best, least = None, _criterion(points, present, current.model)
    # A delay bends the loss of every sweep; the other laws are judged without it.
    for model in sorted(moves, key=lambda move: move.has_delay <= current.model.has_delay):
        if best is not None and best[0].has_delay > max(current.model.has_delay, model.has_delay):
            break
        fit = _screened(points, weight, current, model, current.fit.state)
        score = _criterion(points, fit, model)
        if score < least and is_physical(fit.state.ln_bT, model.temperature, model.T0, float(points.storage.min())):
            best, least = (model, fit), score
    return best


def _moves(model: OuterModel, options: Options) -> list[OuterModel]:
    """List the models one change away from the present one.

    Of a liquid that flows, a delay changes the storage modulus as a vertical factor would, and may have come in its
    place. So a law may come and the delay go at once.
    """
    moves = []
    for vertical in [v for v in options.verticals if v != model.vertical]:
        # Where a modulus grows as T does, the density falls as well, and a glass softens: by slopes of known size.
        is_sloped = vertical == "rho_T" or "rho_T" not in options.verticals
        moves.append(replace(model, vertical=vertical, slope_spread=SLOPE_SPREAD if is_sloped else 0.0))
    if options.delay is None:
        others = [*moves, model] if model.has_delay else [model]
        moves += [replace(move, has_delay=not model.has_delay) for move in others]
    return moves


def _screened(points: Points, weight: Floats, current: Superposition, model: OuterModel, first: State) -> Fit:
    """Fit another model from a state, well enough to compare it: first with a stiff spectrum, then as at present."""
    state, strength = model.start(first), current.fit.solution.strength
    for smoothing in (max(strength, _STIFF), strength):
        grid = grid_for(points, state)
        fit = minimise(points, weight, evaluate(points, weight, grid, state, smoothing), model, *_SCREENING)
        state = fit.state
    return fit


def _criterion(points: Points, fit: Fit, model: OuterModel) -> float:
    """Schwarz's criterion; every law beyond horizontal shifts has to have strong evidence.

    The law b ∝ T has no number, but choosing it is half a parameter. A slope is random, not chosen: its price is the
    evidence lost by having to determine it (how much narrower the data make it than its spread).
    """
    price = float(np.log(2 * points.omega.size))
    count = model.law_size + (0.5 if model.vertical == "rho_T" else 0.0)
    laws = (model.vertical != "none") + model.has_delay
    score = total_cost(fit, model) + count * price + laws * STRONG_EVIDENCE
    if model.has_slope:
        covariance = np.linalg.pinv(outer_problem(points, fit, model)[0], hermitian=True)
        score -= float(np.log(covariance[model.horizontal_size, model.horizontal_size]))
    return score


def _with_possible_laws(points: Points, found: Superposition, options: Options) -> Superposition:
    """Widen a fit by the slope of its vertical factor and the delay that it may have although evidence is weak.

    Sweeps of a broad spectrum hardly distinguish a vertical slope from shifts that all differ by a share, and
    a delay of some ten microseconds bends the loss of a rubber by less than its noise; the criterion then leaves
    both out. But no modulus is the same at all temperatures, and every instrument has some delay. Before the data
    there is a slope of :data:`SLOPE_SPREAD` with odds of one to three, that of entropy and density with even odds,
    and a delay with even odds; with the odds after them the variance of each, and its best value squared, are
    part of the covariance. The fit stays. (A glass always has a slope.)
    """
    model = found.model
    if not model.horizontal_size:
        return found
    if len(options.verticals) + len(found.refused) > 1 and not (model.has_slope or VERTICAL_SIZE[model.vertical]):
        sloped = replace(model, slope_spread=SLOPE_SPREAD)
        entropic = 1.0 / (model.T0 + ZERO_CELSIUS) / SLOPE_SPREAD
        found = _widened(points, found, options, sloped, model.horizontal_size, 1.0, ((_ODDS, 0.0), (1.0, entropic)))
    if options.delay is None and not model.has_delay:
        late = replace(found.model, has_delay=True)
        found = _widened(points, found, options, late, late.size - 1, _DELAY / late.delay_unit, ((1.0, 0.0),))
    return found


def _widened(
    points: Points,
    found: Superposition,
    options: Options,
    model: OuterModel,
    at: int,
    spread: float,
    priors: Sequence[tuple[float, float]],
) -> Superposition:
    """Widen a fit by one more parameter, at a place, of a prior standard deviation.

    ``priors`` are odds and mean, in standard deviations. Cross-validation smooths until the moduli are predicted
    best, and trades bias for variance; the parameter is judged with a spectrum that is free to bend (Hall, Ann.
    Stat. 20 (1992) 675, doi:10.1214/aos/1176348651).
    """
    state, loose = found.fit.state, found.fit
    if loose.solution.strength > _UNBIASED:
        loose = evaluate(points, _weights(points, found.noise, found.fit.predicted), loose.grid, state, _UNBIASED)
    extended = replace(state, parameters=np.insert(state.parameters, at, 0.0))
    normal, gradient = outer_problem(points, replace(loose, state=extended), model)
    if model.has_delay and not found.model.has_delay:
        normal[at, at] += 1.0 / spread**2
    joint = np.linalg.pinv(normal, hermitian=True)
    variance, value = float(joint[at, at]) / spread**2, float(joint[at] @ gradient) / spread
    if variance <= 0.0:
        return found
    total = second = 0.0
    for before, prior in priors:
        mean = value + prior * variance
        odds = before * np.sqrt(variance) * np.exp(min(0.5 * (mean**2 / variance - prior**2), 50.0))
        total, second = total + odds, second + odds * (variance + mean**2)
    along = joint[at] / joint[at, at] * spread
    covariance = np.insert(np.insert(found.covariance, at, 0.0, axis=0), at, 0.0, axis=1)
    covariance = covariance + second / (1.0 + total) * np.outer(along, along)
    # The parameters have one more, of value zero; the spectrum stays the one that predicts best.
    return replace(found, model=model, fit=replace(found.fit, state=extended), covariance=covariance)


def _with_model_uncertainty(points: Points, found: Superposition, options: Options) -> Superposition:
    """Widen a covariance by the changes of the shifts with the smoothness of the spectrum and the vertical law.

    Shifts depend on choices that are known from the data only. The change by a grid of half the spacing and a hundredth
    of the smoothing is the error of both, as of any quadrature. Other vertical laws, where several were possible, add
    the squares of the changes of free shifts, weighed with Schwarz's criterion.

    References
    ----------
    Burnham & Anderson, Model Selection and Multimodel Inference, Springer, 2002, ch. 4.
    """
    model, state, covariance = found.model, found.fit.state, found.covariance.copy()
    if not model.size:
        return found
    weight = _weights(points, found.noise, found.fit.predicted) / np.sqrt(found.lack_of_fit)
    strength = found.fit.solution.strength / found.lack_of_fit
    finer = grid_for(points, state, 2 * TERMS_PER_DECADE)
    smooth, rough = (
        minimise(points, weight, evaluate(points, weight, grid, state, smoothing), model, *_SCREENING)
        for grid, smoothing in ((found.fit.grid, strength), (finer, _ROUGHER * strength))
    )
    change = rough.state.parameters - smooth.state.parameters
    covariance += np.outer(change, change)
    if model.horizontal == "free":
        head, total, changes = slice(model.horizontal_size), 1.0, np.zeros((model.horizontal_size,) * 2)
        present = evaluate(points, weight, found.fit.grid, state, strength)
        for law in [one for one in _moves(model, options) if one.vertical != model.vertical]:
            other = _screened(points, weight, replace(found, fit=present), law, state)
            change = other.state.parameters[head] - state.parameters[head]
            gain = _criterion(points, present, model) - _criterion(points, other, law)
            odds = float(np.exp(np.clip(0.5 * gain, -50.0, 50.0)))
            total, changes = total + odds, changes + odds * np.outer(change, change)
        covariance[head, head] += changes / total
    return replace(found, covariance=covariance)


def free_shifts_gain(points: Points, found: Superposition) -> float:
    """Return the F statistic of replacing the shift law by free shifts, about one when the law holds."""
    law, shifts = found.model, found.fit.state.log10_aT
    expected = expected_shifts(law.temperature, shifts)
    free = replace(law, horizontal="free", given=shifts - shifts[law.reference], expectation=expected)
    fit = replace(found.fit, state=free.start(found.fit.state))
    normal, gradient = outer_problem(points, fit, free)
    # The score test: what the first step to free shifts gains, residuals being in units of the noise.
    return float(gradient @ np.linalg.pinv(normal, hermitian=True) @ gradient) / (free.size - law.size)

"""The whole fit of a master curve: starts, noise levels, smoothing, and the laws that the data need.

The joint fit of :mod:`._joint_fit` is run from a few starts, then repeated with the noise levels and the
smoothing that its residuals ask for. A law of the vertical factor and a delay of the instrument's phase are added
where Schwarz's criterion is strongly in favour of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials._shift_law import fit_law
from labpipe.materials.spectrum import MOST_TERMS_PER_DECADE, TERMS_PER_DECADE
from labpipe.materials.superposition._joint_fit import (
    Fit,
    Points,
    evaluate,
    grid_for,
    minimise,
    outer_jacobian,
    outer_problem,
    predictive_cost,
    total_cost,
)
from labpipe.materials.superposition._noise import (
    VIOLATED,
    Noise,
    design_effect,
    noise_of,
    scatter_of_sweeps,
    with_misfit,
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

# Laws may be revised once, after the noise levels have followed the first choice.
_MAX_CHOICES = 4
# Evidence (difference of Schwarz's criterion) that counts as strong, Kass & Raftery, J. Am. Stat.
# Assoc. 90 (1995) 773: a smoothed spectrum leaves small systematic residuals of its own.
_STRONG_EVIDENCE = 6.0
# Smoothing for comparing starts, in units of the noise, and one that biases no shift.
_STIFF, _UNBIASED = 100.0, 1.0
# Starts and candidates are compared before they have settled to the last digit: tolerance and evaluations.
_STARTING, _SCREENING = (1e-4, 20), (1e-3, 12)
# A law through the best start is another; it needs more isotherms than it has constants.
_LAW_NEEDS, _LAW_ROUGHNESS = 3, 0.1
# Starts that differ by less (decades) end in the same minimum.
_SAME_BASIN = 0.3
# Mean squared residual, in units of the noise, of a start that cannot be called a fit.
_FAR_FROM_NOISE = 4.0
# Passes of noise, outliers and smoothing around the joint fit, and the change of noise at which they have settled.
_MAX_PASSES, _NOISE_SETTLED = 6, 0.02
# Residuals beyond this many standard deviations count with their root only (Huber); normal
# noise exceeds it once in 370 points, so clean data lose nothing.
_HUBER = 3.0
# Relative noise where sweeps are too short to show theirs.
_ASSUMED_NOISE = 0.02
# Odds of a slope before the data; even odds would make the limits of materials without one too wide.
_ODDS = 1.0 / 3.0
# Delay (s) of the phase of an instrument, in order of size: public exports show 20 to 120 microseconds.
_DELAY = 5e-5


@dataclass(frozen=True, slots=True)
class Options:
    """Choices of the user; of several ``verticals``, and of ``delay`` None, the criterion chooses.

    ``levels`` None: for sweeps that do not superpose otherwise.
    """

    verticals: tuple[Vertical, ...] = ("none",)
    delay: bool | None = False
    levels: bool | None = False
    scatter: Noise | None = None


@dataclass(frozen=True, slots=True)
class Superposition:
    """A settled joint fit with the covariance of its outer parameters.

    ``covariance`` (parameter, parameter): Of the outer parameters, the spectrum having followed. ``weight`` (2
    point,): One over the noise, that of outliers reduced. ``starts``: Name of every start, its final cost in units of
    the noise, and the largest difference of its shifts from the best ones (decades). ``violation``: Noise of the fit
    over scatter of the sweeps, of the worse modulus; one where sweeps are too short. ``lack_of_fit``: Factor on
    variances by the lack of fit. ``refused``: Vertical laws that fit only with factors of no material.
    """

    model: OuterModel
    fit: Fit
    noise: Noise
    covariance: Floats
    weight: Floats
    starts: tuple[tuple[str, float, float], ...] = ()
    violation: float = 1.0
    lack_of_fit: float = 1.0
    refused: tuple[Vertical, ...] = ()


def superpose(points: Points, model: OuterModel, options: Options) -> Superposition:
    """Fit shifts, spectrum and the laws that the data need.

    ``model`` holds the horizontal law and the slope of a glass.
    """
    scatter = scatter_of_sweeps(points)
    noise = scatter or Noise(_ASSUMED_NOISE, _ASSUMED_NOISE)
    options = replace(options, scatter=scatter)
    base = replace(
        model, vertical=options.verticals[0], has_delay=options.delay is True, has_levels=options.levels is True
    )
    # A delay bends the loss of every sweep: the starts allow for one.
    (model, fit), ends = _best_start(points, replace(base, has_delay=options.delay is not False), noise)
    if options.delay is None:
        model = replace(model, has_delay=False)
        start = evaluate(points, _weights(points, noise), fit.grid, model.start(fit.state), fit.solution.strength)
        fit = minimise(points, _weights(points, noise), start, model, *_SCREENING)
    current = _settled_finely(points, model, fit, noise, options)
    refused: tuple[Vertical, ...] = ()
    for _ in range(_MAX_CHOICES):
        better = _better(points, current, options)
        if better is None:
            break
        further = _settled_finely(points, *better, current.noise, options)
        if is_physical(further.fit.state.ln_bT, base.temperature, base.T0, float(points.storage.min())):
            current = further
        else:
            # It made up for sweeps that do not superpose: better a misfit that shows.
            law = better[0].vertical
            options = replace(options, verticals=tuple(v for v in options.verticals if v != law))
            refused = (*refused, law)
    noise, widened = current.noise, design_effect(current.noise, scatter, points)
    violation = 1.0 if scatter is None else max(noise.over(scatter))
    covariance = widened * current.covariance
    found = replace(
        current, covariance=covariance, starts=ends, violation=violation, lack_of_fit=widened, refused=refused
    )
    # A law that the user has chosen holds as it is; one without numbers was chosen for want of evidence.
    return _with_possible_laws(points, _with_model_uncertainty(points, found, options), options)


def _best_start(
    points: Points, model: OuterModel, noise: Noise
) -> tuple[tuple[OuterModel, Fit], tuple[tuple[str, float, float], ...]]:
    """Run the joint fit from every start; return the best one, and the ends of all."""
    weight, starts = _weights(points, noise), [("given", model.given)]
    if model.horizontal != "fixed":
        ways = (("overlap", overlapped_shifts), ("scan", scanned_shifts))
        starts = [(name, way(points, model.temperature, model.start().ln_bT)) for name, way in ways]
        apart = starts[0][1] - starts[1][1]
        if np.max(np.abs(apart - apart[model.reference])) < _SAME_BASIN:
            starts = starts[:1]
    runs = [_run(points, weight, model, name, shifts) for name, shifts in starts]
    if model.horizontal == "free" and np.unique(model.temperature).size > _LAW_NEEDS:
        # A sweep without loss in common with its neighbours fits anywhere: start from the law of all others too.
        runs.append(_run(points, weight, model, "law", _on_a_law(points, *min(runs, key=lambda run: run[1])[2:])))
    runs.sort(key=lambda run: run[1])
    best = runs[0][2].state.log10_aT
    report = tuple((name, cost, float(np.max(np.abs(fit.state.log10_aT - best)))) for name, cost, fit, _ in runs)
    return (runs[0][3], runs[0][2]), report


def _run(
    points: Points, weight: Floats, model: OuterModel, name: str, shifts: Floats
) -> tuple[str, float, Fit, OuterModel]:
    """Run the joint fit from one start, the spectrum stiff unless the data forbid it."""
    expectation = expected_shifts(model.temperature, shifts)
    started = replace(model, given=shifts - shifts[model.reference], expectation=expectation)
    state = started.start()
    grid = grid_for(points, state, TERMS_PER_DECADE)
    fit = minimise(points, weight, evaluate(points, weight, grid, state, _STIFF), started, *_STARTING)
    if fit.solution.misfit > _FAR_FROM_NOISE * weight.size:
        # Few single times are no smooth spectrum: smoothing would have moved the shifts instead.
        # A fit that stays far from the noise even so has another cause, which laws may explain later.
        loose = minimise(points, weight, evaluate(points, weight, grid, state, None), started, *_STARTING)
        fit = loose if loose.solution.misfit <= _FAR_FROM_NOISE * weight.size else fit
    return name, predictive_cost(fit, started), fit, started


def _on_a_law(points: Points, fit: Fit, model: OuterModel) -> Floats:
    """Put shifts on the WLF law through those that the data determine."""
    covariance = np.linalg.pinv(outer_problem(points, fit, model)[0], hermitian=True)
    keep = np.arange(model.temperature.size) != model.reference
    # A law is never exact: its own roughness keeps the best shifts from ruling alone.
    full = _LAW_ROUGHNESS**2 * np.eye(keep.size)
    full[np.ix_(keep, keep)] += covariance[: model.horizontal_size, : model.horizontal_size]
    law = fit_law("wlf", model.temperature, fit.state.log10_aT, full, model.T0)
    return law.log10_aT(model.temperature)


def _settled_finely(points: Points, model: OuterModel, fit: Fit, noise: Noise, options: Options) -> Superposition:
    """Settle a fit, on a finer grid of times as long as that predicts much better.

    A single relaxation time between two of the grid leaves a misfit that a delay would
    be called for; so this comes before them. After a law has come, the grid starts coarse again.
    """
    current = _settled(points, model, fit, noise, options.scatter, TERMS_PER_DECADE)
    while 2 * current.fit.grid.terms_per_decade <= MOST_TERMS_PER_DECADE:
        fit, model = current.fit, current.model
        density, strength = fit.grid.terms_per_decade, fit.solution.strength
        present, finer = (
            evaluate(points, current.weight, grid_for(points, fit.state, count), fit.state, None, strength)
            for count in (density, 2 * density)
        )
        gain = predictive_cost(present, model) - predictive_cost(finer, model)
        if gain < _STRONG_EVIDENCE * design_effect(current.noise, options.scatter, points):
            break
        current = _settled(points, model, finer, current.noise, options.scatter, 2 * density)
    return current


def _settled(
    points: Points, model: OuterModel, fit: Fit, noise: Noise, scatter: Noise | None, density: float
) -> Superposition:
    """Repeat fit, noise and smoothing until the noise levels do not change any more."""
    near: float | None = None
    measured, half = points.moduli, points.omega.size
    for _ in range(_MAX_PASSES):
        plain = _weights(points, noise, fit.predicted)
        weight = plain * _root_of_influence((measured - fit.predicted) * plain)
        model = replace(model, expectation=expected_shifts(model.temperature, fit.state.log10_aT))
        grid = grid_for(points, fit.state, density)
        fit = minimise(points, weight, evaluate(points, weight, grid, fit.state, None, near), model)
        near = fit.solution.strength
        residual = np.clip((measured - fit.predicted) * plain, -_HUBER, _HUBER)
        jacobian = outer_jacobian(points, fit, model)
        covariance = np.asarray(np.linalg.pinv(jacobian.T @ jacobian, hermitian=True))
        # Each modulus has as many free residuals as points, less its share of the fitted freedom (leverage),
        # so that a noise ratio comes out right even when one modulus dominates.
        leverage = propagated_variance(fit.rows, np.asarray(np.linalg.pinv(fit.normal, hermitian=True)))
        leverage = leverage + propagated_variance(jacobian[: 2 * half], covariance)
        square, used = (np.sum(values.reshape(2, -1), axis=1) for values in (residual**2, leverage))
        factors = np.sqrt(square / np.maximum(half - used, 1.0)).tolist()
        last, noise = noise, with_misfit(noise_of(noise.storage * factors[0], noise.loss * factors[1]), scatter)
        if max(abs(np.log(noise.over(last)))) < _NOISE_SETTLED:
            break
    plain = _weights(points, noise, fit.predicted)
    weight = plain * _root_of_influence((measured - fit.predicted) * plain)
    return Superposition(model, fit, noise, covariance, weight)


def _weights(points: Points, noise: Noise, expected: Floats | None = None) -> Floats:
    """One over the standard deviation of every modulus; relative to the model once there is one.

    Weights from the measured values themselves would favour low readings.
    """
    size = points.moduli if expected is None else expected
    sigma = np.repeat([noise.storage, noise.loss], points.omega.size)
    return np.asarray(1.0 / (sigma * np.maximum(np.abs(size), np.finfo(float).tiny)))


def _root_of_influence(standardised: Floats) -> Floats:
    """One within the limit, beyond it such that the squared residual counts linearly."""
    return np.asarray(np.sqrt(_HUBER / np.maximum(np.abs(standardised), _HUBER)))


def _better(points: Points, current: Superposition, options: Options) -> tuple[OuterModel, Fit] | None:
    """Return the laws that the criterion favours most, None if they are the present ones."""
    others = _alternatives(current.model, options)
    is_violated = options.scatter is not None and max(current.noise.over(options.scatter)) > VIOLATED
    if options.levels is None and (is_violated or current.model.has_levels):
        others.append(replace(current.model, has_levels=not current.model.has_levels))
    elif not _may_gain(points, current, others):
        return None
    # The present model is fitted anew as well: only costs of equal weights can be compared.
    present = _screened(points, current, current.model, current.fit.state)
    best, least = None, _criterion(points, present, current.model)
    for model in others:
        fit = _screened(points, current, model, current.fit.state)
        score = _criterion(points, fit, model)
        if score < least and is_physical(fit.state.ln_bT, model.temperature, model.T0, float(points.storage.min())):
            best, least = (model, fit), score
    return best


def _alternatives(model: OuterModel, options: Options) -> list[OuterModel]:
    """List all other combinations of a vertical law and a delay.

    Where a modulus grows as T does, the density falls as well, and a glass softens: by slopes of known size.
    """
    delays = (False, True) if options.delay is None else (options.delay,)
    return [
        replace(
            model,
            vertical=law,
            has_delay=has_delay,
            is_sloped=model.is_sloped if law == model.vertical else law == "rho_T" or "rho_T" not in options.verticals,
        )
        for law in options.verticals
        for has_delay in delays
        if (law, has_delay) != (model.vertical, model.has_delay)
    ]


def _may_gain(points: Points, current: Superposition, others: list[OuterModel]) -> bool:
    """Ask the gradient first if any law could add strong evidence; a delay may be idle after a law has come.

    One look at the residuals instead of a fit per candidate; data that need nothing pay nothing.
    """
    if current.model.has_delay and len(others) > 1:
        return True
    order = list(VERTICAL_SIZE)
    for model in [m for m in others if order.index(m.vertical) >= order.index(current.model.vertical)]:
        if score(points, current, model) > _STRONG_EVIDENCE:
            return True
    return False


def score(points: Points, current: Superposition, model: OuterModel) -> float:
    """Return the cost that a model of more parameters would save, by the gradient at the present one (Rao's test)."""
    normal, gradient = outer_problem(points, replace(current.fit, state=model.start(current.fit.state)), model)
    return float(gradient @ np.linalg.pinv(normal, hermitian=True) @ gradient)


def _screened(points: Points, current: Superposition, model: OuterModel, first: State) -> Fit:
    """Fit another model from a state, well enough to compare it: first with a stiff spectrum, then as at present."""
    state, strength, weight = model.start(first), current.fit.solution.strength, current.weight
    for smoothing in (max(strength, _STIFF), strength):
        grid = grid_for(points, state, current.fit.grid.terms_per_decade)
        fit = minimise(points, weight, evaluate(points, weight, grid, state, smoothing), model, *_SCREENING)
        state = fit.state
    return fit


def _criterion(points: Points, fit: Fit, model: OuterModel) -> float:
    """Schwarz's criterion; every law beyond horizontal shifts has to have strong evidence.

    The law b ∝ T has no number, but choosing it is half a parameter. The price of slope and levels, which are random,
    is the evidence lost by having to determine them.
    """
    count = model.law_size + (0.5 if model.vertical == "rho_T" else 0.0)
    laws = (model.vertical != "none") + model.has_delay + model.has_levels
    score = total_cost(fit, model) + count * float(np.log(2 * points.omega.size)) + laws * _STRONG_EVIDENCE
    if model.has_slope or model.has_levels:
        covariance = np.linalg.pinv(outer_problem(points, fit, model)[0], hermitian=True)
        random = slice(model.level_slice.start - int(model.has_slope), model.level_slice.stop)
        score -= float(np.linalg.slogdet(covariance[random, random])[1])
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
        sloped = replace(model, is_sloped=True)
        entropic = 1.0 / (model.T0 + ZERO_CELSIUS) / SLOPE_SPREAD
        found = _widened(points, found, sloped, model.horizontal_size, 1.0, ((_ODDS, 0.0), (1.0, entropic)))
    if options.delay is None and not model.has_delay:
        late = replace(found.model, has_delay=True)
        found = _widened(points, found, late, late.size - 1, _DELAY / late.delay_unit, ((1.0, 0.0),))
    return found


def _widened(
    points: Points,
    found: Superposition,
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
        loose = evaluate(points, found.weight, loose.grid, state, _UNBIASED)
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
    """Widen a covariance by the changes of the parameters with the grid of the spectrum and the vertical law.

    Shifts depend on choices that are known from the data only. The change by a grid of half the spacing is the error
    of discretisation, as of any quadrature. Other vertical laws, where several were possible, add the squares of the
    changes of free shifts, weighed with Schwarz's criterion.

    References
    ----------
    Burnham & Anderson, Model Selection and Multimodel Inference, Springer, 2002, ch. 4.
    """
    model, fit = found.model, found.fit
    if not model.size:
        return found
    weight, strength = found.weight / np.sqrt(found.lack_of_fit), fit.solution.strength / found.lack_of_fit
    ends = []
    for density in (fit.grid.terms_per_decade, 2.0 * fit.grid.terms_per_decade):
        start = evaluate(points, weight, grid_for(points, fit.state, density), fit.state, strength)
        ends.append(minimise(points, weight, start, model, *_SCREENING).state.parameters)
    covariance = found.covariance + np.outer(ends[1] - ends[0], ends[1] - ends[0])
    if model.horizontal == "free":
        head, total, changes = slice(model.horizontal_size), 1.0, np.zeros((model.horizontal_size,) * 2)
        at = replace(found, weight=weight, fit=evaluate(points, weight, fit.grid, fit.state, strength))
        for law in _alternatives(model, replace(options, delay=model.has_delay)):
            other = _screened(points, at, law, fit.state)
            change = other.state.parameters[head] - fit.state.parameters[head]
            gain = _criterion(points, at.fit, model) - _criterion(points, other, law)
            odds = float(np.exp(np.clip(0.5 * gain, -50.0, 50.0)))
            total, changes = total + odds, changes + odds * np.outer(change, change)
        covariance[head, head] += changes / total
    return replace(found, covariance=covariance)

"""The whole fit of a master curve: starts, noise levels, smoothing, and which laws the data need.

The joint fit of :mod:`._joint_fit` is run from several starts; around it turn the
things that only the residuals can tell (:mod:`._reweighting`), the choice of laws
(:mod:`._law_choice`), and a walk along the steps that stay loose
(:mod:`._step_search`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials._shift_law import fit_law
from labpipe.materials.spectrum import MOST_TERMS_PER_DECADE, TERMS_PER_DECADE
from labpipe.materials.superposition._first_shifts import overlapped_shifts, scanned_shifts
from labpipe.materials.superposition._joint_fit import (
    Fit,
    Points,
    evaluate,
    grid_for,
    minimise,
    outer_problem,
    predictive_cost,
)
from labpipe.materials.superposition._law_choice import (
    FIRST_STRENGTH,
    STRONG_EVIDENCE,
    entropic_ln_bT,
    extended_by_a_law,
    possible_slope,
    with_possible_slope,
)
from labpipe.materials.superposition._model_doubt import (
    VIOLATED,
    alternatives,
    other_minimum,
    runs_of,
    started_anew,
    violation,
    with_lasting_noise,
    with_less_smoothing,
    with_other_slopes,
)
from labpipe.materials.superposition._noise import Noise, first_noise, scatter_of_sweeps
from labpipe.materials.superposition._reweighting import (
    FIRST_LEVELS,
    Candidate,
    Options,
    Superposition,
    settled,
    weights_in,
    weights_of,
)
from labpipe.materials.superposition._shift_parameters import OuterModel, State, expected_shifts
from labpipe.materials.superposition._step_search import Probe, probe_steps
from labpipe.materials.superposition._two_processes import TwoProcesses, two_processes
from labpipe.materials.superposition._vertical_law import Vertical, is_physical
from labpipe.uncertainty import propagated_covariance

# Vertical law, delay and levels are added one at a time, and may each be revised once.
_MAX_EXTENSIONS = 5
# A walk may find better minima, from which all is settled and walked again.
_MAX_MOVES = 3
# A law through the best start is a third start; it needs more isotherms than it has constants.
_LAW_NEEDS = 3
_LAW_ROUGHNESS = 0.1
# Two processes are asked for from this many isotherms on, where the fit misses by this many times
# the scatter, and count from this gain on: with one process
# it was −3 ± 4 and never above 4.1 (30 sets with every law), with two that shift by 0.85 : 1 about 10.
_RIVAL_NEEDS, _NOTHING_LEFT, _RIVAL_GAIN = 5, 1.15, 8.0
# Odds of two processes before the data, the exponent at which odds are certain, and what is believed at most
# while one process is not excluded.
_RIVAL_ODDS, _SURE, _NEARLY = 1.0 / 3.0, 50.0, 0.999
# Share of its measured value that a loss keeps at least when laws are taken out of it.
_LEAST_LOSS = 1e-3
# Starts are compared before they have settled to the last digit: tolerance and iterations.
_STARTING = (1e-4, 12)
# Mean squared residual, in units of the noise, of a start that cannot be called a fit.
_FAR_FROM_NOISE = 4.0
# Share of the misfit that a delay has to leave at most to be there from the start.
_MUCH_NEARER = 0.5


def superpose(
    points: Points,
    model: OuterModel,
    *,
    starts: Sequence[tuple[str, Floats]] | None = None,
    verticals: Sequence[Vertical] = ("none",),
    delay: bool | None = False,
    levels: bool | None = False,
    robust: bool = True,
    noise_ratio: float | None = None,
) -> Superposition:
    """Fit shifts, spectrum and the laws that the data need.

    ``model`` holds the horizontal law and the slope of a glass; of several ``verticals`` the criterion chooses, and of
    ``delay`` (of the instrument's phase) and ``levels`` (a small one of every isotherm) where they are None. ``starts``
    are named first estimates of log10 a_T, by default the pairwise scan and the overlap; ``robust`` weakens outliers,
    and ``noise_ratio`` is the relative noise of the loss over that of the storage modulus, by default estimated.
    """
    scatter = scatter_of_sweeps(points)
    noise = first_noise(scatter, noise_ratio)
    options = Options(tuple(verticals), delay, levels, robust, noise_ratio, scatter)
    base = replace(
        model, vertical=verticals[0], has_delay=delay is True, level_spread=FIRST_LEVELS if levels is True else 0.0
    )
    best = _best_start(points, base, noise, starts, delay is None)
    current = _probed(points, _settled_finely(points, best, noise, options), options)
    refused: tuple[Vertical, ...] = ()
    for _ in range(_MAX_EXTENSIONS):
        if not points.work.goes_on():
            break
        extended = extended_by_a_law(points, current, options, starts)
        if extended is None:
            break
        law = extended.model.vertical
        further = _settled_finely(points, extended, current.noise, options)
        if not is_physical(further.fit.state.ln_bT, base.temperature, base.T_ref, float(points.storage.min())):
            # It made up for sweeps that do not superpose: better a misfit that shows.
            if law == current.model.vertical:
                options = replace(options, levels=False)
            else:
                options = replace(options, verticals=tuple(v for v in options.verticals if v != law))
                refused = (*refused, law)
            continue
        current = _probed(points, further, options)
    found = replace(_doubted(points, current, options, starts), refused=refused)
    if base.horizontal == "free" and starts is None and len(verticals) > 1:
        found = with_other_slopes(points, found, options)
    if base.horizontal == "free" and points.count >= _RIVAL_NEEDS:
        found = replace(found, rival=_rival(points, found, options))
    found = with_less_smoothing(points, found, options)
    found = with_lasting_noise(points, found)
    # A law that the user has chosen holds as it is; one without numbers was chosen for want of evidence.
    return with_possible_slope(points, found, options) if len(verticals) > 1 else found


def _rival(points: Points, current: Superposition, options: Options) -> TwoProcesses | None:
    """Return two processes, and how far they are to be believed beside superposition and its laws.

    A fit that needs no law and misses by no more than the scatter leaves them nothing to explain.
    """
    model, state = current.model, current.fit.state
    has_law = model.vertical != "none" or model.has_delay or model.level_spread > 0
    if not has_law and violation(current, options) < _NOTHING_LEFT:
        return None
    weight = weights_in(points, current, options)
    strength = current.fit.solution.strength
    present = evaluate(points, weight, current.fit.grid, state, strength)
    plain = replace(model, vertical="none", slope_spread=0.0, has_delay=False, level_spread=0.0)
    rivals = [two_processes(points, weight, plain, state.log10_aT, strength)]
    if has_law:
        # Laws may be real and processes two: the laws are taken out of the sweeps first.
        cleaned, factor = _without_laws(points, state)
        rival = two_processes(cleaned, weight * factor, plain, state.log10_aT, strength)
        levels = replace(model, expectation=None).pull_cost(state)
        rivals.append(replace(rival, cost=rival.cost + levels))
    best = min(rivals, key=lambda rival: rival.cost)
    # A small slope of the modulus is no second process.
    slope = possible_slope(points, replace(current, fit=present))
    cost = predictive_cost(present, model) - (slope.gain if slope else 0.0)
    gain = cost - best.cost
    odds = 1.0 / (1.0 + np.exp(np.clip(0.5 * gain, -_SURE, _SURE)) * _RIVAL_ODDS)
    # Beyond doubt only if readings whose errors last count as one; the uncertainties take the gain as it is.
    if gain <= _RIVAL_GAIN * best.length:
        return replace(best, belief=min(float(1.0 - odds), _NEARLY))
    # What laws took out of the sweeps may be the second process itself: then both answers count.
    moved = np.array([rival.log10_aT - best.log10_aT for rival in rivals])
    return replace(best, covariance=best.covariance + moved.T @ moved)


def _without_laws(points: Points, state: State) -> tuple[Points, Floats]:
    """Return the sweeps without vertical factors and delay, and what their weights change by."""
    vertical = np.exp(state.ln_bT[points.isotherm])
    clean = (points.storage + 1j * points.loss) * np.exp(-1j * points.omega * state.delay) / vertical
    return replace(points, storage=clean.real, loss=np.maximum(clean.imag, _LEAST_LOSS * points.loss)), np.tile(
        vertical, 2
    )


def _doubted(
    points: Points, current: Superposition, options: Options, starts: Sequence[tuple[str, Floats]] | None
) -> Superposition:
    """Where superposition does not hold to the scatter, look for other minima and other models."""
    free = current.model.horizontal == "free"
    anew: list[Fit] = []
    for _ in range(_MAX_MOVES + 1):
        ratio = violation(current, options)
        if not free or ratio <= VIOLATED:
            return replace(current, violation=ratio)
        if starts is not None or not points.work.goes_on():
            break
        anew = started_anew(points, current, options)
        other = other_minimum(points, current, options, anew)
        if other is None:
            break
        current = _probed(points, settled(points, other, current.noise, options), options)
    length = runs_of(points, current).length
    doubted = replace(current, alternatives=alternatives(points, current, options, anew), violation=ratio)
    return replace(doubted, probe=_walked(points, doubted, options, length, may_move=False))


def _settled_finely(points: Points, candidate: Candidate, noise: Noise, options: Options) -> Superposition:
    """Settle a fit, on a finer grid of times as long as that predicts much better.

    A single relaxation time between two of the grid leaves a misfit that delays and levels would
    be called for; so this comes before them. What a grid was called for before a law came, the law
    may explain: it starts coarse again. Neighbouring residuals that say the same count once.
    """
    current = settled(points, candidate, noise, options, TERMS_PER_DECADE)
    while 2 * current.fit.grid.terms_per_decade <= MOST_TERMS_PER_DECADE and points.work.goes_on():
        fit, model = current.fit, current.model
        weight = weights_in(points, current, options)
        density, strength = fit.grid.terms_per_decade, fit.solution.strength
        present, finer = (
            evaluate(points, weight, grid_for(points, fit.state, count), fit.state, None, strength)
            for count in (density, 2 * density)
        )
        gain = predictive_cost(present, model) - predictive_cost(finer, model)
        if gain < STRONG_EVIDENCE * runs_of(points, current).length:
            break
        candidate = Candidate(model, finer, current.starts)
        current = settled(points, candidate, current.noise, options)
    return current


def _best_start(
    points: Points, model: OuterModel, noise: Noise, starts: Sequence[tuple[str, Floats]] | None, may_be_late: bool
) -> Candidate:
    """Run the joint fit from every start and keep the best.

    Where it stays far from the noise, the phase may have a delay, without which shifts run away: a
    glass loses less than a delay of a ten-thousandth of a second makes it seem to lose.
    """
    ln_bT = entropic_ln_bT(model) if model.vertical == "rho_T" else np.zeros(model.temperature.size)
    if starts is None:
        starts = (
            ("overlap", overlapped_shifts(points, model.temperature, ln_bT)),
            ("scan", scanned_shifts(points, model.temperature, ln_bT)),
        )
    weight = weights_of(points, noise)
    runs = [_run(points, weight, model, name, shifts) for name, shifts in starts]
    nearest = min(run.fit.solution.misfit for run in runs)
    if may_be_late and model.horizontal == "free" and nearest > _FAR_FROM_NOISE * weight.size:
        late = replace(model, has_delay=True)
        others = [_run(points, weight, late, name, shifts) for name, shifts in starts]
        if min(run.fit.solution.misfit for run in others) < _MUCH_NEARER * nearest:
            model, runs = late, others
    is_many = np.unique(model.temperature).size > _LAW_NEEDS
    if len(runs) > 1 and model.horizontal == "free" and is_many and points.work.goes_on():
        best = min(runs, key=lambda run: run.cost)
        runs.append(_run(points, weight, model, "law", _smoothed(points, best)))
    runs.sort(key=lambda run: run.cost)
    best_shifts = runs[0].fit.state.log10_aT
    report = tuple((run.name, run.cost, float(np.max(np.abs(run.fit.state.log10_aT - best_shifts)))) for run in runs)
    return Candidate(runs[0].model, runs[0].fit, report)


@dataclass(frozen=True, slots=True)
class _Run:
    name: str
    cost: float
    fit: Fit
    model: OuterModel


def _run(points: Points, weight: Floats, model: OuterModel, name: str, shifts: Floats) -> _Run:
    """Run the joint fit from one start, the spectrum stiff unless the data forbid it."""
    expectation = expected_shifts(model.temperature, shifts)
    started = replace(model, given=shifts - shifts[model.reference], expectation=expectation)
    state = started.start()
    grid = grid_for(points, state, TERMS_PER_DECADE)
    first = evaluate(points, weight, grid, state, FIRST_STRENGTH)
    fit = minimise(points, weight, first, started, *_STARTING)
    if fit.solution.misfit > _FAR_FROM_NOISE * weight.size:
        # Few single times are no smooth spectrum: smoothing would have moved the shifts instead.
        # What stays far from the noise even so has another cause, which laws may tell later.
        loose = minimise(points, weight, evaluate(points, weight, grid, state, None), started, *_STARTING)
        fit = loose if loose.solution.misfit <= _FAR_FROM_NOISE * weight.size else fit
    return _Run(name, predictive_cost(fit, started), fit, started)


def _smoothed(points: Points, run: _Run) -> Floats:
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


def _probed(points: Points, current: Superposition, options: Options) -> Superposition:
    """Walk the loose steps; settle anew from better ones, and keep what the last walk says.

    While the sweeps are missed by far more than they scatter, a law is missing, not a better step.
    """
    if current.model.horizontal != "free" or violation(current, options) > VIOLATED:
        return current
    for may_move in (True,) * _MAX_MOVES + (False,):
        probe = _walked(points, current, options, 1.0, may_move)
        current = replace(current, probe=probe)
        if probe.better is None or not points.work.goes_on():
            break
        candidate = Candidate(current.model, probe.better, current.starts)
        current = settled(points, candidate, current.noise, options)
    return current


def _walked(points: Points, current: Superposition, options: Options, length: float, may_move: bool) -> Probe:
    """Walk the loose steps, every residual counting for one over the length of its run."""
    moves = current.model.directions(current.fit.state)[0]
    known = length * propagated_covariance(moves, current.covariance)
    weight = weights_in(points, current, options)
    weight = weight / np.sqrt(length)
    return probe_steps(points, weight, current.fit, current.model, known, may_move)

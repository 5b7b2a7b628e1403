"""A second colour in the light, found where one wavelength does not explain a film's contacts."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import minimize

from labpipe.arrays import Floats
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT, is_contact, shows_edge
from labpipe.imaging.fringes._edge import Edge
from labpipe.imaging.fringes._fingerprint import round_share
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._ring_fit import RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import AXES, Parameter
from labpipe.imaging.fringes._trial_fits import start_at_edge
from labpipe.imaging.fringes._trials import ALL_PIXELS, PROMISE, VARIANCES, Attempt, Calibration, Trial, is_promising
from labpipe.imaging.fringes._view import View

#: Wavenumbers of the second colour over the first that are tried, and its share of the fringes then.
_RATIOS, _SHARE = (0.75, 0.8, 0.85, 0.9, 0.94, 1.06, 1.1, 1.15, 1.2, 1.25, 1.3, 1.4), 0.2
#: Frames and pixels for that, and evaluations of the search from the best of them.
_FRAMES, _PIXELS, _MOST_EVALUATIONS = 3, 8_000, 40
#: Mean squared misfit from which it is looked for, and which it may leave: light of low coherence is like
#: one colour beside another, but left five times as much as two real ones with much else wrong.
_NOTABLE, _MOST_LEFT = 2e-5, 2e-4
#: Times as much as it may leave, from which some pixels tell that it does not explain the frames.
_BY_CHANCE = 2.0
#: Steps of ratio and share by which what is left tells their uncertainty, and the most that is believed.
_STEPS, _WIDE = (0.004, 0.01), (0.1, 0.1)
#: Spots of a frame and evaluations of a fit there, and what two colours must leave of the squares that one does.
_SPOTS, _ITERATIONS, _MUCH_LESS = 3, 15, 0.7
#: Misfit of one colour from which two explain nothing either: 0.16 and less where there were two. Share of it that
#: goes evenly around the rings from which they may: 0.6 and more there, 0.4 and less where something hides a contact.
_UNEXPLAINED, _ROUND = 0.3, 0.5
#: Shares that are possible: the first colour is the one that is stated.
_LEAST_SHARE, _MOST_SHARE = 0.01, 0.6


def find_second_colour(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Second colour that leaves least in all frames, when it explains them much better than one."""
    if known.colour[1] or not best.is_doubtful or best.excess < _NOTABLE:
        return None

    def left(colour: Sequence[float], frames: int = _FRAMES) -> float:
        ratio, share = map(float, colour)
        if not _LEAST_SHARE < share < _MOST_SHARE:
            return math.inf
        trial = attempt(axes, replace(known, colour=(ratio, share)), frames, _PIXELS)
        return math.inf if trial is None else trial.left

    one = attempt(axes, known, _FRAMES, _PIXELS)
    start = min(_RATIOS, key=lambda ratio: left((ratio, _SHARE), 1))
    if one is None or one.left - left((start, _SHARE)) < VARIANCES:
        return None
    if not is_promising(attempt, (axes, known), (axes, replace(known, colour=(start, _SHARE))), best):
        return None
    corners = [(start, _SHARE), (start + 0.03, _SHARE), (start, _SHARE + 0.1)]
    options = {"initial_simplex": corners, "maxfev": _MOST_EVALUATIONS, "xatol": 2e-3, "fatol": 5.0}
    ratio, share = minimize(left, corners[0], method="Nelder-Mead", options=options).x
    found = replace(known, colour=(float(ratio), float(share)))
    few = attempt(axes, found, _FRAMES, _PIXELS)
    if few is None or few.excess > min(_BY_CHANCE * _MOST_LEFT, PROMISE * one.excess):
        return None
    settled = settle_colour(attempt, axes, found)
    if settled is None or settled[0].excess > _MOST_LEFT or not settled[0].is_better_than(best):
        return None
    # a band of colours about another wavelength is as simple
    band = attempt((*axes, Parameter.SCALE, Parameter.SPREAD), known)
    return None if band is not None and band.gain_over(settled[0]) > 0.0 else settled


def settle_colour(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> tuple[Trial, Calibration] | None:
    """Find a second colour that is nearly known from what all pixels leave; None when a fit fails."""
    settled = _settled(attempt, axes, known, np.array(known.colour))
    return None if settled is None else _settled(attempt, axes, known, np.array(settled[1].colour))


def find_colours(looks: Looks, view: View, *, is_phase_free: bool) -> tuple[RingFit, tuple[float, float]] | None:
    """Fit the contact of a frame whose light is of two colours, so far apart that one explains nothing.

    None when two colours explain the frame hardly better than one, or not well.
    """
    frame = looks.frame
    free = (*view.settings.free, *AXES, *((Parameter.PHASE,) if is_phase_free else ()))
    settings = replace(view.settings, free=tuple(dict.fromkeys(free)), max_pixels=_PIXELS, max_iterations=_ITERATIONS)

    def seen(colour: Sequence[float]) -> View:
        return replace(view, optics=replace(view.optics, colour=(float(colour[0]), float(colour[1]))))

    def fit(edge: Edge, colour: Sequence[float]) -> RingFit | None:
        if colour[1] and not _LEAST_SHARE < colour[1] < _MOST_SHARE:
            return None
        return fit_contact(frame, start_at_edge(edge, view), seen(colour).optics, settings, view.levels)

    def left(edge: Edge, colour: Sequence[float]) -> float:
        made = fit(edge, colour)
        return math.inf if made is None else made.residual**2

    for spot in looks.spots[:_SPOTS]:
        edge = looks.edge(spot, view.black)
        if edge is None:
            continue
        one = fit(edge, (1.0, 0.0))
        # What a second colour changes, it changes all along the rings; beside a plain edge there are none.
        if one is None or one.misfit > _UNEXPLAINED or shows_edge(frame, view, one):
            continue
        if round_share([frame], [one], view) < _ROUND:
            continue
        start = min(_RATIOS, key=lambda ratio: left(edge, (ratio, _SHARE)))
        if left(edge, (start, _SHARE)) > _MUCH_LESS * one.residual**2:
            continue
        corners = [(start, _SHARE), (start + 0.03, _SHARE), (start, _SHARE + 0.1)]
        options = {"initial_simplex": corners, "maxfev": _MOST_EVALUATIONS, "xatol": 2e-3, "fatol": 0.0}
        ratio, share = minimize(partial(left, edge), corners[0], method="Nelder-Mead", options=options).x
        made = fit(edge, (ratio, share))
        if made is None or made.misfit > GOOD_MISFIT:
            continue
        own = seen((ratio, share))
        own = replace(own, optics=replace(own.optics, phase=float(made.parameters[Parameter.PHASE])))
        if is_contact(frame, own, made):
            return made, (float(ratio), float(share))
    return None


def _settled(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, colour: Floats
) -> tuple[Trial, Calibration] | None:
    """Minimum of what all pixels leave, by a paraboloid about a colour, and what its width makes of the radius."""
    steps = np.diag(_STEPS)
    places = [colour, *(colour + s for s in steps), *(colour - s for s in steps), colour + steps.sum(axis=0)]
    trials = [attempt(axes, replace(known, colour=(float(r), float(s))), pixels=ALL_PIXELS) for r, s in places]
    made = [trial for trial in trials if trial is not None]
    if len(made) < len(places):
        return None
    middle, right, up, before, below, both = (trial.left for trial in made)
    cross = both - right - up + middle
    bend = np.array([[right + before - 2.0 * middle, cross], [cross, up + below - 2.0 * middle]])
    # in steps, with what is believed at most as a prior
    half = 0.5 * bend + np.diag((np.array(_STEPS) / _WIDE) ** 2)
    values, vectors = np.linalg.eigh(half)
    covariance = (vectors / np.maximum(values, 1e-6)) @ vectors.T
    slope = 0.25 * np.array([right - before, up - below])
    move = np.clip(-covariance @ slope, -2.0, 2.0) * _STEPS
    ratio, share = colour + move
    found = replace(known, colour=(float(ratio), float(share)))
    trial = attempt(axes, found)
    if trial is None:
        return None
    changes = np.stack([0.5 * made[1].changes(made[3]), 0.5 * made[2].changes(made[4])])
    scale = max(trial.left / trial.pixels, 1.0)
    return trial, found.with_shared(trial, np.sqrt(scale * np.einsum("if,ij,jf->f", changes, covariance, changes)))

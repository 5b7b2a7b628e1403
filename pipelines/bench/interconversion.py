"""From relaxation to creep and back: error of every term against run time."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import cast

import numpy as np
from scipy.optimize import brentq

from labpipe.arrays import Floats
from labpipe.materials import Relaxation, Retardation, creep_from_relaxation, relaxation_from_creep
from pipelines.bench.measure import Bound, Extra, Suite, Timing, race

# Every third term is this much weaker than its neighbours: its zero lies within rounding of its
# pole.
_WEAK = 1e-10
_SIZES = (10, 25, 50, 100)
_COMPARED = 50
_EPSILON = float(np.finfo(float).eps)


def run(quick: bool) -> Suite:
    """Convert there and back; every time and weight has to return."""
    calls: dict[str, tuple[str, Callable[[], object]]] = {}
    exact: dict[str, Relaxation] = {}
    for count in _SIZES:
        label = f"secular equation, {count} terms"
        exact[label] = weak_terms(count)
        calls[label] = ("", _there_and_back(exact[label]))
    solid = weak_terms(_COMPARED)
    calls[f"eigenvalues, {_COMPARED} terms"] = ("eigenvalues", lambda: _both(solid, _eigenvalues))
    calls[f"bracketed roots, {_COMPARED} terms"] = ("bracketed roots", lambda: _both(solid, _bracketed))

    def judge(label: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        found, true = cast(Relaxation, timings[label].value), exact.get(label, solid)
        times, weights = _worst(found.time, true.time), _worst(found.weight, true.weight)
        return max(times, weights), {"times": times, "weights": weights}

    points = race(calls, 3 if quick else 15, judge, f"secular equation, {_COMPARED} terms", traced=calls)
    return Suite(
        "interconversion",
        "Relaxation to creep and back, 20 decades, every third weight 1e-10 of the others",
        "largest relative error of a term",
        points,
        bounds=[Bound("rounding of one number", error=_EPSILON)],
        notes=[
            "both conversions in one call; against 80 digits each in the tests",
            "where a root rounds onto its pole the plain formulas lose the term: error 1",
        ],
    )


def weak_terms(count: int) -> Relaxation:
    """Terms over twenty decades, every third of them weak."""
    time = np.logspace(-12.0, 8.0, count)
    weight = 1e9 / count * (1.0 + 0.5 * np.sin(np.arange(count)))
    weight[::3] *= _WEAK
    return Relaxation(1e7, weight, time)


def _there_and_back(solid: Relaxation) -> Callable[[], Relaxation]:
    return lambda: relaxation_from_creep(creep_from_relaxation(solid))


def _worst(found: Floats, exact: Floats) -> float:
    if found.shape != exact.shape:
        return 1.0
    return float(np.max(np.abs(found / exact - 1.0)))


Roots = Callable[[float, Floats, Floats], Floats]


def _both(solid: Relaxation, roots: Roots) -> Relaxation:
    """Convert there and back by plain formulas, given a way to find the roots.

    The zeros of c + Σ w z/(z − p), p the rates of one family, are those of the other; residues
    follow from the slope there.
    """
    creep = Retardation(
        1.0 / (solid.relaxed + float(np.sum(solid.weight))),
        *_partner(solid.relaxed, solid.weight, solid.time, roots, 1.0),
    )
    total = creep.unrelaxed + float(np.sum(creep.weight))
    weight, time = _partner(total, -creep.weight, creep.time, roots, -1.0)
    return Relaxation(1.0 / total, weight, time)


def _partner(constant: float, weight: Floats, time: Floats, roots: Roots, sign: float) -> tuple[Floats, Floats]:
    """Return weights and times of the other family."""
    rate = 1.0 / time
    zero = np.sort(roots(constant, weight, rate))[::-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = zero[:, None] - rate
        slope = np.sum(weight * zero[:, None] * rate / apart**2, axis=1)
        return np.nan_to_num(sign / slope), 1.0 / zero


def _eigenvalues(constant: float, weight: Floats, rate: Floats) -> Floats:
    """Zeros as eigenvalues of diag(p) less a matrix of rank one."""
    total = constant + float(np.sum(weight))
    if total == 0:
        return rate
    root = np.sqrt(np.abs(weight) * rate)
    matrix = np.diag(rate) - np.sign(weight[0]) * np.outer(root, root) / total
    return np.abs(np.linalg.eigvalsh(matrix))


def _bracketed(constant: float, weight: Floats, rate: Floats) -> Floats:
    """Zeros between neighbouring poles by Brent's method in the rate itself."""
    poles = np.sort(rate)
    edges = np.concatenate([[0.0], poles] if weight[0] > 0 else [poles, [poles[-1] * 1e6]])

    def value(z: float) -> float:
        return constant + float(np.sum(weight * z / (z - rate)))

    found = []
    for low, high in pairwise(edges):
        inside = (low + (high - low) * 1e-15 if low else high * 1e-12, high * (1.0 - 1e-15))
        try:
            found.append(brentq(value, *inside, xtol=1e-300, rtol=4.0 * _EPSILON))
        except ValueError:  # the zero lies within rounding of a pole
            found.append(high if weight[0] > 0 else low)
    return np.array(found)

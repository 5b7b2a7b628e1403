"""What the collocated contact needs of the material and of the method, before any step."""

from functools import cache
from math import pi, sqrt
from typing import cast

import numpy as np
from scipy.special import roots_jacobi

from labpipe.arrays import Floats
from labpipe.contact.impact._contact_records import Law, Nodes, Path, Room, Scheme
from labpipe.contact.impact._motion import blank
from labpipe.contact.memory import Creep
from labpipe.materials.prony import Retardation, relaxation_from_creep

_STAGES = 5
# Nodes of a polynomial over the contact radius, and points of the rule that integrates it.
NODES = 24
_GAUSS_POINTS = 80
# Part of the disagreement between the force and its polynomial that counts as error of a step.
_ERROR_SHARE = 0.02
_MOST_STEPS = 1000
# Retardation times that agree to this are one.
_SAME_TIME = 1e-9


def distinct(creep: Creep) -> Creep:
    """Return the same compliance with its terms in ascending order, equal times added up."""
    order = np.argsort(creep.tau, kind="stable")
    C, tau = creep.C[order], creep.tau[order]
    begins = np.concatenate([[True], np.diff(tau) > _SAME_TIME * tau[1:]])[: tau.size]
    starts = np.flatnonzero(begins)
    if starts.size < tau.size:
        C, tau = np.add.reduceat(C, starts), tau[starts]
    return Creep(creep.instantaneous, C, tau, creep.fluidity)


def law_of(creep: Creep) -> Law:
    """Contact law in both forms, from a compliance with :func:`distinct` terms.

    A free spring whose Kelvin element k relaxes alone holds in its Maxwell element j the part
    ``rho_j / (rho_j - tau_k)`` of it.
    """
    relaxation = relaxation_from_creep(Retardation(creep.instantaneous, creep.C, creep.tau, creep.fluidity))
    rho = relaxation.time[:, None]
    mixed = np.zeros((rho.size, creep.rate.size))
    mixed[:, : creep.n_terms] = rho / (rho - creep.tau)
    return Law(
        relaxation.relaxed,
        relaxation.weight,
        1.0 / relaxation.time,
        creep.instantaneous,
        creep.C,
        creep.rate,
        mixed,
        creep.fluidity > 0.0,
    )


@cache
def scheme() -> Scheme:
    """Constants of the method."""
    inner, _ = roots_jacobi(_STAGES - 1, 1.0, 0.0)
    c = np.append(np.sort(0.5 * (inner + 1.0)), 1.0)
    powers = np.arange(_STAGES)
    values = c[:, None] ** powers
    a = (c[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(values)
    at_start = np.linalg.solve(values.T, np.eye(_STAGES)[0])
    s = 0.5 * (1.0 - np.cos(pi * np.arange(NODES) / (NODES - 1)))
    bary: Floats = np.where(np.arange(NODES) % 2, -1.0, 1.0)
    bary[[0, -1]] *= 0.5
    apart = s[:, None] - s + np.eye(NODES)
    slope = bary / bary[:, None] / apart
    np.fill_diagonal(slope, 0.0)
    np.fill_diagonal(slope, -slope.sum(axis=1))
    arrays = {
        "c": c,
        "a": a,
        "aa": a @ a,
        "to_powers": np.linalg.inv(c[:, None] ** (powers + 1)),
        "gamma": _ERROR_SHARE * np.append(1.0, -at_start),
        "s": s,
        "bary": bary,
        "slope": slope,
        "means": _means(s, bary),
    }
    dtype = np.dtype([(name, np.float64, values.shape) for name, values in arrays.items()])
    return cast("Scheme", blank(dtype, **arrays))


def interpolation(s: Floats, bary: Floats, places: Floats) -> Floats:
    """Matrix (place, node) from values at the nodes to values at other places."""
    away = places[:, None] - s
    is_node = away == 0.0
    weight = np.where(is_node.any(axis=1)[:, None], is_node, bary / np.where(is_node, 1.0, away))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _means(s: Floats, bary: Floats) -> Floats:
    """Matrix (node, node) to twice the mean over the radius from the centre to each node.

    With x = edge cos(angle) and s = sin(angle) what is integrated is smooth.
    """
    points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    mean = np.zeros((s.size, s.size))
    mean[-1, -1] = 2.0
    for n in range(s.size - 1):
        first = np.arcsin(s[n])
        half = 0.5 * (0.5 * pi - first)
        angle = first + half * (points + 1.0)
        rule = weights * half * np.sin(angle)
        mean[n] = 2.0 * (rule @ interpolation(s, bary, np.sin(angle))) / sqrt(1.0 - s[n] ** 2)
    return mean


def work_space(law: Law) -> tuple[Path, Room, Nodes]:
    """Arrays for one contact after the other."""
    S, N, J, K, steps = _STAGES, NODES, law.E.size, law.creep_rate.size, _MOST_STEPS
    shapes = {
        "plate": (S, S + 1),
        "answer": (S, S),
        "gain": (S, S),
        "weight": (J, S, S),
        "field": (S, N),
        "slope": (S, N),
        "area": (S, N),
        "table": (S, K, S),
        "cross": (S, K),
        "moment": (S, K),
        "last": (K,),
        "rim": (K,),
        "primitive": (K, N),
        "held": (J,),
        "matrix": (S, S),
        "right": (S, 1),
    }
    path = Path(
        time=np.zeros(steps + 1),
        state=np.zeros((steps + 1, 8)),
        stages=np.zeros((steps, S, 6)),
        approach=np.zeros(steps + 1),
        powers=np.zeros((steps, S)),
        edge=np.zeros((steps, S)),
        fading=np.zeros((steps + 1, J)),
        stored=np.zeros(steps + 1),
    )
    room = Room(**{name: np.zeros(shapes.get(name, (S,))) for name in Room._fields})
    nodes = Nodes(
        touch=np.zeros(N),
        release=np.zeros(N),
        before=np.zeros((K, N)),
        after=np.zeros((K, N)),
        base=np.zeros((J, N)),
        field=np.zeros((J, N)),
        fading=np.zeros(J),
        element=np.zeros(K),
    )
    return path, room, nodes

"""What the collocated contact needs of the material and of the method, before any step."""

from functools import cache
from math import pi, sqrt
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.special import roots_jacobi

from labpipe.arrays import Floats
from labpipe.contact.impact._motion import blank
from labpipe.contact.impact._records import Law, Nodes, Path, Room, Scheme
from labpipe.contact.memory import Creep
from labpipe.materials import Retardation, relaxation_from_creep

_STAGES = 5
# Nodes of a polynomial over the contact radius, and points of the rule that integrates it.
NODES = 24
_GAUSS_POINTS = 80
# Part of the disagreement between the force and its polynomial that counts as error of a step.
_ERROR_SHARE = 0.02
_MOST_STEPS = 1000
# Terms that there is always room for, as a power of two.
_LEAST_ROOM = 7
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
    values: dict[str, Any] = {
        "maxwells": rho.size,
        "elements": creep.rate.size,
        "kelvins": creep.C.size,
        "is_liquid": int(creep.fluidity > 0.0),
        "E_relaxed": relaxation.relaxed,
        "instantaneous": creep.instantaneous,
        "E": relaxation.weight,
        "rate": 1.0 / relaxation.time,
        "C": creep.C,
        "creep_rate": creep.rate,
        "mixed": mixed,
    }
    # a power of two, of which one suffices for nearly all
    terms = 1 << max(_LEAST_ROOM, (max(rho.size, creep.rate.size) - 1).bit_length())
    fields = [
        (name, np.int64 if isinstance(value, int) else np.float64, (terms,) * np.ndim(value))
        for name, value in values.items()
    ]
    law = _room(np.dtype(fields))
    for name, value in values.items():
        if np.ndim(value):
            law[name][tuple(map(slice, np.shape(value)))] = value
        else:
            law[name] = value
    return cast("Law", law)


def _room(dtype: np.dtype[np.void]) -> np.record:
    """Return one record of zeros, of which the machine takes up what is used."""
    row: np.recarray[tuple[int], np.dtype[np.record]] = np.zeros(1, dtype).view(np.recarray)
    return row[0]


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


class RadialNodes(NamedTuple):
    """The nodes of fields over the radius, as in :class:`Scheme`, as plain arrays: quick to reach from Python."""

    s: Floats
    bary: Floats
    means: Floats


@cache
def radial_nodes() -> RadialNodes:
    """Nodes over the radius, their weights, and the rule of twice the mean."""
    return RadialNodes(scheme().s, scheme().bary, scheme().means)


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
    """Room for one contact after the other."""
    S, N, T, steps = _STAGES, NODES, law.rate.size, _MOST_STEPS
    path = {
        "time": (steps + 1,),
        "state": (steps + 1, 8),
        "stages": (steps, S, 6),
        "approach": (steps + 1,),
        "powers": (steps, S),
        "edge": (steps, S),
        "fading": (steps + 1, T),
        "stored": (steps + 1,),
    }
    room = {
        "plate": (S, S + 1),
        "answer": (S, S),
        "gain": (S, S),
        "weight": (T, S, S),
        "field": (S, N),
        "slope": (S, N),
        "area": (S, N),
        "table": (S, T, S),
        "cross": (S, T),
        "moment": (S, T),
        "last": (T,),
        "rim": (T,),
        "primitive": (T, N),
        "held": (T,),
        "matrix": (S, S),
        "right": (S, 1),
    }
    nodes = {
        "touch": (N,),
        "release": (N,),
        "before": (T, N),
        "after": (T, N),
        "base": (T, N),
        "field": (T, N),
        "fading": (T,),
        "element": (T,),
    }
    made = [
        _room(np.dtype([(name, np.float64, shapes.get(name, (S,))) for name in kind.__annotations__]))
        for kind, shapes in ((Path, path), (Room, room), (Nodes, nodes))
    ]
    return cast("tuple[Path, Room, Nodes]", tuple(made))

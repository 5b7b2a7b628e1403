"""Material, method and room of the collocated contact, before any step."""

from functools import cache
from math import pi, sqrt
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.special import roots_jacobi

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep, condense
from labpipe.contact.impact._records import Law, Nodes, Path, Room, Scheme, blank
from labpipe.materials import Retardation, relaxation_from_creep

_STAGES = 5
# Nodes of a polynomial over the contact radius, and points of the rule that integrates it.
_NODES, _GAUSS_POINTS = 24, 80
# Part of the disagreement between the force and its polynomial that counts as error of a step.
_ERROR_SHARE = 0.02
_MOST_STEPS = 1000
# Terms may be folded away or frozen where that costs this part of rtol.
_CONDENSE_SHARE = 0.01


class Tables(NamedTuple):
    """All drops of one material share these: its condensed compliance, its law, and room to compute in.

    ``left_out``: terms that were folded into one, and that were frozen.
    """

    creep: Creep
    left_out: tuple[int, int]
    law: Law
    path: Path
    room: Room
    nodes: Nodes

    @classmethod
    def of(cls, creep: Creep, shortest: float, longest: float, rtol: float, *, fold: bool) -> "Tables":
        """Leave out terms that no contact of a duration ``shortest`` [s] needs within ``longest`` [s].

        The terms that are left are in ascending order, and equal times are one.
        """
        n_folded = n_frozen = 0
        if fold:
            creep, n_folded, n_frozen = condense(creep, shortest, longest, _CONDENSE_SHARE * rtol)
        order = np.argsort(creep.tau, kind="stable")
        C, tau = creep.C[order], creep.tau[order]
        starts = np.flatnonzero(np.diff(tau, prepend=-1.0) > 1e-9 * tau)
        if starts.size < tau.size:
            C, tau = np.add.reduceat(C, starts), tau[starts]
        creep = Creep(creep.instantaneous, C, tau, creep.fluidity)
        law = law_of(creep)
        return cls(creep, (n_folded, n_frozen), law, *_work_space(law))


def law_of(creep: Creep) -> Law:
    """Contact law in both forms, from a compliance with distinct terms in ascending order.

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
    terms = 1 << max(7, (max(rho.size, creep.rate.size) - 1).bit_length())
    fields = [
        (name, np.int64 if isinstance(value, int) else np.float64, (terms,) * np.ndim(value))
        for name, value in values.items()
    ]
    law = blank(np.dtype(fields))
    for name, value in values.items():
        if np.ndim(value):
            law[name][tuple(map(slice, np.shape(value)))] = value
        else:
            law[name] = value
    return cast("Law", law)


@cache
def scheme() -> Scheme:
    """Constants of the method."""
    inner, _ = roots_jacobi(_STAGES - 1, 1.0, 0.0)
    c = np.append(np.sort(0.5 * (inner + 1.0)), 1.0)
    powers = np.arange(_STAGES)
    values = c[:, None] ** powers
    a = (c[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(values)
    at_start = np.linalg.solve(values.T, np.eye(_STAGES)[0])
    s, bary = radial_nodes()
    apart = s[:, None] - s + np.eye(_NODES)
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
        "means": means(),
    }
    dtype = np.dtype([(name, np.float64, array.shape) for name, array in arrays.items()])
    return cast("Scheme", blank(dtype, **arrays))


@cache
def radial_nodes() -> tuple[Floats, Floats]:
    """Nodes s (node,) of fields over the radius, as in :class:`Scheme`, and their barycentric weights."""
    s = 0.5 * (1.0 - np.cos(pi * np.arange(_NODES) / (_NODES - 1)))
    bary: Floats = np.where(np.arange(_NODES) % 2, -1.0, 1.0)
    bary[[0, -1]] *= 0.5
    return s, bary


@cache
def means() -> Floats:
    """Matrix (node, node) to twice the mean over the radius from the centre to each node.

    With x = edge cos(angle) and s = sin(angle) what is integrated is smooth.
    """
    s, _ = radial_nodes()
    points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    mean = np.zeros((s.size, s.size))
    mean[-1, -1] = 2.0
    for n in range(s.size - 1):
        first = np.arcsin(s[n])
        half = 0.5 * (0.5 * pi - first)
        angle = first + half * (points + 1.0)
        mean[n] = 2.0 * (weights * half * np.sin(angle) @ interpolation(np.sin(angle))) / sqrt(1.0 - s[n] ** 2)
    return mean


def interpolation(places: Floats) -> Floats:
    """Matrix (place, node) from values at the nodes to values at other places s."""
    s, bary = radial_nodes()
    away = places[:, None] - s
    is_node = away == 0.0
    weight = np.where(is_node.any(axis=1)[:, None], is_node, bary / np.where(is_node, 1.0, away))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _work_space(law: Law) -> tuple[Path, Room, Nodes]:
    """Room for one contact after the other."""
    sizes = {"S": _STAGES, "N": _NODES, "T": law.rate.size, "M": _MOST_STEPS, "L": _MOST_STEPS + 1}
    made = []
    for kind in (Path, Room, Nodes):
        shapes = {name: hint.__metadata__[0] for name, hint in kind.__annotations__.items()}
        fields = [(name, np.float64, tuple(sizes.get(c) or int(c) for c in shape)) for name, shape in shapes.items()]
        made.append(blank(np.dtype(fields)))
    return cast("tuple[Path, Room, Nodes]", tuple(made))

"""Material, method and room of the collocated contact, before any step."""

from math import pi, sqrt
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.special import roots_jacobi

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep, condense
from labpipe.contact.impact._records import Law, Room, blank
from labpipe.materials import Retardation, relaxation_from_creep

# Stages of a step; nodes of a polynomial over the contact radius, and points of the rule that integrates it.
STAGES, N_NODES, _GAUSS_POINTS = 5, 24, 80
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
    room: Room

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
        sizes = {"S": STAGES, "N": N_NODES, "T": law.rate.size, "M": _MOST_STEPS, "L": _MOST_STEPS + 1}
        shapes = {name: hint.__metadata__[0] for name, hint in Room.__annotations__.items()}
        room = [(name, np.float64, tuple(sizes.get(c) or int(c) for c in shape)) for name, shape in shapes.items()]
        return cls(creep, (n_folded, n_frozen), law, cast("Room", blank(np.dtype(room))))


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


# Radau's points (stage,), and the weights (stage, stage) of integrals up to them; TO_POWERS (stage, stage) from values
# less the first to the coefficients of u, u^2, ...; GAMMA (stage + 1,) of the error.
POINTS = np.append(np.sort(0.5 * (roots_jacobi(STAGES - 1, 1.0, 0.0)[0] + 1.0)), 1.0)
_POWERS = np.arange(STAGES)
_VALUES = POINTS[:, None] ** _POWERS
WEIGHTS = (POINTS[:, None] ** (_POWERS + 1) / (_POWERS + 1)) @ np.linalg.inv(_VALUES)
TWICE = WEIGHTS @ WEIGHTS
TO_POWERS = np.linalg.inv(POINTS[:, None] ** (_POWERS + 1))
GAMMA = _ERROR_SHARE * np.append(1.0, -np.linalg.solve(_VALUES.T, np.eye(STAGES)[0]))
# Fields over the radius are polynomials in s = sqrt(1 - (x / edge)^2), held at the nodes (node,), with barycentric
# weights; SLOPE (node, node) differentiates over s, MEANS (node, node) gives twice the mean from the centre to each.
NODES = 0.5 * (1.0 - np.cos(pi * np.arange(N_NODES) / (N_NODES - 1)))
BARY: Floats = np.where(np.arange(N_NODES) % 2, -1.0, 1.0) * np.where(np.arange(N_NODES) % (N_NODES - 1), 1.0, 0.5)
SLOPE = BARY / BARY[:, None] / (NODES[:, None] - NODES + np.eye(N_NODES)) * (1.0 - np.eye(N_NODES))
SLOPE -= np.diag(SLOPE.sum(axis=1))


def interpolation(places: Floats) -> Floats:
    """Matrix (place, node) from values at the nodes to values at other places s."""
    away = places[:, None] - NODES
    is_node = away == 0.0
    weight = np.where(is_node.any(axis=1)[:, None], is_node, BARY / np.where(is_node, 1.0, away))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _means() -> Floats:
    """Matrix of MEANS; with x = edge cos(angle) and s = sin(angle) the integrand is smooth."""
    points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    mean = np.zeros((N_NODES, N_NODES))
    mean[-1, -1] = 2.0
    for n in range(N_NODES - 1):
        first = np.arcsin(NODES[n])
        half = 0.5 * (0.5 * pi - first)
        angle = first + half * (points + 1.0)
        mean[n] = 2.0 * (weights * half * np.sin(angle) @ interpolation(np.sin(angle))) / sqrt(1.0 - NODES[n] ** 2)
    return mean


MEANS = _means()

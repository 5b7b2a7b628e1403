"""Records that the compiled parts of a drop share with Python: motion, body, material, and room to compute in.

Compiled code changes the numbers of a record in place (a numpy structured scalar), which is a single address, where
nine arrays are some sixty arguments of each call.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep, condense
from labpipe.materials import Retardation, relaxation_from_creep

#: Stages of a collocated step, and nodes of a polynomial over the contact radius.
STAGES, N_NODES = 5, 24
_MOST_STEPS = 1000
# Terms may be folded away or frozen where that costs this part of rtol.
_CONDENSE_SHARE = 0.01


@dataclass(slots=True)
class Motion:
    """Sphere, plate and springs at one instant, in SI; lengths downwards positive, touch at 0.

    ``surface`` is the displacement of the surface at the pole, filled in afterwards; ``stored`` the energy that the
    springs hold, ``spring_work`` the work done on them, ``plate_loss`` that taken by the dashpot of the plate.
    """

    time: float = 0.0
    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    approach: float = 0.0
    surface: float = 0.0
    force: float = 0.0
    contact_radius: float = 0.0
    stored: float = 0.0
    spring_work: float = 0.0
    plate_displacement: float = 0.0
    plate_velocity: float = 0.0
    plate_acceleration: float = 0.0
    plate_loss: float = 0.0

    def record(self) -> Any:
        """Return the same as a record, as compiled steps take it: of one, access from Python is slow."""
        return blank(MOTION, **{name: getattr(self, name) for name in Motion.__annotations__})

    def take(self, record: Any) -> None:
        """Take over the numbers of a record."""
        for name, value in zip(Motion.__annotations__, record.item(), strict=True):
            setattr(self, name, value)


#: The fields of a Motion as numpy sees them; an array of them is a trail.
MOTION = np.dtype([(name, np.float64) for name in Motion.__annotations__])
Trail = NDArray[np.void]


def blank(dtype: np.dtype[np.void], **values: float | Floats) -> Any:
    """Return one record of zeros, with the fields that are given; the machine takes up only what is used."""
    row: np.recarray[tuple[int], np.dtype[np.record]] = np.zeros(1, dtype).view(np.recarray)
    for name, value in values.items():
        row[name] = value
    return row[0]


class Fall(NamedTuple):
    """What falls onto what; the plate's numbers are 0 on a rigid flat; ``is_sphere`` the profile."""

    mass: float
    gravity: float
    radius: float
    is_sphere: bool
    plate_mass: float
    plate_stiffness: float
    plate_damping: float
    tolerance: float
    longest: float
    first: float


class Phase(NamedTuple):
    """While the contact grows, or shrinks: since ``begin`` [s], over a field out to ``outer`` [m].

    At the start of the step: ``edge`` where the edge is looked for, ``start_edge`` where it is, ``bulk`` twice the area
    under the springs or the load of the central spring.
    """

    recedes: bool
    dented: bool
    begin: float
    outer: float
    edge: float
    start_edge: float
    bulk: float


# Shapes of the arrays of a Room: S stages (or powers), N nodes over the radius, T terms, M steps, L instants.
_SHAPES = {
    "L": "time approach stored",
    "L8": "state",
    "LT": "fading",
    "MS": "powers edge_powers",
    "MS6": "stages",
    "N": "touch release",
    "T": "center node_fading element last rim held",
    "TN": "dent before after node_base node_field primitive",
    "TSS": "weight",
    "S": "base plate_free known bulk delta force edge radius short",
    "S1": "right",
    "S6": "plate",
    "SN": "field slope area",
    "SS": "answer gain matrix",
    "ST": "cross moment",
    "STS": "table",
}
#: Room for the steps of a contact, and for what is sampled on the nodes of the largest contact of this bounce.
#: At the ends of the steps ``time`` from touch; ``state``, and ``stages`` inside: position, velocity, force, contact
#: radius, displacement and velocity of the plate, and at the ends what its dashpot took and the work on the springs;
#: ``approach``, and ``powers`` its coefficients over u from 0 to 1; ``edge_powers`` those of the square of the radius
#: while it advances, of s while it recedes; ``fading`` the fading integral of the approach; ``stored`` energy.
#: ``center`` is the displacement of the central spring at touch, ``dent`` that of the others less the central one's;
#: ``touch`` and ``release`` [s]; ``before`` the dents found, ``after`` the displacement of the elements left;
#: ``node_base`` that of Maxwell elements less the fading integral at touch, ``node_field`` the same where the contact
#: began to shrink; ``node_fading`` and ``element`` room for one.
#: Of the step at hand ``base`` is the approach without force, ``answer`` the approach per force; ``known`` the force,
#: or its density, that is left of the start; ``gain`` that per approach; ``weight`` of the fading integrals;
#: ``field`` and ``slope`` the polynomial over the radius that the edge meets, and its derivative, ``area`` twice its
#: mean; ``cross`` the force per change of the dents' moments; ``moment`` those moments.
Room = Any
#: Contact law of a material, see :func:`law_of`.
Law = Any


class Tables(NamedTuple):
    """Of a material: condensed compliance, terms folded into one and frozen, its law, and room to compute in."""

    creep: Creep
    left_out: tuple[int, int]
    law: Law
    room: Room

    @classmethod
    def of(cls, creep: Creep, shortest: float, longest: float, rtol: float, *, fold: bool) -> "Tables":
        """Leave out terms that no contact of a duration ``shortest`` [s] needs; sort the others, equal times as one."""
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
        room = [
            (name, np.float64, tuple(sizes.get(c) or int(c) for c in shape))
            for shape, names in _SHAPES.items()
            for name in names.split()
        ]
        return cls(creep, (n_folded, n_frozen), law, blank(np.dtype(room)))


def law_of(creep: Creep) -> Law:
    """Contact law in both forms, from a compliance with distinct terms in ascending order.

    ``E_relaxed``, ``E`` and ``rate`` (maxwell,) of the relaxation modulus; ``instantaneous``, ``C`` and ``creep_rate``
    (element,) of the compliance, a dashpot last with rate 0; ``mixed`` (maxwell, element), the displacement of a
    Maxwell element per displacement of a Kelvin element while the spring is free. There is room for more terms than
    there are, so that one compiled code serves all materials: ``maxwells``, ``elements`` with the dashpot, and
    ``kelvins`` without.
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
    for name, value in values.items():
        if np.ndim(value):
            values[name] = np.pad(value, [(0, terms - n) for n in value.shape])
    kinds = {name: np.int64 if isinstance(value, int) else np.float64 for name, value in values.items()}
    fields = [(name, kind, np.shape(values[name])) for name, kind in kinds.items()]
    return blank(np.dtype(fields), **values)

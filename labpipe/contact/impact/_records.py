"""Records that the compiled parts of a drop share with Python: motion, counts, law, method, body, path and nodes.

Compiled code changes the numbers of a record in place (a numpy structured scalar). What is handed on is one record
with these fields: a single address, where nine arrays are some sixty arguments of each call, and take longer to
compile.
"""

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats


@dataclass(slots=True)
class Motion:
    """Sphere, plate and springs at one instant, in SI; lengths downwards positive, touch at 0.

    ``approach`` is the sphere's position above the plate's, ``surface`` the displacement of the surface at the pole,
    which is the same in contact and filled in afterwards; ``stored`` the energy that the springs
    hold, ``spring_work`` the work done on them, ``plate_loss`` that taken by the dashpot of the plate.
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


@dataclass(slots=True)
class Counts:
    """Work done; counts only, so that they do not depend on the machine."""

    solver_steps: int = 0
    rejected_steps: int = 0
    kernel_products: int = 0
    spring_updates: int = 0
    rest_steps: int = 0
    flights: int = 0


#: The fields of a Motion as numpy sees them; an array of them is a trail.
MOTION = np.dtype([(name, np.float64) for name in Motion.__annotations__])
Trail = NDArray[np.void]


def blank(dtype: np.dtype[np.void], **values: float | Floats) -> Any:
    """Return one record of zeros, with the fields that are given; the machine takes up only what is used."""
    row: np.recarray[tuple[int], np.dtype[np.record]] = np.zeros(1, dtype).view(np.recarray)
    for name, value in values.items():
        row[name] = value
    return row[0]


class Law(Protocol):
    """Contact law of the material in both forms.

    There is room for more terms than there are, so that one compiled code serves all materials:
    ``maxwells`` of the relaxation modulus, ``elements`` of the compliance with its dashpot, and
    ``kelvins`` without. The same holds for what has a row per term in the other records.

    ``E_relaxed`` [Pa], ``E`` [Pa] and ``rate`` [1/s] (maxwell,) of the relaxation modulus;
    ``instantaneous`` [1/Pa], ``C`` [1/Pa] and ``creep_rate`` [1/s] (element,) of the compliance, a
    dashpot last with rate 0; ``mixed`` (maxwell, element) is the displacement of a Maxwell element
    per displacement of a Kelvin element while the spring is free.
    """

    maxwells: int
    elements: int
    kelvins: int
    E_relaxed: float
    E: Floats
    rate: Floats
    instantaneous: float
    C: Floats
    creep_rate: Floats
    mixed: Floats
    is_liquid: bool


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

    At the start of the step: ``edge`` where the edge is looked for, ``start_edge`` where it is (as
    in ``Path.edge``), ``bulk`` twice the area under the springs or the load of the central spring.
    """

    recedes: bool
    dented: bool
    begin: float
    outer: float
    edge: float
    start_edge: float
    bulk: float


class Room(Protocol):
    """Room for the steps of a contact, and for what is sampled on the nodes of the largest contact of this bounce.

    Shapes: S stages (or powers), N nodes over the radius, T terms, M steps at most, L instants.

    At the ends of the steps ``time`` from touch; ``state``, and ``stages`` inside: position, velocity, force, contact
    radius, displacement and velocity of the plate, and at the ends what its dashpot took and the work on the springs;
    ``approach``, and ``powers`` its coefficients over u from 0 to 1; ``edge_powers`` those of the square of the radius
    while it advances, of s while it recedes; ``fading`` the fading integral of the approach; ``stored`` energy.

    ``center`` is the displacement of the central spring at touch, ``dent`` that of the others less the central one's;
    ``touch`` and ``release`` [s]; ``before`` the dents found, ``after`` the displacement of the elements left;
    ``node_base`` that of Maxwell elements less the fading integral at touch, ``node_field`` the same where the contact
    began to shrink; ``node_fading`` and ``element`` room for one.

    Of the step at hand ``base`` is the approach without force, ``answer`` the approach per force; ``known`` the force,
    or its density, that is left of the start; ``gain`` that per approach; ``weight`` of the fading integrals;
    ``field`` and ``slope`` the polynomial over the radius that the edge meets, and its derivative, ``area`` twice its
    mean; ``cross`` the force per change of the dents' moments; ``moment`` those moments.
    """

    time: Annotated[Floats, "L"]
    state: Annotated[Floats, "L8"]
    stages: Annotated[Floats, "MS6"]
    approach: Annotated[Floats, "L"]
    powers: Annotated[Floats, "MS"]
    edge_powers: Annotated[Floats, "MS"]
    fading: Annotated[Floats, "LT"]
    stored: Annotated[Floats, "L"]
    center: Annotated[Floats, "T"]
    dent: Annotated[Floats, "TN"]
    touch: Annotated[Floats, "N"]
    release: Annotated[Floats, "N"]
    before: Annotated[Floats, "TN"]
    after: Annotated[Floats, "TN"]
    node_base: Annotated[Floats, "TN"]
    node_field: Annotated[Floats, "TN"]
    node_fading: Annotated[Floats, "T"]
    element: Annotated[Floats, "T"]
    base: Annotated[Floats, "S"]
    answer: Annotated[Floats, "SS"]
    plate: Annotated[Floats, "S6"]
    plate_free: Annotated[Floats, "S"]
    known: Annotated[Floats, "S"]
    gain: Annotated[Floats, "SS"]
    weight: Annotated[Floats, "TSS"]
    field: Annotated[Floats, "SN"]
    slope: Annotated[Floats, "SN"]
    area: Annotated[Floats, "SN"]
    table: Annotated[Floats, "STS"]
    cross: Annotated[Floats, "ST"]
    moment: Annotated[Floats, "ST"]
    last: Annotated[Floats, "T"]
    rim: Annotated[Floats, "T"]
    primitive: Annotated[Floats, "TN"]
    bulk: Annotated[Floats, "S"]
    delta: Annotated[Floats, "S"]
    force: Annotated[Floats, "S"]
    edge: Annotated[Floats, "S"]
    radius: Annotated[Floats, "S"]
    held: Annotated[Floats, "T"]
    matrix: Annotated[Floats, "SS"]
    right: Annotated[Floats, "S1"]
    short: Annotated[Floats, "S"]

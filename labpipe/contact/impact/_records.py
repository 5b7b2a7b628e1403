"""What the compiled parts of a contact work on: law, method, body, path, phase, nodes, and room to work in."""

from typing import NamedTuple, Protocol

from labpipe.arrays import Floats


class Law(Protocol):
    """Contact law of the material in both forms: one record, as :class:`Scheme`.

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


class Scheme(Protocol):
    """Constants of the method: Radau's points, and polynomials over the radius.

    What is handed on is one record with these fields: a single address to compiled code, where nine
    arrays are some sixty arguments of each call, and take longer to compile.

    ``c`` (stage,), ``a`` (stage, stage) and its square ``aa``; ``to_powers`` (stage, stage) from
    values less the first to the coefficients of u, u^2, ...; ``gamma`` (stage + 1,) of the error.
    Fields over the radius are polynomials in s = sqrt(1 - (x / edge)^2), held at the nodes ``s``
    (node,) with barycentric weights ``bary``; ``slope`` (node, node) differentiates over s,
    ``means`` (node, node) gives twice the mean from the centre to each node.
    """

    c: Floats
    a: Floats
    aa: Floats
    to_powers: Floats
    gamma: Floats
    s: Floats
    bary: Floats
    slope: Floats
    means: Floats


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


class Path(Protocol):
    """Room for the steps of a contact, and what is known of each.

    ``time`` (step + 1,) from touch; ``state`` (step + 1, 8) at the ends and ``stages`` (step,
    stage, 6) inside: position, velocity, force, contact radius, displacement and velocity of the
    plate, and at the ends what its dashpot took and the work on the springs; ``approach`` (step + 1,)
    at the ends and ``powers`` (step, stage) its coefficients over u from 0 to 1; ``edge`` (step,
    stage) those of the square of the radius while it advances, of s while it recedes; ``fading``
    (step + 1, maxwell) the fading integral of the approach; ``stored`` (step + 1,) energy.
    """

    time: Floats
    state: Floats
    stages: Floats
    approach: Floats
    powers: Floats
    edge: Floats
    fading: Floats
    stored: Floats


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


class Nodes(Protocol):
    """What is sampled on the nodes of the largest contact of this bounce.

    ``touch`` and ``release`` (node,) [s]; ``before`` (element, node) the dents found, ``after`` the
    displacement of the elements left; ``base`` (maxwell, node) that of Maxwell elements less the
    fading integral at touch, ``field`` the same where the contact began to shrink; room for one.
    """

    touch: Floats
    release: Floats
    before: Floats
    after: Floats
    base: Floats
    field: Floats
    fading: Floats
    element: Floats


class Room(Protocol):
    """Numbers of the step at hand.

    ``base`` (stage,) is the approach without force, ``answer`` (stage, stage) the approach per
    force; ``known`` (stage,) the force, or its density, that is left of the start; ``gain`` (stage,
    stage) that per approach; ``weight`` (maxwell, stage, power) of the fading integrals;
    ``field`` and ``slope`` (stage, node) the polynomial over the radius that the edge meets, and
    its derivative, ``area`` (stage, node) twice its mean; ``cross`` (stage, element, power) the
    force per change of the dents' moments; ``moment`` (stage, element) those moments.
    """

    base: Floats
    answer: Floats
    plate: Floats
    plate_free: Floats
    known: Floats
    gain: Floats
    weight: Floats
    field: Floats
    slope: Floats
    area: Floats
    table: Floats
    cross: Floats
    moment: Floats
    last: Floats
    rim: Floats
    primitive: Floats
    bulk: Floats
    delta: Floats
    force: Floats
    edge: Floats
    radius: Floats
    held: Floats
    matrix: Floats
    right: Floats
    short: Floats

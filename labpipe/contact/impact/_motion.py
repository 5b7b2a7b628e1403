"""What moves and what is recorded of it: the words that the parts of the drop share."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

from labpipe.contact.impact._plate import Plate, PlateState
from labpipe.contact.memory import Array
from labpipe.errors import InputError


class PlainSprings(NamedTuple):
    """What the force of a row of springs is made of; for the compiled steps.

    ``inner`` is the weight of the last spring without its outer cell, ``total`` the running sum of
    weights from 0; ``is_cut`` tells that the edge is found inside a cell, ``edge_bias`` [m] what is
    taken off its radius otherwise.
    """

    inner: Array
    total: Array
    is_cut: bool
    edge_bias: float


class Springs(Protocol):
    """Nested springs: the common shape of the method of dimensionality reduction and of rings."""

    @property
    def position(self) -> Array:
        """Distance from the axis (spring,) in m."""

    @property
    def gap(self) -> Array:
        """Approach at which each unloaded spring touches (spring,) in m."""

    @property
    def weight(self) -> Array:
        """Force per load of each spring (spring,)."""

    def force(self, approach: float, reach: Array, moments: Array) -> tuple[float, float]:
        """Force and its slope, both times the step compliance."""

    def contact_radius(self, approach: float, reach: Array) -> float:
        """Radius in m where the load falls to zero."""

    def covering(self, radius: float) -> int:
        """Return how many springs reach out to a radius."""

    def pressure(self, load: Array, edge: float, radius: Array) -> Array:
        """Pressure in Pa at given radii in m, from loads and the contact radius."""

    def surface(self, displacement: Array, radius: Array) -> Array:
        """Displacement in m of the surface at given radii in m."""

    def plain(self, count: int) -> PlainSprings:
        """Return the inner springs as plain arrays."""

    def extended(self, radius: float) -> Self:
        """Return the same springs and further ones out to a radius."""


class AnnularContactError(InputError):
    """The springs outside the contact would touch before those inside: steps or springs too coarse.

    A sphere does not do that; a step that rings does, where the material relaxes by a factor of
    thousands within it.
    """


class Body(NamedTuple):
    """What falls, and onto what."""

    mass: float
    gravity: float
    plate: Plate | None


class Record(NamedTuple):
    """One instant of the motion; lengths in m, downwards positive, first touch at 0."""

    time: float
    position: float
    velocity: float
    approach: float
    force: float
    contact_radius: float
    stored: float
    spring_work: float
    plate: PlateState
    plate_loss: float


class Snapshot(NamedTuple):
    """The springs at one instant; ``load`` in Pa m and ``displacement`` in m, (spring,)."""

    time: float
    load: Array
    displacement: Array
    contact_radius: float


@dataclass(slots=True)
class Counts:
    """Work done; counts only, so that they do not depend on the machine."""

    solver_steps: int = 0
    rejected_steps: int = 0
    newton_iterations: int = 0
    kernel_products: int = 0
    spring_updates: int = 0
    rest_steps: int = 0
    flights: int = 0

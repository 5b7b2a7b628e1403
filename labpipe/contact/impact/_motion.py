"""The state of motion, its record and the counts of work, as all parts of a drop share them.

The compiled steps change a record of these numbers in place (a numpy structured scalar); a row of such
records is the trail of a contact.
"""

from dataclasses import dataclass
from math import inf
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.errors import InputError


@dataclass(slots=True)
class Motion:
    """Sphere, plate and springs at one instant, in SI; lengths downwards positive, touch at 0.

    ``approach`` is the sphere's position above the plate's; ``stored`` the energy that the springs
    hold, ``spring_work`` the work done on them, ``plate_loss`` that taken by the dashpot of the plate.
    """

    time: float = 0.0
    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    approach: float = 0.0
    force: float = 0.0
    contact_radius: float = 0.0
    stored: float = 0.0
    spring_work: float = 0.0
    plate_displacement: float = 0.0
    plate_velocity: float = 0.0
    plate_acceleration: float = 0.0
    plate_loss: float = 0.0

    def record(self) -> np.record:
        """Return the same as a record, as compiled steps take it."""
        return blank(MOTION, **{name: getattr(self, name) for name in Motion.__annotations__})

    def take(self, record: Any) -> None:
        """Take over the numbers of a record."""
        for name, value in zip(Motion.__annotations__, record.item(), strict=True):
            setattr(self, name, value)


class Counts(Protocol):
    """Work done; counts only, so that they do not depend on the machine."""

    solver_steps: int
    rejected_steps: int
    newton_iterations: int
    kernel_products: int
    spring_updates: int
    rest_steps: int
    flights: int


#: The fields of a Motion and of Counts as numpy sees them; an array of the first is a trail.
MOTION = np.dtype([(name, np.float64) for name in Motion.__annotations__])
COUNTS = np.dtype([(name, np.int64) for name in Counts.__annotations__])
Trail = NDArray[np.void]


def blank(dtype: np.dtype[np.void], **values: float | Floats) -> np.record:
    """Return one record of zeros, with the fields that are given."""
    row: np.recarray[tuple[int], np.dtype[np.record]] = np.recarray(1, dtype)
    row.fill(0)
    for name, value in values.items():
        row[name] = value
    return row[0]


def counted(counts: Counts) -> dict[str, int]:
    """Return the counts by name."""
    return {name: int(getattr(counts, name)) for name in Counts.__annotations__}


class AnnularContactError(InputError):
    """The springs outside the contact would touch before those inside: steps or springs too coarse.

    A sphere does not do that; a step that rings does, where the material relaxes by a factor of
    thousands within it.
    """


@dataclass(frozen=True, slots=True)
class Stillness:
    """When a contact has come to rest: speed and force swing no more than this for a whole period.

    Speed alone will not do: it vanishes at every turn. Its swing is taken, not its size, because a
    contact at rest still creeps.

    ``tolerance``: amplitude relative to the static sag; ``period`` [s]: of the sphere on its static sag; ``speed``
    [m/s]: gravity times period over 2 pi: the speed that belongs to an amplitude of one sag; ``plate_speed`` [m/s]:
    speed of the plate that counts as such an amplitude; infinite on a rigid floor.
    """

    tolerance: float
    period: float
    speed: float
    plate_speed: float = inf

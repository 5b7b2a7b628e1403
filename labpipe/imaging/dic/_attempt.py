"""What tracking is told, and what it has found so far in one frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._reference import Status
from labpipe.imaging.dic._standing import Standing
from labpipe.imaging.dic._subset_kernel import HIDDEN
from labpipe.imaging.dic._subset_solver import Solution, empty_solution, put


@dataclass(frozen=True)
class Options:
    """Settings of the solver, see :func:`labpipe.imaging.track`.

    ``adapt`` holds for every point, usable or not, the sum of what may be solved for where it is
    needed, see :meth:`.Subsets.model`; ``standing`` is what hides subsets in part.
    """

    order: int
    tolerance: float
    max_iterations: int
    min_zncc: float
    adapt: Integers
    standing: Standing | None = None


@dataclass
class Work:
    """Counts of what was done."""

    subsets_solved: int = 0
    iterations: int = 0
    reseeds: int = 0


@dataclass(frozen=True)
class Attempt(Solution):
    """Best answers so far for one frame: which of them are trusted, and which left the frame or were outvoted."""

    trusted: Flags
    reached: Flags
    outvoted: Flags

    @classmethod
    def nothing(cls, expected: Floats) -> "Attempt":
        """Return answers that hold nothing but where the points were expected."""
        attempt = cls.of(empty_solution(len(expected)))
        attempt.motion[:] = expected
        attempt.code[:] = -1
        return attempt

    @classmethod
    def of(cls, found: Solution) -> "Attempt":
        """Return the answers of all points, none of them trusted yet."""
        return cls(
            **vars(found), **{name: np.zeros(len(found.code), bool) for name in ("trusted", "reached", "outvoted")}
        )

    @property
    def status(self) -> NDArray[np.int8]:
        """:class:`.Status` of every point."""
        status = np.where(self.trusted, Status.OK, Status.LOST).astype(np.int8)
        status[~self.trusted & (self.code == HIDDEN)] = Status.COVERED
        status[~self.trusted & self.reached] = Status.OUTSIDE
        status[~self.trusted & self.outvoted] = Status.OUTVOTED
        return status

    def take(self, chosen: Integers, found: Solution, better: Flags) -> None:
        """Replace the answers of chosen points where the new ones are better."""
        put(self, chosen[better], found, better)

"""What tracking is told, and what it has found so far in one frame."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._subset_solver import CHANGES, Solution


@dataclass(frozen=True)
class Options:
    """Settings of the solver, see :func:`labpipe.imaging.track`.

    ``adapt`` holds for every point, usable or not, the sum of what may be solved for where it is
    needed, see :meth:`.Subsets.model`.
    """

    order: int
    tolerance: float
    max_iterations: int
    min_zncc: float
    adapt: Integers


@dataclass
class Work:
    """Counts of what was done."""

    subsets_solved: int = 0
    iterations: int = 0
    reseeds: int = 0


@dataclass(frozen=True)
class FrameResult:
    """Answers for the usable points of one frame, as in ``Solution``, and their status."""

    motion: Floats
    gain: Floats
    residual: Floats
    zncc: Floats
    iterations: Integers
    status: NDArray[np.int8]
    model: Integers
    change: Floats


@dataclass
class Attempt:
    """Best answers so far for one frame."""

    motion: Floats
    zncc: Floats
    gain: Floats
    residual: Floats
    iterations: Integers
    code: Integers
    trusted: Flags
    model: Integers
    needed: Integers
    change: Floats
    reached: Flags = field(init=False)
    outvoted: Flags = field(init=False)

    def __post_init__(self) -> None:
        self.reached = np.zeros(len(self.zncc), bool)
        self.outvoted = np.zeros(len(self.zncc), bool)

    @classmethod
    def nothing(cls, expected: Floats) -> "Attempt":
        """Return answers that hold nothing but where the points were expected."""
        count = len(expected)
        zncc, gain, residual = np.full((3, count), np.nan)
        nowhere = np.full(count, -1)
        none = np.zeros((3, count), np.int64)
        no, unchanged = np.zeros(count, bool), np.zeros((count, CHANGES))
        return cls(expected.copy(), zncc, gain, residual, none[0], nowhere, no, none[1], none[2], unchanged)

    @classmethod
    def of(cls, found: Solution) -> "Attempt":
        """Return the answers of all points, none of them trusted yet."""
        return cls(
            found.motion,
            found.zncc.copy(),
            found.gain.copy(),
            found.residual.copy(),
            found.iterations,
            found.code,
            np.zeros(len(found.code), bool),
            found.model,
            found.needed,
            found.change,
        )

    def take(self, chosen: Integers, found: Solution, better: Flags) -> None:
        """Replace the answers of chosen points where the new ones are better."""
        where = chosen[better]
        self.motion[where] = found.motion[better]
        self.zncc[where] = found.zncc[better]
        self.gain[where] = found.gain[better]
        self.residual[where] = found.residual[better]
        self.code[where] = found.code[better]
        self.model[where] = found.model[better]
        self.needed[where] = found.needed[better]
        self.change[where] = found.change[better]

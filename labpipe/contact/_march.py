"""A viscoelastic contact without inertia over a history of displacement or load, with error control.

The history is linear between its samples; two samples at one time are a jump. Between them steps adapt
(:mod:`labpipe.contact._stepping`): the difference of a step done whole and in two halves must stay below a share of
the force. It is of third order and what all steps leave of second, so that the share goes with the power 3/2 of
``rtol``. Steps shrink to the fastest relaxation after a jump and grow over the decades of a hold; a process much
faster than the step answers as plain compliance.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.contact import _stepping as kernel
from labpipe.contact._memory import Creep
from labpipe.contact._springs import NOT_NESTED, OUTGROWN, SpringBed, press
from labpipe.contact._stepping import Room, Springs
from labpipe.errors import InputError

Control = Literal["displacement", "force"]

# Difference allowed in a step over rtol^(3/2): the returned error is 0.03 to 0.24 of the power 2/3
# of the difference, measured on ramps, holds, oscillations and tapping of four materials.
_STEP_SHARE = 8.0


def room_for(n_springs: int, n_elements: int) -> Room:
    """Springs that never carried a load, and room for their steps."""
    memories = np.zeros((2, n_elements, n_springs))
    rows, weights, motions = np.zeros((7, n_springs)), np.zeros((2, 3, n_elements)), np.zeros((4, 6))
    return Room(rows[0], *memories, *rows[1:], *weights, *motions)


@dataclass(slots=True)
class March:
    """One contact, one material, one history.

    ``rtol`` is the error of force or approach over their largest values; ``limit`` the message when the contact reaches
    the end of the bed; ``answer`` (7,): displacement [m], force, contact half width [m], work of the indenter on the
    springs (trapezoids over the steps), heat of the material, exact for the load path taken, and energy held; force
    and energies per reduced modulus and unit depth of a line.
    """

    contact: SpringBed
    creep: Creep
    control: Control
    rtol: float
    limit: str
    room: Room = field(init=False)
    answer: Floats = field(default_factory=lambda: np.zeros(7))
    _counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))

    @property
    def counts(self) -> dict[str, int]:
        """Work done."""
        return dict(zip(("solver_steps", "rejected_steps", "solves"), self._counts.tolist(), strict=True))

    def run(self, time: Floats, value: Floats) -> Iterator[Floats]:
        """Yield the answer (7,) at every sample of a history of displacement [m], or force per tip (and unit depth)."""
        law, rtol = self.creep.elements, self.rtol
        self.room, self.answer[:] = room_for(self.contact.size, law.rate.size), 0.0
        springs = Springs(self.contact, law, self.room)
        control = kernel.DISPLACEMENT if self.control == "displacement" else kernel.FORCE
        softest = float(self.creep.compliance(float(time[-1] - time[0])))
        # A time below every relaxation time: a bound on the trace of the rates.
        fastest = np.inf
        if law.rate.size:
            fastest = 1.0 / (float(law.rate.max()) + float(law.flow.sum()) / self.creep.instantaneous)
        scales = np.array([0.0, softest, 1e-300])
        highest = -np.inf
        self.answer[0] = min(float(value[0]), 0.0) if control == kernel.DISPLACEMENT else 0.0
        tolerance = _STEP_SHARE * rtol**1.5 if law.rate.size else np.inf
        for n in range(time.size):
            last, before = float(value[n]), float(value[n - 1]) if n else 0.0
            length = float(time[n] - time[n - 1]) if n else 0.0
            if last > highest:  # the force that the slowest loading would show
                highest = scales[0] = last
                if control == kernel.DISPLACEMENT:
                    room = self.room.whole
                    scales[0] = press(self.contact, self.contact.gap, softest, last, False, room)[1]
            is_jump = length == 0.0
            if not (is_jump and n and last == before):
                step, allowed = float(self.answer[6]), np.inf if is_jump else tolerance
                goals = control, length, before, last, allowed, scales, step
                outcome = kernel.cross(springs, *goals, self.answer, self._counts)
                if outcome == OUTGROWN:
                    raise InputError(self.limit)
                if outcome != kernel.DONE:
                    problem = "the steps become too short"
                    if outcome == NOT_NESTED:
                        problem = (
                            "the contact stops being one that grows and shrinks about its centre, which independent "
                            "springs cannot follow"
                        )
                    raise InputError(
                        f"at {time[n]:g} s {problem}; give another rtol, more samples, or a material with more of an "
                        "instantaneous compliance"
                    )
            if is_jump:
                self.answer[6] = fastest
            yield self.answer

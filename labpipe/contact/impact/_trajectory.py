"""Records over time of the stretches of a drop: the fall, contacts, flights, and rest.

Between steps the position comes from cubic Hermite interpolation of position and speed, which is the
motion in flight exactly; force, contact radius and energies from monotone cubic interpolation, so that
none leaves the range of its steps.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from labpipe.arrays import Floats
from labpipe.contact.impact._plate import PlateState
from labpipe.contact.impact._records import MOTION, Motion, Trail
from labpipe.contact.impact._setting import Setting

#: Samples of a flight when no times are asked for, its ends included: enough for a smooth parabola.
FLIGHT_SAMPLES = 26


@dataclass(slots=True)
class Course:
    """Stretches one behind the other: at instants of their own, or at ``times`` (time,) [s] that are asked for."""

    times: Floats | None
    _parts: list[Trail] = field(default_factory=list)
    _start: float = -np.inf
    _last: Callable[[Floats], Trail] | None = None

    def add(self, at: Callable[[Floats], Trail], own: Floats, end: float) -> None:
        """Append a stretch up to ``end`` [s]: ``at`` returns its records, ``own`` are its own instants."""
        if self.times is None:
            self._parts.append(at(own))
            return
        wanted = self.times[(self.times >= self._start) & (self.times < end)]
        self._start, self._last = end, at
        if wanted.size:
            self._parts.append(at(wanted))

    def records(self) -> Trail:
        """All records (time,)."""
        if self.times is not None and self._last is not None and np.any(late := self.times >= self._start):
            self._parts.append(self._last(self.times[late]))
        return np.concatenate(self._parts)


def flown(start: Motion, body: Setting, stored: Floats, dent: Floats, rate: Floats, times: Floats) -> Trail:
    """Return records (time,) of a flight, known in closed form.

    ``start``: the instant it begins, without force; ``stored`` (element,) [J] and ``dent`` (element,) [m]: energy of
    each element of the memory, and its displacement at the pole, at the start; ``rate`` (element,) [1/s]: how fast the
    elements recover.
    """
    s, trail, gravity = times - start.time, np.zeros(times.size, MOTION), body.gravity
    trail["time"], trail["velocity"] = times, start.velocity + gravity * s
    trail["approach"] = trail["position"] = start.position + (start.velocity + 0.5 * gravity * s) * s
    trail["surface"] = np.exp(-s[:, None] * rate) @ dent
    trail["stored"] = np.exp(-2.0 * s[:, None] * rate) @ stored
    trail["spring_work"], trail["plate_loss"] = start.spring_work, start.plate_loss
    if body.plate is not None:
        first = PlateState(start.plate_displacement, start.plate_velocity, start.plate_acceleration)
        state = body.plate.free(first, s)
        trail["plate_displacement"], trail["plate_velocity"], trail["plate_acceleration"] = state
        trail["approach"] -= state.displacement
        trail["plate_loss"] += body.plate.energy(first) - body.plate.energy(state)
    return trail


def stepped(steps: Trail, body: Setting, is_resting: bool, times: Floats) -> Trail:
    """Return records (time,) of a contact that was stepped, or of the creep of a body at rest."""
    row = np.minimum(np.searchsorted(steps["time"], times), steps.size - 1)
    if steps.size == 1 or np.array_equal(steps["time"][row], times):
        return steps[row]
    columns = structured_to_unstructured(steps)
    inside = np.clip(times, steps["time"][0], steps["time"][-1])
    trail: Trail = unstructured_to_structured(PchipInterpolator(steps["time"], columns)(inside), MOTION)
    trail["time"] = times
    if not is_resting:
        acceleration = body.gravity - steps["force"] / body.mass
        trail["velocity"] = CubicHermiteSpline(steps["time"], steps["velocity"], acceleration)(inside)
        trail["position"] = CubicHermiteSpline(steps["time"], steps["position"], steps["velocity"])(inside)
        trail["approach"] = trail["surface"] = trail["position"] - trail["plate_displacement"]
    return trail

"""Flights, and records over time of the stretches of a drop: the fall, contacts, flights, and rest.

In flight the sphere is ballistic while its dent recovers, so it touches again on the residual dent, not where
the undeformed surface would be. On rigid ground the distance is a parabola minus a sum of decaying
exponentials: its second derivative increases, so that it has exactly one zero after lift-off, before the
sphere falls back to where it lifted off.

Between steps the position comes from cubic Hermite interpolation of position and speed, which is the
motion in flight exactly; force, contact radius and energies from monotone cubic interpolation, so that
none leaves the range of its steps.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import sqrt
from typing import Any

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.optimize import brentq

from labpipe.arrays import Floats
from labpipe.contact.impact._records import MOTION, Motion, Trail
from labpipe.contact.impact._setting import Plate, Setting
from labpipe.errors import LabpipeError

#: Samples of a flight when no times are asked for, its ends included: enough for a smooth parabola.
FLIGHT_SAMPLES = 26
# Looks within a period of a ringing plate.
_LOOKS_PER_PERIOD = 32


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


def time_of_flight(start: Motion, gravity: float, dent: Floats, rate: Floats, plate: Plate | None) -> float:
    """Time [s] from lift-off, at which both part, to the next touch.

    ``dent``, ``rate`` (element,) [m] [1/s]: displacements of the elements of the central spring at lift-off, and their
    rates of recovery. A ringing plate is looked at so often that no touch is missed that lasts longer than a small
    part of its period, but only within reach of its swing, which only falls.
    """
    velocity, u = start.velocity, start.plate_displacement

    def sunk(time: Any) -> Any:
        """Depth [m] to which the sphere, let alone, would have sunk into the surface, whose dent recovers."""
        raised = plate.free(u, start.plate_velocity, time)[0] - u if plate else 0.0
        return (velocity + 0.5 * gravity * time) * time - np.expm1(-np.multiply.outer(time, rate)) @ dent - raised

    reach = 0.0 if plate is None else sqrt(2.0 * plate.energy(u, start.plate_velocity) / plate.stiffness)
    longest = (-velocity + sqrt(velocity**2 + 4.0 * gravity * reach)) / gravity * 1.001
    looks = np.array([longest])
    if plate is not None:
        step = 1.0 / (plate.frequency * _LOOKS_PER_PERIOD)
        looks = step * np.arange(1, int(longest / step) + 2)
        highest = u + reach + float(np.maximum(dent, 0.0).sum())
        looks = looks[(velocity + 0.5 * gravity * looks) * looks + highest >= 0.0]
    touching = np.flatnonzero(sunk(looks) > 0.0)
    if not touching.size:
        raise LabpipeError("the sphere does not come back to the plate")
    end = float(looks[touching[0]])
    begin = 1e-9 * end if plate is None else max(end - step, 1e-9 * step)
    while sunk(begin) >= 0.0:
        begin *= 1e-2
        if begin < 1e-290 * end:
            return 0.0
    return float(brentq(sunk, begin, end, xtol=1e-300, rtol=8.9e-16))


def flown(start: Motion, body: Setting, stored: Floats, dent: Floats, rate: Floats, s: Floats) -> Trail:
    """Return records (time,) of a flight at times ``s`` [s] since its ``start``, known in closed form.

    ``stored`` (element,) [J] and ``dent`` (element,) [m]: energy of each element of the memory, and its displacement at
    the pole, at the start; ``rate`` (element,) [1/s]: how fast the elements recover.
    """
    trail, gravity = np.zeros(s.size, MOTION), body.gravity
    trail["time"], trail["velocity"], trail["acceleration"] = start.time + s, start.velocity + gravity * s, gravity
    trail["approach"] = trail["position"] = start.position + (start.velocity + 0.5 * gravity * s) * s
    trail["surface"] = np.exp(-s[:, None] * rate) @ dent
    trail["stored"] = np.exp(-2.0 * s[:, None] * rate) @ stored
    trail["spring_work"], trail["plate_loss"] = start.spring_work, start.plate_loss
    if body.plate is not None:
        state = body.plate.free(start.plate_displacement, start.plate_velocity, s)
        trail["plate_displacement"], trail["plate_velocity"], trail["plate_acceleration"] = state
        trail["approach"] -= state[0]
        trail["plate_loss"] += body.plate.energy(start.plate_displacement, start.plate_velocity)
        trail["plate_loss"] -= body.plate.energy(*state[:2])
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

"""From the segments of a drop to records over time: samples in flight, values at given times.

A drop is a list of segments: the fall, contacts, flights, and rest. Between steps the position
comes from cubic Hermite interpolation of position and speed, which is the motion in flight exactly;
force, contact radius and energies from monotone cubic interpolation, so that none leaves the range
of its steps.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from labpipe.arrays import Floats
from labpipe.contact.impact._bounce import Curves
from labpipe.contact.impact._plate import PlateState
from labpipe.contact.impact._records import MOTION, Motion, Trail
from labpipe.contact.impact._setting import Setting

# Samples of a flight when no times are asked for: enough for a smooth parabola.
_FLIGHT_SAMPLES = 24


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight of a body from its start; everything in it is known in closed form.

    ``start``: the instant it begins, without force; ``end`` [s]; ``stored`` (element,) [J] and ``dent`` (element,) [m]:
    energy of each element of the memory, and its displacement at the pole, at the start; ``rate`` (element,) [1/s]:
    how fast the elements recover.
    """

    start: Motion
    end: float
    stored: Floats
    dent: Floats
    rate: Floats
    body: Setting

    def natural(self) -> Trail:
        """Sample it, its ends included."""
        return self.at(np.linspace(self.start.time, self.end, _FLIGHT_SAMPLES + 2))

    def at(self, times: Floats) -> Trail:
        """Return records (time,) at times [s]."""
        start, s, trail, gravity = self.start, times - self.start.time, np.zeros(times.size, MOTION), self.body.gravity
        trail["time"], trail["velocity"] = times, start.velocity + gravity * s
        trail["approach"] = trail["position"] = start.position + (start.velocity + 0.5 * gravity * s) * s
        trail["surface"] = np.exp(-s[:, None] * self.rate) @ self.dent
        trail["stored"] = np.exp(-2.0 * s[:, None] * self.rate) @ self.stored
        trail["spring_work"], trail["plate_loss"] = start.spring_work, start.plate_loss
        plate = self.body.plate
        if plate is not None:
            first = PlateState(start.plate_displacement, start.plate_velocity, start.plate_acceleration)
            state = plate.free(first, s)
            trail["plate_displacement"], trail["plate_velocity"], trail["plate_acceleration"] = state
            trail["approach"] -= state.displacement
            trail["plate_loss"] += plate.energy(first) - plate.energy(state)
        return trail


@dataclass(frozen=True, slots=True)
class Contact:
    """The recorded steps of a contact that was stepped, from touch to lift-off, or of the creep of a body at rest."""

    records: Trail
    body: Setting
    is_resting: bool = False

    @property
    def end(self) -> float:
        """Time of the last step in s."""
        return float(self.records["time"][-1])

    def natural(self) -> Trail:
        """Return every step; rest begins with the last instant of the contact before it, which is left out."""
        return self.records[1:] if self.is_resting else self.records

    def at(self, times: Floats) -> Trail:
        """Return records (time,) at times [s]."""
        steps = self.records
        if steps.size == 1:
            return np.repeat(steps, times.size)
        columns = structured_to_unstructured(steps)
        inside = np.clip(times, steps["time"][0], self.end)
        trail: Trail = unstructured_to_structured(PchipInterpolator(steps["time"], columns)(inside), MOTION)
        trail["time"] = times
        if not self.is_resting:
            acceleration = self.body.gravity - steps["force"] / self.body.mass
            trail["velocity"] = CubicHermiteSpline(steps["time"], steps["velocity"], acceleration)(inside)
            trail["position"] = CubicHermiteSpline(steps["time"], steps["position"], steps["velocity"])(inside)
            trail["approach"] = trail["surface"] = trail["position"] - trail["plate_displacement"]
        return trail


Segment = Flight | Contact | Curves


def course(segments: list[Segment], times: Floats | None) -> Trail:
    """Put the segments one behind the other; each begins where the one before it ends.

    ``times`` (time,): where to evaluate; None takes every step of a contact and samples the flights.
    """
    parts, start, last = [], -np.inf, len(segments) - 1
    for i, segment in enumerate(segments):
        if times is None:
            records = segment.natural()
            if isinstance(segment, Flight):  # without the ends that the neighbours bring
                records = records[(0 if i == 0 else 1) : (None if i == last else -1)]
            parts.append(records)
            continue
        end = np.inf if i == last else segment.end
        wanted = times[(times >= start) & (times < end)]
        start = end
        if wanted.size:
            parts.append(segment.at(wanted))
    return np.concatenate(parts)

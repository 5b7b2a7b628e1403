"""From the segments of a drop to records over time: samples in flight, values at given times.

A drop is a list of segments: the fall, contacts, flights, and rest. Between steps the position
comes from cubic Hermite interpolation of position and speed, which is the motion in flight exactly;
force, contact radius and energies from monotone cubic interpolation, so that none leaves the range
of its steps.
"""

from dataclasses import dataclass

import numpy as np
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
    """A flight from its start; everything in it is known in closed form.

    ``start``: the instant it begins, without force; ``end`` [s]; ``stored`` (element,) [J] and ``dent`` (element,) [m]:
    energy of each element of the memory, and its displacement at the pole, at the start; ``rate`` (element,) [1/s]:
    how fast the elements recover.
    """

    start: Motion
    end: float
    stored: Floats
    dent: Floats
    rate: Floats

    def natural(self, body: Setting, *, is_first: bool, is_last: bool) -> Trail:
        """Sample it without the ends that the neighbours bring."""
        times = np.linspace(self.start.time, self.end, _FLIGHT_SAMPLES + 2)
        return self.at(times[(0 if is_first else 1) : (None if is_last else -1)], body)

    def at(self, times: Floats, body: Setting) -> Trail:
        """Return records (time,) at times [s]."""
        start, s, trail = self.start, times - self.start.time, np.zeros(times.size, MOTION)
        trail["time"], trail["velocity"] = times, start.velocity + body.gravity * s
        trail["approach"] = trail["position"] = start.position + (start.velocity + 0.5 * body.gravity * s) * s
        trail["surface"] = np.exp(-s[:, None] * self.rate) @ self.dent
        trail["stored"] = np.exp(-2.0 * s[:, None] * self.rate) @ self.stored
        trail["spring_work"], trail["plate_loss"] = start.spring_work, start.plate_loss
        if body.plate is not None:
            first = PlateState(start.plate_displacement, start.plate_velocity, start.plate_acceleration)
            state = body.plate.free(first, s)
            trail["plate_displacement"], trail["plate_velocity"], trail["plate_acceleration"] = state
            trail["approach"] -= state.displacement
            trail["plate_loss"] += body.plate.energy(first) - body.plate.energy(state)
        return trail


@dataclass(frozen=True, slots=True)
class Contact:
    """The recorded steps of a contact, from touch to lift-off, or of the creep at rest.

    A contact that was collocated is known at every instant, as ``curves``.
    """

    records: Trail
    is_resting: bool = False
    curves: Curves | None = None

    @property
    def end(self) -> float:
        """Time of the last step in s."""
        return float(self.records["time"][-1])

    def natural(self, body: Setting, *, is_first: bool, is_last: bool) -> Trail:
        """Return every step; rest begins with the last instant of the contact before it, which is left out."""
        return self.records[1:] if self.is_resting else self.records

    def at(self, times: Floats, body: Setting) -> Trail:
        """Return records (time,) at times [s]."""
        if self.curves is not None:
            return self.curves.at(times)
        steps = self.records
        if steps.size == 1:
            return np.repeat(steps, times.size)
        columns = {name: steps[name] for name in Motion.__annotations__}
        inside, trail = np.clip(times, self.records["time"][0], self.end), np.zeros(times.size, MOTION)
        monotone = PchipInterpolator(columns["time"], np.stack(list(columns.values()), axis=1))(inside).T
        for name, values in zip(columns, monotone, strict=True):
            trail[name] = values
        trail["time"] = times
        if not self.is_resting:
            acceleration = body.gravity - columns["force"] / body.mass
            motion = CubicHermiteSpline(columns["time"], columns["position"], columns["velocity"])(inside)
            trail["velocity"] = CubicHermiteSpline(columns["time"], columns["velocity"], acceleration)(inside)
            trail["position"] = motion
            trail["approach"] = trail["surface"] = motion - trail["plate_displacement"]
        return trail


Segment = Flight | Contact


def course(segments: list[Segment], body: Setting, times: Floats | None) -> Trail:
    """Put the segments one behind the other; each begins where the one before it ends.

    ``body``: mass, gravity and plate. ``times`` (time,): where to evaluate; None takes every step of a contact and
    samples the flights.
    """
    parts, start = [], -np.inf
    for i, segment in enumerate(segments):
        is_last = i == len(segments) - 1
        if times is None:
            parts.append(segment.natural(body, is_first=i == 0, is_last=is_last))
        else:
            end = np.inf if is_last else segment.end
            wanted = times[(times >= start) & (times < end)]
            start = end
            if wanted.size:
                parts.append(segment.at(wanted, body))
    return np.concatenate(parts)

"""From the segments of a drop to columns over time: samples in flight, values at given times.

A drop is a list of segments: the fall, contacts, flights, and rest. Between steps the position
comes from cubic Hermite interpolation of position and speed, which is the motion in flight exactly;
force, contact radius and energies from monotone cubic interpolation, so that none leaves the range
of its steps.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from labpipe.arrays import Floats
from labpipe.contact.impact._bounce import Curves
from labpipe.contact.impact._motion import Motion, Trail
from labpipe.contact.impact._plate import Plate, PlateState
from labpipe.contact.impact._setting import Setting

# Samples of a flight when no times are asked for: enough for a smooth parabola.
_FLIGHT_SAMPLES = 24


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight from its start; everything in it is known in closed form.

    ``start``: the instant it begins, without force; ``end`` [s]; ``stored`` (element,) [J]: energy that each element of
    the memory holds at the start; ``dent`` (element,) [m]: displacement that each element leaves at the pole at the
    start; ``rate`` (element,) [1/s]: how fast the elements recover.
    """

    start: Motion
    end: float
    stored: Floats
    dent: Floats
    rate: Floats


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


Segment = Flight | Contact


class Columns(NamedTuple):
    """Values over time (time,) in SI; lengths downwards positive."""

    time: Floats
    position: Floats
    velocity: Floats
    approach: Floats
    surface: Floats
    force: Floats
    contact_radius: Floats
    stored: Floats
    spring_work: Floats
    plate_displacement: Floats
    plate_energy: Floats
    plate_loss: Floats


def columns(segments: list[Segment], body: Setting, times: Floats | None) -> Columns:
    """Put the segments one behind the other.

    ``segments``: In order; each begins where the one before it ends. ``body``: mass, gravity and plate. ``times``
    (time,): Where to evaluate; None takes every step of a contact and samples the flights.
    """
    parts = []
    start = -np.inf
    for i, segment in enumerate(segments):
        is_last = i == len(segments) - 1
        if times is None:
            parts.append(_natural(segment, body, is_first=i == 0, is_last=is_last))
        else:
            end = np.inf if is_last else segment.end
            wanted = times[(times >= start) & (times < end)]
            start = end
            if wanted.size:
                parts.append(_at(segment, body, wanted))
    return Columns(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def record_columns(records: Trail, plate: Plate | None) -> Columns:
    """Turn records into columns."""
    energy = np.zeros(records.size)
    if plate is not None:
        energy = plate.energy(PlateState(records["plate_displacement"], records["plate_velocity"]))
    derived = ("plate_energy", "surface")
    known = {name: records[name] for name in Columns._fields if name not in derived}
    # In contact the pole lies on the substrate: its surface has moved by the approach.
    return Columns(plate_energy=energy, surface=records["approach"], **known)


def _natural(segment: Segment, body: Setting, *, is_first: bool, is_last: bool) -> Columns:
    """Every step; of a flight, samples without the ends that its neighbours bring."""
    if isinstance(segment, Contact):
        # Rest begins with the last instant of the contact before it.
        records = segment.records[1:] if segment.is_resting else segment.records
        return record_columns(records, body.plate)
    times = np.linspace(segment.start.time, segment.end, _FLIGHT_SAMPLES + 2)
    return _at(segment, body, times[(0 if is_first else 1) : (None if is_last else -1)])


def _at(segment: Segment, body: Setting, times: Floats) -> Columns:
    if isinstance(segment, Flight):
        return _of_flight(segment, times, body)
    return _of_contact(segment, times, body)


def _of_flight(flight: Flight, times: Floats, body: Setting) -> Columns:
    start = flight.start
    s = times - start.time
    position = start.position + (start.velocity + 0.5 * body.gravity * s) * s
    zero = np.zeros_like(s)
    displacement, energy, loss = zero, zero, zero
    if body.plate is not None:
        first = PlateState(start.plate_displacement, start.plate_velocity, start.plate_acceleration)
        state = body.plate.free(first, s)
        displacement, energy = state.displacement, body.plate.energy(state)
        loss = body.plate.energy(first) - energy
    return Columns(
        time=times,
        position=position,
        velocity=start.velocity + body.gravity * s,
        approach=position - displacement,
        surface=np.exp(-s[:, None] * flight.rate) @ flight.dent,
        force=zero,
        contact_radius=zero,
        stored=np.exp(-2.0 * s[:, None] * flight.rate) @ flight.stored,
        spring_work=zero + start.spring_work,
        plate_displacement=displacement,
        plate_energy=energy,
        plate_loss=start.plate_loss + loss,
    )


def _of_contact(contact: Contact, times: Floats, body: Setting) -> Columns:
    if contact.curves is not None:
        return record_columns(contact.curves.at(times), body.plate)
    steps = record_columns(contact.records, body.plate)
    if steps.time.size == 1:
        return Columns(*(np.repeat(column, times.size) for column in steps))
    inside = np.clip(times, steps.time[0], steps.time[-1])
    monotone = PchipInterpolator(steps.time, np.stack(steps, axis=1))(inside).T
    result = Columns(*monotone)
    if contact.is_resting:
        return result._replace(time=times)
    motion = CubicHermiteSpline(steps.time, steps.position, steps.velocity)(inside)
    acceleration = body.gravity - steps.force / body.mass
    speed = CubicHermiteSpline(steps.time, steps.velocity, acceleration)(inside)
    approach = motion - result.plate_displacement
    return result._replace(time=times, position=motion, velocity=speed, approach=approach, surface=approach)


def peak(time: Floats, values: Floats) -> float:
    """Largest value, refined by the parabola through its neighbours."""
    i = int(np.argmax(values))
    if not 0 < i < values.size - 1:
        return float(values[i])
    before, after = time[i - 1] - time[i], time[i + 1] - time[i]
    low, high = values[i - 1] - values[i], values[i + 1] - values[i]
    curvature = (high / after - low / before) / (after - before)
    slope = low / before - curvature * before
    if curvature >= 0.0:
        return float(values[i])
    return float(values[i] - slope**2 / (4.0 * curvature))

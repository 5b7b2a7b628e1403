"""The first impacts of all drops of one material: its tables, and room to compute in, made once."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.contact.impact._bounce import FIRST, LONGEST, STEP_SHARE
from labpipe.contact.impact._collocation import distinct, law_of, scheme, work_space
from labpipe.contact.impact._contact import LIFTED, contact, outcome_of
from labpipe.contact.impact._contact_records import Fall, Law, Nodes, Path, Room
from labpipe.contact.impact._dataset import Setting
from labpipe.contact.impact._flight import time_to_touch
from labpipe.contact.impact._plate import PlateState, modal
from labpipe.contact.impact._setup import Scales, scales
from labpipe.contact.impact._simulate import CONDENSE_SHARE, SLOWEST_BOUNCE
from labpipe.contact.memory import Creep, condense

#: Columns of an impact, by their names in the result.
COLUMNS = (
    "impact_time",
    "lift_off_time",
    "impact_speed",
    "rebound_speed",
    "peak_force",
    "peak_contact_radius",
    "peak_approach",
    "penetration",
)


class Followed(NamedTuple):
    """Impacts of many drops.

    ``rows`` (drop, impact, column): By :data:`COLUMNS`, times from the release; NaN for what does not happen.
    ``work`` (drop, 3): Steps, rejected steps, impacts. ``is_left`` (drop,): Whether the drop holds a contact that has
    to be stepped, or more of an error than allowed.
    """

    rows: Floats
    work: Integers
    is_left: Flags


class _Tables(NamedTuple):
    """What the drops of a material share."""

    law: Law
    path: Path
    room: Room
    nodes: Nodes


def follow(creep: Creep, settings: Sequence[Setting], most: int, energy_limit: float, *, fold: bool) -> Followed:
    """Follow the first impacts of drops of one material and tolerance.

    Each drop is one of ``settings`` and lasts ``most`` impacts at most; ``energy_limit`` is what it may mislay over the
    energy of the fall, and ``fold`` leaves terms out as :func:`drop` does, those that no drop needs.

    Notes
    -----
    Each contact is one compiled call, of which the way in and out is a tenth. A loop over all drops
    in compiled code saved no more than that, and took twice as long to compile.
    """
    expected = [scales(creep, one.radius, one.mass, one.gravity, one.speed) for one in settings]
    if fold:
        shortest = min(scale.duration for scale in expected)
        longest = max(one.duration for one in settings)
        creep = condense(creep, shortest, longest, CONDENSE_SHARE * settings[0].rtol).creep
    law = law_of(distinct(creep))
    tables = _Tables(law, *work_space(law))
    found = Followed(
        np.full((len(settings), most, len(COLUMNS)), np.nan),
        np.zeros((len(settings), 3), np.int64),
        np.ones(len(settings), bool),
    )
    for i, (one, scale) in enumerate(zip(settings, expected, strict=True)):
        # What is at the limits is left to the general solver: it refines, or refuses in words.
        if scale.radius <= one.radius:
            error = _train(tables, one, scale, found.rows[i], found.work[i])
            found.is_left[i] = not error <= energy_limit
    return found


def _train(tables: _Tables, one: Setting, scale: Scales, rows: Floats, work: Integers) -> float:
    """Follow the impacts of a drop, as many as there are rows.

    Return the largest energy mislaid over that of the drop; NaN if the sphere stays, or touches
    twice in one contact.
    """
    law, path, room, nodes = tables
    until, clock, position, velocity = one.duration - one.fall_time, 0.0, 0.0, one.speed
    state, centre, dent = PlateState(), np.zeros(law.elements), np.zeros_like(nodes.after[: law.elements])
    outer = lost = deepest = error = 0.0
    peaks = np.zeros(5)
    for i, row in enumerate(rows):
        tolerance = STEP_SHARE * one.rtol * max(velocity, SLOWEST_BOUNCE * scale.rest_speed)
        steps = tolerance, LONGEST * scale.duration, FIRST * scale.duration
        fall = Fall(one.mass, one.gravity, one.radius, one.profile == "sphere", *modal(one.plate), *steps)
        origin = position - state.displacement - float(centre.sum())
        path.state[0] = position - origin, velocity, 0.0, 0.0, state.displacement, state.velocity, 0.0, 0.0
        path.approach[0] = 0.0
        has_more = i + 1 < len(rows)
        outcome, n, peak, rejected = contact(law, scheme(), fall, centre, dent, outer, 0, path, room, nodes, has_more)
        work += n, rejected, outcome == LIFTED
        outer = float(path.state[peak, 3])
        if outcome != LIFTED or outer > one.radius:
            return np.nan
        worst = outcome_of(scheme(), fall, path, n, room, lost, peaks)
        end = path.state[n]
        force, approach, depth, sunk, lost = peaks.tolist()
        deepest = max(deepest, approach + origin + depth)
        error = max(error, worst / (one.mass * one.gravity * max(one.height, deepest)))
        lift_off = clock + float(path.time[n])
        if lift_off >= until:
            return error
        row[:] = clock, lift_off, velocity, -end[1], force, outer, approach + origin, sunk + origin - position
        row[:2] += one.fall_time
        if not has_more:
            return error
        position, velocity, state = float(end[0]) + origin, float(end[1]), PlateState(float(end[4]), float(end[5]))
        left, rate = nodes.after[: law.elements], law.creep_rate[: law.elements]
        flight = time_to_touch(velocity, one.gravity, left[:, -1].copy(), rate, one.plate, state)
        if flight <= 0.0:
            return np.nan
        clock = lift_off + flight
        if clock >= until:
            return error
        left = np.exp(-flight * rate)[:, None] * left
        centre = left[:, -1].copy()
        dent = left - centre[:, None]
        position += (velocity + 0.5 * one.gravity * flight) * flight
        velocity += one.gravity * flight
        state = one.plate.free(state, flight) if one.plate else state
    return error

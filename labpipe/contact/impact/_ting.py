"""One contact of a falling sphere by collocation, compiled: touch, advance, recede, lift-off.

While springs are loaded their Maxwell elements differ by a decaying exponential only, so that force and contact radius
follow from functions of time: the approach, its fading integral per relaxation term, and the state of the springs where
the phase began, a polynomial over the radius. This is Ting's solution [1]_, also on a surface with dents. Motion and
force are collocated at Radau's points [2]_; the fading integrals are exact for the polynomial through the stages.
Lengths are counted from the free motion of the spring at the centre, where all dents vanish.

References
----------
.. [1] T. C. T. Ting, J. Appl. Mech. 33 (1966) 845, doi:10.1115/1.3625192
.. [2] E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), section IV.5,
   doi:10.1007/978-3-642-05221-7
"""

import math

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean
from labpipe.contact._stepping import AT_LIFT_OFF, GROW, MARGIN, SHRINK
from labpipe.contact.impact import _radau as radau
from labpipe.contact.impact._radau import NODES, TO_POWERS, crossing, power_sum, slope
from labpipe.contact.impact._records import N_NODES, STAGES, Fall, Law, Phase, Room

# How a contact ends.
LIFTED, TURNED, FAILED, FULL = range(4)
# Columns of the state, and those to subtract, of which the largest values are reported.
NOTHING, POSITION, VELOCITY, FORCE, EDGE, PLATE = range(-1, 5)
_LOOKED_AT = ((FORCE, NOTHING), (POSITION, PLATE), (POSITION, NOTHING))
# Looks for the largest force within a step.
_LOOKS = 16
# The contact is largest where it grows slower than this part of its mean growth; an error of the
# instant counts with its square.
_AT_SUMMIT = 1e-5
# It may be called over where the load of the central spring has fallen to this part, and no step gets nearer.
_NEARLY_LIFTED = 1e-6
# Attempts at one step; where the edge is first looked for.
_TRIES, _FIRST_PLACE = 60, 0.2


@inner()
def _edge_powers(room: Room, phase: Phase) -> None:
    """Fill in ``short``: coefficients of what ends the phase: the square of the radius, then the central load."""
    found = room.short
    for p in range(STAGES):
        found[p] = 0.0
        for m in range(STAGES):
            change = room.bulk[m] - phase.bulk if phase.recedes else room.edge[m] ** 2 - phase.start_edge
            found[p] += TO_POWERS[p, m] * change


@inner()
def _begin(law: Law, room: Room) -> None:
    """Set what a contact has gathered to nothing, and prepare its dents."""
    for k in range(law.elements):
        room.last[k] = 0.0
        for m in range(N_NODES):
            room.primitive[k, m] = radau.dot(radau.MEANS[m], room.dent[k])
        room.rim[k] = room.dent[k, 0]
    room.time[0] = 0.0
    for j in range(law.maxwells):
        room.fading[0, j] = room.held[j] = 0.0


@inner()
def _shorter(room: Room, phase: Phase, error: float) -> float:
    """Part of a step with too large an error to try next."""
    shorter = max(SHRINK, MARGIN * max(error, 1.0) ** (-1.0 / (STAGES + 1.0)))
    if phase.recedes and error < radau.UNSOLVED and room.bulk[STAGES - 1] < 0.0:
        # What lies behind the lift-off says nothing on the step before it.
        _edge_powers(room, phase)
        lifted = crossing(room.short[:], -phase.bulk, 1.0)
        shorter = min(max(shorter, lifted), MARGIN)
    return shorter


@inner()
def _event(room: Room, n: int, h: float, phase: Phase, central: float) -> tuple[float, bool]:
    """Part of a step at which the phase ends, 1 if not, negative if it grows again; and whether that is its end."""
    if phase.recedes:
        if room.bulk[STAGES - 1] <= AT_LIFT_OFF * central:
            _edge_powers(room, phase)
            part = crossing(room.short[:], -phase.bulk, 1.25)
            return part, abs(part - 1.0) < 1e-9
        return (-1.0 if room.edge[STAGES - 1] <= phase.start_edge else 1.0), False
    # Over the square of the radius that a steady growth would add in this step.
    steady = room.edge[STAGES - 1] ** 2 * h / (room.time[n] + h)
    _edge_powers(room, phase)
    rise = slope(room.short[:], 1.0) / steady
    if rise > _AT_SUMMIT:
        return 1.0, False
    return radau.summit(room.short[:]), abs(rise) <= _AT_SUMMIT


@inner()
def sample_touch(law: Law, room: Room, peak: int, outer: float) -> None:
    """Note for each node when it was touched, and its Maxwell elements less the fading integral."""
    largest = room.state[peak, 3]
    step = 0
    for n in range(N_NODES - 1, -1, -1):
        square = largest**2 * (1.0 - NODES[n] ** 2)
        while step < peak - 1 and room.state[step + 1, 3] ** 2 < square:
            step += 1
        u, h = 1.0, room.time[step + 1] - room.time[step]
        if n == N_NODES - 1:
            u = 0.0
        elif n > 0:
            u = crossing(room.edge_powers[step], square - room.state[step, 3] ** 2, 1.0)
        time = room.time[step] + u * h
        room.touch[n] = time
        radau.fade(law, room.fading[step], h, u, room.powers[step], room.node_fading, room.short)
        inside = 0.0 if outer <= 0.0 else 1.0 - square / outer**2
        s = math.sqrt(inside) if inside > 0.0 else 0.0
        for k in range(law.elements):
            room.before[k, n] = 0.0
            if outer > 0.0:
                room.before[k, n] = radau.value_at(room.dent[k], s)
        for j in range(law.maxwells):
            total = -room.node_fading[j]
            if outer > 0.0:
                for k in range(law.elements):
                    total += law.mixed[j, k] * room.before[k, n] * math.exp(-law.creep_rate[k] * time)
            room.node_base[j, n] = total


@inner()
def _kelvin(law: Law, displacement: float, maxwell: Floats, load: float, out: Floats) -> None:
    """Kelvin elements (element,) of a spring from its Maxwell elements."""
    rest = displacement - law.instantaneous * load
    for k in range(law.elements):
        if law.is_liquid and k == law.elements - 1:
            out[k] = rest
            return
        total = law.E_relaxed * displacement
        for j in range(law.maxwells):
            total += law.E[j] * law.mixed[j, k] * maxwell[j]
        out[k] = law.C[k] * total
        rest -= out[k]


@inner()
def sample_release(law: Law, fall: Fall, room: Room, peak: int, last: int) -> None:
    """Note for each node when it lets go, and its Kelvin elements then."""
    largest = room.state[peak, 3]
    step, reached = peak, 0.0
    for n in range(N_NODES):
        place = NODES[n]
        while step < last - 1 and reached + power_sum(room.edge_powers[step], 1.0) < place:
            reached += power_sum(room.edge_powers[step], 1.0)
            step += 1
        u, h = 1.0, room.time[step + 1] - room.time[step]
        if n == 0:
            u = 0.0
        elif n < N_NODES - 1:
            u = crossing(room.edge_powers[step], place - reached, 1.0)
        time = room.time[step] + u * h
        room.release[n] = time
        radau.fade(law, room.fading[step], h, u, room.powers[step], room.node_fading, room.short)
        x = largest * math.sqrt(max(1.0 - place**2, 0.0))
        depth = room.approach[step] + power_sum(room.powers[step], u) - radau.gap(fall, x)
        for j in range(law.maxwells):
            room.node_fading[j] += room.node_base[j, n] * math.exp(-law.rate[j] * (time - room.touch[n]))
        _kelvin(law, depth, room.node_fading, 0.0, room.element)
        for k in range(law.elements):
            room.after[k, n] = room.element[k]


@inner()
def store(law: Law, fall: Fall, room: Room, last: int, largest: float) -> None:
    """Energy held by the springs within the largest contact at the end of every step."""
    for i in range(last + 1):
        time, total = room.time[i], 0.0
        for n in range(N_NODES):
            load = 0.0
            if time < room.touch[n] or (time == room.touch[n] and n == 0):
                for k in range(law.elements):
                    room.element[k] = room.before[k, n] * math.exp(-law.creep_rate[k] * time)
            elif time < room.release[n]:
                x = largest * math.sqrt(max(1.0 - NODES[n] ** 2, 0.0))
                depth = room.approach[i] - radau.gap(fall, x)
                load = law.E_relaxed * depth
                for j in range(law.maxwells):
                    left = math.exp(-law.rate[j] * (time - room.touch[n]))
                    room.node_fading[j] = room.fading[i, j] + room.node_base[j, n] * left
                    load += law.E[j] * room.node_fading[j]
                _kelvin(law, depth, room.node_fading, load, room.element)
            else:
                for k in range(law.elements):
                    left = math.exp(-law.creep_rate[k] * (time - room.release[n]))
                    room.element[k] = room.after[k, n] * left
            energy = 0.5 * law.instantaneous * load**2
            for k in range(law.kelvins):
                whole = room.element[k] + room.center[k] * math.exp(-law.creep_rate[k] * time)
                energy += 0.5 * whole**2 / law.C[k]
            total += radau.MEANS[0, n] * largest * energy
        room.stored[i] = total


@inner()
def recover(law: Law, room: Room, last: int) -> None:
    """Let the springs recover from their release to the end of the contact, and count from the undeformed surface."""
    for n in range(N_NODES):
        for k in range(law.elements):
            left = math.exp(-law.creep_rate[k] * (room.time[last] - room.release[n]))
            room.after[k, n] *= left
            room.after[k, n] += room.center[k] * math.exp(-law.creep_rate[k] * room.time[last])


@inner()
def _turn(law: Law, room: Room, peak: int, outer: float) -> float:
    """Sample the springs where the contact is largest; return the load of the central one."""
    sample_touch(law, room, peak, outer)
    load = law.E_relaxed * room.approach[peak]
    for j in range(law.maxwells):
        for m in range(N_NODES):
            left = math.exp(-law.rate[j] * (room.time[peak] - room.touch[m]))
            room.node_field[j, m] = room.node_base[j, m] * left
        load += law.E[j] * (room.node_field[j, N_NODES - 1] + room.fading[peak, j])
    return load


@lean()
def contact(law: Law, fall: Fall, outer: float, room: Room, has_energy: bool) -> tuple[int, int, int, int]:
    """Follow one contact from touch to lift-off.

    ``room`` holds the start: ``state[0]``, ``approach[0]``, ``center`` and ``dent``, whose edge is ``outer`` [m], 0
    on a fresh surface; the rest of it is filled. Returns how it ended, and the steps taken, until the contact was
    largest, and rejected.
    """
    dented = outer > 0.0
    n, peak, rejected, tries = 0, 0, 0, 0
    _begin(law, room)
    phase = Phase(False, dented, 0.0, outer, 0.0, 0.0, 0.0)
    h, central = fall.first, 0.0
    while True:
        if n + 1 >= room.time.size:
            return FULL, n, peak, rejected
        h = min(h, fall.longest)
        is_tiny = tries > _TRIES or not h > 1e-16 * (room.time[n] + 1e-3 * fall.first)
        if phase.recedes and phase.bulk <= (_NEARLY_LIFTED if is_tiny else AT_LIFT_OFF) * central:
            break
        if is_tiny:
            return FAILED, n, peak, rejected
        tries += 1
        error = radau.attempt(law, fall, room, n, h, phase)
        if not error <= 1.0:
            rejected += 1
            h *= _shorter(room, phase, error)
            continue
        part, ends = _event(room, n, h, phase, central)
        if part < 0.0:
            return TURNED, n, peak, rejected
        was_summit = not phase.recedes and part < 1e-4 and n > 0
        if part != 1.0 and not ends and not was_summit:
            h *= part
            continue
        tries = 0
        if not was_summit:
            radau.accept(law, fall, room, n, h, phase)
            n += 1
        if phase.recedes and ends:
            break
        edge, load = room.edge[STAGES - 1], room.bulk[STAGES - 1]
        if phase.recedes:
            phase = Phase(True, False, phase.begin, phase.outer, edge, edge, load)
        elif ends or was_summit:
            peak = n
            central = _turn(law, room, peak, outer)
            if not central > 0.0:  # a plate that draws back has unloaded the centre before the rim
                return TURNED, n, peak, rejected
            phase = Phase(True, False, room.time[n], room.state[n, 3], _FIRST_PLACE, 0.0, central)
        else:
            phase = Phase(False, dented, 0.0, outer, edge, edge**2, load)
        h *= min(GROW, MARGIN * max(error, 1e-12) ** (-1.0 / (STAGES + 1.0)))
    room.state[n, 2] = room.state[n, 3] = 0.0
    sample_release(law, fall, room, peak, n)
    if has_energy:
        store(law, fall, room, n, room.state[peak, 3])
    recover(law, room, n)
    return LIFTED, n, peak, rejected


@inner()
def _largest(room: Room, n: int, column: int, less: int, short: Floats) -> float:
    """Largest value over a contact of a column of the state, or of its difference to another."""
    best = 0.0
    for step in range(n):
        start = room.state[step, column] - (room.state[step, less] if less >= 0 else 0.0)
        for p in range(STAGES):
            short[p] = 0.0
        for m in range(STAGES):
            value = room.stages[step, m, column] - (room.stages[step, m, less] if less >= 0 else 0.0)
            for p in range(STAGES):
                short[p] += TO_POWERS[p, m] * (value - start)
        for look in range(_LOOKS):
            low, high = look / _LOOKS, (look + 1) / _LOOKS
            best = max(best, start + power_sum(short, high))
            if slope(short, low) > 0.0 and slope(short, high) < 0.0:
                best = max(best, start + power_sum(short, radau.maximum_between(short, low, high)))
    return best


@lean()
def peaks_of(room: Room, n: int, peaks: Floats) -> None:
    """Fill in the largest force [N], approach and position [m] (3,) of a contact of ``n`` steps."""
    for i in range(3):  # a constant column would be compiled for itself
        peaks[i] = _largest(room, n, _LOOKED_AT[i][0], _LOOKED_AT[i][1], room.short[:])

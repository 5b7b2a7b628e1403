"""One contact of a falling sphere by collocation, compiled: touch, advance, recede, lift-off.

The row of springs is never stepped. While springs are loaded their Maxwell elements differ by a
decaying exponential only, so that force and contact radius follow from functions of time: the
approach, its fading integral per relaxation term, and the state of the springs where the phase
began, a polynomial over the radius. This is Ting's solution [1]_, also on a surface with dents.

Motion and force are collocated at Radau's points [2]_; the fading integrals are exact for the
polynomial through the stages, however stiff the terms.

Lengths are counted from the free motion of the spring at the centre, which touches first: all dents
are differences to it and vanish there.

References
----------
.. [1] T. C. T. Ting, J. Appl. Mech. 33 (1966) 845, doi:10.1115/1.3625192
.. [2] E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), section IV.5,
   doi:10.1007/978-3-642-05221-7
"""

import math
from typing import NamedTuple, Protocol

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean

# How a contact ends.
LIFTED, TURNED, FAILED, FULL = range(4)
# Looks for the largest force within a step; at a ringing plate within a period.
_LOOKS, _LOOKS_PER_PERIOD = 16, 32
# Halvings of a bracket, more than a number has digits.
_HALVINGS = 200
# A bounce is not sought at a smaller part of the time of the parabola.
_SHORTEST_FLIGHT = 1e-290
STAGES = 5
_NEWTON_LIMIT = 12
_EDGE_LIMIT = 60
# The contact is largest where it grows slower than this part of its mean growth; an error of the
# instant counts with its square.
_AT_SUMMIT = 1e-5
# It is over where the load of the central spring has fallen to this part of its largest.
_AT_LIFT_OFF = 1e-10
# It may be called over here where no step gets nearer.
_NEARLY_LIFTED = 1e-6
# Attempts at one step; the error of one that was not solved; where the edge is first looked for.
_TRIES, _UNSOLVED, _FIRST_PLACE = 60, 1e9, 0.2
_GROWTH, _SHRINK, _SAFETY = 4.0, 0.2, 0.85


class Law(NamedTuple):
    """Contact law of the material in both forms.

    ``E_relaxed`` [Pa], ``E`` [Pa] and ``rate`` [1/s] (maxwell,) of the relaxation modulus;
    ``instantaneous`` [1/Pa], ``C`` [1/Pa] and ``creep_rate`` [1/s] (element,) of the compliance, a
    dashpot last with rate 0; ``mixed`` (maxwell, element) is the displacement of a Maxwell element
    per displacement of a Kelvin element while the spring is free.
    """

    E_relaxed: float
    E: Floats
    rate: Floats
    instantaneous: float
    C: Floats
    creep_rate: Floats
    mixed: Floats
    is_liquid: bool


class Scheme(Protocol):
    """Constants of the method: Radau's points, and polynomials over the radius.

    What is handed on is one record with these fields: a single address to compiled code, where nine
    arrays are some sixty arguments of each call.

    ``c`` (stage,), ``a`` (stage, stage) and its square ``aa``; ``to_powers`` (stage, stage) from
    values less the first to the coefficients of u, u^2, ...; ``gamma`` (stage + 1,) of the error.
    Fields over the radius are polynomials in s = sqrt(1 - (x / edge)^2), held at the nodes ``s``
    (node,) with barycentric weights ``bary``; ``slope`` (node, node) differentiates over s,
    ``means`` (node, node) gives twice the mean from the centre to each node.
    """

    c: Floats
    a: Floats
    aa: Floats
    to_powers: Floats
    gamma: Floats
    s: Floats
    bary: Floats
    slope: Floats
    means: Floats


class Fall(NamedTuple):
    """What falls onto what; the plate's numbers are 0 on a rigid flat; ``is_sphere`` the profile."""

    mass: float
    gravity: float
    radius: float
    is_sphere: bool
    plate_mass: float
    plate_stiffness: float
    plate_damping: float
    tolerance: float
    longest: float
    first: float


class Path(NamedTuple):
    """Room for the steps of a contact, and what is known of each.

    ``time`` (step + 1,) from touch; ``state`` (step + 1, 8) at the ends and ``stages`` (step,
    stage, 6) inside: position, velocity, force, contact radius, displacement and velocity of the
    plate, and at the ends what its dashpot took and the work on the springs; ``approach`` (step + 1,)
    at the ends and ``powers`` (step, stage) its coefficients over u from 0 to 1; ``edge`` (step,
    stage) those of the square of the radius while it advances, of s while it recedes; ``fading``
    (step + 1, maxwell) the fading integral of the approach; ``stored`` (step + 1,) energy.
    """

    time: Floats
    state: Floats
    stages: Floats
    approach: Floats
    powers: Floats
    edge: Floats
    fading: Floats
    stored: Floats


class Phase(NamedTuple):
    """While the contact grows, or shrinks: since ``begin`` [s], over a field out to ``outer`` [m].

    At the start of the step: ``edge`` where the edge is looked for, ``start_edge`` where it is (as
    in ``Path.edge``), ``bulk`` twice the area under the springs or the load of the central spring.
    """

    recedes: bool
    dented: bool
    begin: float
    outer: float
    edge: float
    start_edge: float
    bulk: float


class Nodes(NamedTuple):
    """What is sampled on the nodes of the largest contact of this bounce.

    ``touch`` and ``release`` (node,) [s]; ``before`` (element, node) the dents found, ``after`` the
    displacement of the elements left; ``base`` (maxwell, node) that of Maxwell elements less the
    fading integral at touch, ``field`` the same where the contact began to shrink; room for one.
    """

    touch: Floats
    release: Floats
    before: Floats
    after: Floats
    base: Floats
    field: Floats
    fading: Floats
    element: Floats


class Room(NamedTuple):
    """Numbers of the step at hand.

    ``base`` (stage,) is the approach without force, ``answer`` (stage, stage) the approach per
    force; ``known`` (stage,) the force, or its density, that is left of the start; ``gain`` (stage,
    stage) that per approach; ``weight`` (maxwell, stage, power) of the fading integrals;
    ``field`` and ``slope`` (stage, node) the polynomial over the radius that the edge meets, and
    its derivative, ``area`` (stage, node) twice its mean; ``cross`` (stage, element, power) the
    force per change of the dents' moments; ``moment`` (stage, element) those moments.
    """

    base: Floats
    answer: Floats
    plate: Floats
    plate_free: Floats
    known: Floats
    gain: Floats
    weight: Floats
    field: Floats
    slope: Floats
    area: Floats
    table: Floats
    cross: Floats
    moment: Floats
    last: Floats
    rim: Floats
    primitive: Floats
    bulk: Floats
    delta: Floats
    force: Floats
    edge: Floats
    radius: Floats
    held: Floats
    matrix: Floats
    right: Floats
    short: Floats


@inner()
def _moments(z: float, out: Floats) -> None:
    """Integrals of u^p exp(-z (1 - u)) over u from 0 to 1, p = 0 ... (power,)."""
    n = out.size
    if z > 6.0:
        out[0] = -math.expm1(-z) / z
        for p in range(1, n):
            out[p] = (1.0 - p * out[p - 1]) / z
        return
    term = 1.0 / n
    total = term
    k = n
    while abs(term) > 1e-18:
        k += 1
        term *= -z / k
        total += term
    out[n - 1] = total
    for p in range(n - 1, 0, -1):
        out[p - 1] = (1.0 - z * out[p]) / p


@inner()
def gap(fall: Fall, x: float) -> float:
    """Approach at which an undeformed spring at ``x`` [m] touches."""
    if fall.is_sphere:
        return x * math.atanh(min(x / fall.radius, 0.999999))
    return x * x / fall.radius


@inner()
def _gap_area(fall: Fall, x: float) -> float:
    """Integral of the gap from the centre to ``x`` [m]."""
    r = fall.radius
    ratio = x / r
    if not fall.is_sphere or ratio < 1e-3:
        return x**3 / (3.0 * r) * (1.0 + (0.2 * ratio**2 if fall.is_sphere else 0.0))
    ratio = min(ratio, 0.999999)
    return 0.5 * r * r * ((ratio**2 - 1.0) * math.atanh(ratio) + ratio)


@inner()
def _inverse_gap(fall: Fall, depth: float) -> float:
    """Contact radius at which the gap is ``depth`` [m]."""
    if depth <= 0.0:
        return 0.0
    x = math.sqrt(fall.radius * depth)
    if fall.is_sphere:
        x = min(x, 0.99 * fall.radius)
        for _ in range(30):
            ratio = x / fall.radius
            slope = math.atanh(ratio) + ratio / (1.0 - ratio**2)
            change = (gap(fall, x) - depth) / slope
            x = min(x - change, 0.5 * (x + 0.999 * fall.radius))
            if abs(change) < 1e-15 * x:
                break
    return x


@inner()
def _at(scheme: Scheme, values: Floats, s: float) -> float:
    """Value at ``s`` of the polynomial with ``values`` (node,) at the nodes."""
    top = bottom = 0.0
    for n in range(scheme.s.size):
        away = s - scheme.s[n]
        if away == 0.0:
            return values[n]
        share = scheme.bary[n] / away
        top += share * values[n]
        bottom += share
    return top / bottom


@inner()
def _power_sum(coefficients: Floats, u: float) -> float:
    """Polynomial without constant term."""
    total = 0.0
    for p in range(coefficients.size - 1, -1, -1):
        total = (total + coefficients[p]) * u
    return total


@inner()
def _fade(start: Floats, rate: Floats, h: float, u: float, powers: Floats, out: Floats, room: Floats) -> None:
    """Fading integrals (maxwell,) a part ``u`` of a step on, from those at its start."""
    for j in range(rate.size):
        z = rate[j] * h * u
        _moments(z, room)
        total, power = 0.0, u
        for p in range(powers.size):
            total += (p + 1) * powers[p] * power * room[p]
            power *= u
        out[j] = math.exp(-z) * start[j] + total


@inner()
def _solve(matrix: Floats, right: Floats) -> None:
    """Gaussian elimination in place; the solution replaces ``right`` (stage, column)."""
    n = matrix.shape[0]
    for i in range(n):
        best = i
        for r in range(i + 1, n):
            if abs(matrix[r, i]) > abs(matrix[best, i]):
                best = r
        for c in range(n):
            matrix[i, c], matrix[best, c] = matrix[best, c], matrix[i, c]
        for c in range(right.shape[1]):
            right[i, c], right[best, c] = right[best, c], right[i, c]
        for r in range(i + 1, n):
            factor = matrix[r, i] / matrix[i, i]
            for c in range(i, n):
                matrix[r, c] -= factor * matrix[i, c]
            for c in range(right.shape[1]):
                right[r, c] -= factor * right[i, c]
    for i in range(n - 1, -1, -1):
        for c in range(right.shape[1]):
            for k in range(i + 1, n):
                right[i, c] -= matrix[i, k] * right[k, c]
            right[i, c] /= matrix[i, i]


@inner()
def _prepare(law: Law, scheme: Scheme, fall: Fall, center: Floats, path: Path, n: int, h: float, room: Room) -> None:
    """Fill in what a step from the end ``n`` knows without its force: motion and weights."""
    t, S = path.time[n], scheme.c.size
    now = path.state[n]
    for i in range(S):
        time = scheme.c[i] * h
        dent = 0.0
        for k in range(center.size):
            dent += center[k] * math.exp(-law.creep_rate[k] * (t + time))
        room.base[i] = now[0] + time * (now[1] + 0.5 * fall.gravity * time) - dent
        for m in range(S):
            room.answer[i, m] = h * h * scheme.aa[i, m] / fall.mass
    if fall.plate_mass > 0.0:
        _let_plate_answer(scheme, fall, now, h, room)
    _gain(law, scheme, h, room)


@inner()
def _let_plate_answer(scheme: Scheme, fall: Fall, now: Floats, h: float, room: Room) -> None:
    """Add the motion of the plate: free, and per force."""
    S = scheme.c.size
    for i in range(S):
        pull = fall.plate_damping * now[5] + fall.plate_stiffness * (now[4] + scheme.c[i] * h * now[5])
        for m in range(S):
            inertia = fall.plate_damping * h * scheme.a[i, m] + fall.plate_stiffness * h * h * scheme.aa[i, m]
            room.matrix[i, m] = inertia + (fall.plate_mass if i == m else 0.0)
            room.plate[i, m] = 1.0 if i == m else 0.0
        room.plate[i, S] = -pull
    _solve(room.matrix, room.plate)
    for i in range(S):
        room.plate_free[i] = now[4] + scheme.c[i] * h * now[5]
        for o in range(S):
            room.plate_free[i] += h * h * scheme.aa[i, o] * room.plate[o, S]
            for m in range(S):
                room.answer[i, m] += h * h * scheme.aa[i, o] * room.plate[o, m]
        room.base[i] -= room.plate_free[i]


@inner()
def _gain(law: Law, scheme: Scheme, h: float, room: Room) -> None:
    """Weights of the fading integrals, and the force per approach that they amount to."""
    S = scheme.c.size
    for j in range(law.E.size):
        for i in range(S):
            power = scheme.c[i]
            _moments(law.rate[j] * h * power, room.short)
            for p in range(S):
                room.weight[j, i, p] = (p + 1) * power * room.short[p]
                power *= scheme.c[i]
    for i in range(S):
        for m in range(S):
            room.gain[i, m] = 0.0
        for p in range(S):
            total = 0.0
            for j in range(law.E.size):
                total += law.E[j] * room.weight[j, i, p]
            for m in range(S):
                room.gain[i, m] += total * scheme.to_powers[p, m]


@inner()
def _spread(scheme: Scheme, room: Room, i: int) -> None:
    """Fill in derivative over s and twice the mean of the stage's field."""
    for n in range(scheme.s.size):
        slope = area = 0.0
        for m in range(scheme.s.size):
            slope += scheme.slope[n, m] * room.field[i, m]
            area += scheme.means[n, m] * room.field[i, m]
        room.slope[i, n] = slope
        room.area[i, n] = area


@inner()
def _dented_edge(scheme: Scheme, fall: Fall, room: Room, i: int, depth: float, outer: float, guess: float) -> float:
    """Radius where a surface with dents, out to ``outer``, lies at ``depth``; it rises outwards."""
    if depth <= 0.0:
        return 0.0
    low, high = 0.0, 0.999 * fall.radius
    x = min(max(guess, 1e-6 * outer), high)
    for _ in range(_EDGE_LIMIT):
        inside = 1.0 - (x / outer) ** 2
        s = math.sqrt(inside) if inside > 0.0 else 0.0
        rise = gap(fall, x) + _at(scheme, room.field[i], s) - depth
        slope = 2.0 * x / fall.radius
        if fall.is_sphere:
            slope = math.atanh(x / fall.radius) + x / fall.radius / (1.0 - (x / fall.radius) ** 2)
        if s > 1e-5:
            slope -= _at(scheme, room.slope[i], s) * x / (s * outer**2)
        if rise > 0.0:
            high = x
        else:
            low = x
        step = rise / slope if slope > 0.0 else 2.0 * high
        new = x - step
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-15 * x:
            return new
        x = new
    return x


@inner()
def _receding_edge(
    law: Law, scheme: Scheme, fall: Fall, room: Room, i: int, depth: float, density: float, outer: float, guess: float
) -> float:
    """Place s where the load is 0; 1 when there is none left."""
    last = scheme.s.size - 1
    if law.E_relaxed * depth + room.field[i, last] + density <= 0.0:
        return 1.0
    low, high, s = 0.0, 1.0, guess
    for _ in range(_EDGE_LIMIT):
        x = outer * math.sqrt(max(1.0 - s * s, 0.0))
        load = law.E_relaxed * (depth - gap(fall, x)) + _at(scheme, room.field[i], s) + density
        slope = 2.0 * s * outer**2 / fall.radius
        if fall.is_sphere and x > 0.0:
            ratio = x / fall.radius
            slope = (math.atanh(ratio) + ratio / (1.0 - ratio**2)) * s * outer**2 / x
        slope = law.E_relaxed * slope + _at(scheme, room.slope[i], s)
        if load > 0.0:
            high = s
        else:
            low = s
        new = s - load / slope if slope > 0.0 else 2.0
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - s) <= 1e-15:
            return new
        s = new
    return s


@inner()
def _advance_force(
    law: Law, scheme: Scheme, fall: Fall, room: Room, time: float, h: float, bulk: float, outer: float, dented: bool
) -> None:
    """Force at the stages of an advancing contact, from the approaches there."""
    S = scheme.c.size
    for i in range(S):
        depth = room.delta[i]
        if dented:
            room.edge[i] = _dented_edge(scheme, fall, room, i, depth, outer, room.edge[i])
        else:
            room.edge[i] = _inverse_gap(fall, depth)
        x = room.edge[i]
        room.bulk[i] = 2.0 * (x * depth - _gap_area(fall, x))
    for i in range(S):
        total = law.E_relaxed * room.bulk[i] + room.known[i]
        for m in range(S):
            total += room.gain[i, m] * (room.bulk[m] - bulk)
        room.force[i] = total
    if dented:
        _add_dents(law, scheme, room, time, h, outer)


@inner()
def _add_dents(law: Law, scheme: Scheme, room: Room, time: float, h: float, outer: float) -> None:
    """Add what the springs held when the edge reached them, integrated over time by parts."""
    S, K = scheme.c.size, law.creep_rate.size
    for i in range(S):
        x = room.edge[i]
        inside = 1.0 - (x / outer) ** 2
        s = math.sqrt(inside) if inside > 0.0 else 0.0
        for k in range(K):
            edge_value = 0.0
            if inside < 0.0:
                edge_value = 2.0 * (x - outer) * room.rim[k]
            room.moment[i, k] = min(x, outer) * _at(scheme, room.primitive[k], s) + edge_value
    for k in range(K):
        rate = law.creep_rate[k]
        start = math.exp(-rate * time)
        for i in range(S):
            total = math.exp(-rate * (time + scheme.c[i] * h)) * room.moment[i, k] - start * room.last[k]
            for m in range(S):
                fresh = math.exp(-rate * (time + scheme.c[m] * h))
                total += h * scheme.a[i, m] * rate * fresh * room.moment[m, k]
            room.cross[i, k] = total
    for i in range(S):
        for k in range(K):
            for m in range(S):
                room.force[i] += room.table[i, k, m] * room.cross[m, k]


@inner()
def _recede_force(law: Law, scheme: Scheme, fall: Fall, room: Room, start: float, outer: float) -> None:
    """Force at the stages of a receding contact, from the approaches there."""
    S = scheme.c.size
    for i in range(S):
        density = room.known[i]
        for m in range(S):
            density += room.gain[i, m] * (room.delta[m] - start)
        depth = room.delta[i]
        s = _receding_edge(law, scheme, fall, room, i, depth, density, outer, room.edge[i])
        room.edge[i] = s
        x = outer * math.sqrt(max(1.0 - s * s, 0.0))
        room.radius[i] = x
        room.bulk[i] = law.E_relaxed * depth + room.field[i, scheme.s.size - 1] + density
        room.force[i] = 0.0
        if s < 1.0:
            elastic = 2.0 * law.E_relaxed * (x * depth - _gap_area(fall, x))
            room.force[i] = elastic + x * (_at(scheme, room.area[i], s) + 2.0 * density)


@inner()
def _differentiate(law: Law, scheme: Scheme, room: Room, phase: Phase) -> None:
    """Fill in the derivative of the miss of each stage; the load at the edge is 0 and adds none."""
    S = scheme.c.size
    for i in range(S):
        for m in range(S):
            total = 1.0 if i == m else 0.0
            x = room.radius[m] if phase.recedes else room.edge[m]
            for o in range(S):
                width = room.radius[o] if phase.recedes else x
                total += room.answer[i, o] * room.gain[o, m] * 2.0 * width
            room.matrix[i, m] = total + room.answer[i, m] * law.E_relaxed * 2.0 * x


@inner()
def _newton(law: Law, scheme: Scheme, fall: Fall, room: Room, path: Path, n: int, h: float, phase: Phase) -> bool:
    """Solve for the approaches at the stages: motion against force."""
    S = scheme.c.size
    time, start = path.time[n], path.approach[n]
    for i in range(S):
        push = 0.0
        for m in range(S):
            push += room.answer[i, m]
        room.delta[i] = room.base[i] - push * path.state[n, 2]
        room.edge[i] = phase.edge
    scale = 0.0
    for _ in range(_NEWTON_LIMIT):
        if phase.recedes:
            _recede_force(law, scheme, fall, room, start, phase.outer)
        else:
            _advance_force(law, scheme, fall, room, time, h, phase.bulk, phase.outer, phase.dented)
        for i in range(S):
            miss = room.delta[i] - room.base[i]
            for m in range(S):
                miss += room.answer[i, m] * room.force[m]
            room.right[i, 0] = miss
        _differentiate(law, scheme, room, phase)
        _solve(room.matrix, room.right)
        change = 0.0
        for i in range(S):
            room.delta[i] -= room.right[i, 0]
            change = max(change, abs(room.right[i, 0]))
            scale = max(scale, abs(room.delta[i]))
        if not change < 1e300:
            return False
        if change <= 1e-14 * scale:
            return True
    return change <= 1e-10 * scale


@inner()
def _fields(law: Law, scheme: Scheme, room: Room, path: Path, n: int, h: float, phase: Phase, dent: Floats) -> None:
    """Fill in the field that the edge meets at each stage, and what is left of the start."""
    S, N = scheme.c.size, scheme.s.size
    count = law.E.size if phase.recedes else law.creep_rate.size
    for i in range(S):
        time = path.time[n] + scheme.c[i] * h
        for m in range(N):
            room.field[i, m] = 0.0
        if phase.recedes or phase.dented:
            for k in range(count):
                if phase.recedes:
                    factor = law.E[k] * math.exp(-law.rate[k] * (time - phase.begin))
                else:
                    factor = math.exp(-law.creep_rate[k] * time)
                for m in range(N):
                    room.field[i, m] += factor * dent[k, m]
            _spread(scheme, room, i)
        room.known[i] = 0.0
        for j in range(law.E.size):
            left = math.exp(-law.rate[j] * scheme.c[i] * h)
            held = path.fading[n, j] if phase.recedes else room.held[j]
            room.known[i] += law.E[j] * left * held
    if phase.dented and not phase.recedes:
        _cross(law, scheme, room)


@inner()
def _cross(law: Law, scheme: Scheme, room: Room) -> None:
    """Force per change of the dents' moments."""
    S = scheme.c.size
    for i in range(S):
        for k in range(law.creep_rate.size):
            for m in range(S):
                room.table[i, k, m] = 0.0
            for p in range(S):
                total = 0.0
                for j in range(law.E.size):
                    total += law.E[j] * room.weight[j, i, p] * (law.mixed[j, k] - 1.0)
                for m in range(S):
                    room.table[i, k, m] += total * scheme.to_powers[p, m]


@inner()
def _accept(law: Law, scheme: Scheme, fall: Fall, room: Room, path: Path, n: int, h: float, phase: Phase) -> None:
    """Write the step behind the end ``n`` down."""
    S = scheme.c.size
    now, new = path.state[n], path.state[n + 1]
    path.time[n + 1] = path.time[n] + h
    path.approach[n + 1] = room.delta[S - 1]
    work = loss = 0.0
    for i in range(S):
        u, values = scheme.c[i], path.stages[n, i]
        z = now[0] + u * h * (now[1] + 0.5 * fall.gravity * u * h)
        v = now[1] + fall.gravity * u * h
        for m in range(S):
            z -= h * h * scheme.aa[i, m] * room.force[m] / fall.mass
            v -= h * scheme.a[i, m] * room.force[m] / fall.mass
        values[0], values[1], values[2] = z, v, room.force[i]
        values[3] = room.radius[i] if phase.recedes else room.edge[i]
        values[4] = values[5] = 0.0
        if fall.plate_mass > 0.0:
            _move_plate(scheme, room, now, i, h, values)
        share = h * scheme.a[S - 1, i]
        work += share * room.force[i] * (v - values[5])
        loss += share * fall.plate_damping * values[5] ** 2
    for column in range(6):
        new[column] = path.stages[n, S - 1, column]
    new[6], new[7] = now[6] + loss, now[7] + work
    for p in range(S):
        path.powers[n, p] = path.edge[n, p] = 0.0
        for m in range(S):
            path.powers[n, p] += scheme.to_powers[p, m] * (room.delta[m] - path.approach[n])
            edge = room.edge[m] if phase.recedes else room.edge[m] ** 2
            path.edge[n, p] += scheme.to_powers[p, m] * (edge - phase.start_edge)
    _fade_on(law, scheme, room, path, n, h, phase)


@inner()
def _move_plate(scheme: Scheme, room: Room, now: Floats, i: int, h: float, values: Floats) -> None:
    """Fill in displacement and velocity of the plate at a stage."""
    S = scheme.c.size
    place, pace = room.plate_free[i], now[5]
    for o in range(S):
        pushed = 0.0
        for m in range(S):
            pushed += room.plate[o, m] * room.force[m]
        place += h * h * scheme.aa[i, o] * pushed
        pace += h * scheme.a[i, o] * (room.plate[o, S] + pushed)
    values[4], values[5] = place, pace


@inner()
def _fade_on(law: Law, scheme: Scheme, room: Room, path: Path, n: int, h: float, phase: Phase) -> None:
    """Bring the fading integrals to the end of a step."""
    S, K = scheme.c.size, law.creep_rate.size
    for j in range(law.E.size):
        left = math.exp(-law.rate[j] * h)
        path.fading[n + 1, j] = left * path.fading[n, j]
        for p in range(S):
            path.fading[n + 1, j] += room.weight[j, S - 1, p] * path.powers[n, p]
        if phase.recedes:
            continue
        room.held[j] *= left
        for m in range(S):
            change = room.bulk[m] - phase.bulk
            if phase.dented:
                for k in range(K):
                    change += (law.mixed[j, k] - 1.0) * room.cross[m, k]
            for p in range(S):
                room.held[j] += room.weight[j, S - 1, p] * scheme.to_powers[p, m] * change
    if phase.dented and not phase.recedes:
        for k in range(K):
            room.last[k] = room.moment[S - 1, k]


@inner()
def _slope(coefficients: Floats, u: float) -> float:
    total = 0.0
    for p in range(coefficients.size - 1, -1, -1):
        total = total * u + (p + 1) * coefficients[p]
    return total


@inner()
def _crossing(coefficients: Floats, value: float, highest: float) -> float:
    """First u up to ``highest`` at which the polynomial, rising or falling to it, has a value."""
    rises = value > 0.0
    low = high = 0.0
    for look in range(1, 9):
        high = highest * look / 8.0
        if (_power_sum(coefficients, high) >= value) == rises:
            break
        low = high
    for _ in range(50):
        middle = 0.5 * (low + high)
        if (_power_sum(coefficients, middle) >= value) == rises:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


@inner()
def _summit(coefficients: Floats) -> float:
    """Part u of the step at which the polynomial first stops rising; 1 when it does not."""
    low, high = 0.0, 1.0
    for look in range(1, 17):
        high = look / 16.0
        if _slope(coefficients, high) <= 0.0:
            break
        low = high
    if low == 1.0:
        return 1.0
    for _ in range(45):
        middle = 0.5 * (low + high)
        if _slope(coefficients, middle) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inner()
def _edge_powers(scheme: Scheme, room: Room, phase: Phase, of_load: bool) -> None:
    """Fill in ``short``: coefficients over the step of the edge, or of the load of the central spring."""
    found = room.short
    for p in range(scheme.c.size):
        found[p] = 0.0
        for m in range(scheme.c.size):
            if of_load:
                change = room.bulk[m] - phase.bulk
            else:
                change = (room.edge[m] if phase.recedes else room.edge[m] ** 2) - phase.start_edge
            found[p] += scheme.to_powers[p, m] * change


@inner()
def _sample_touch(
    law: Law, scheme: Scheme, fall: Fall, room: Room, path: Path, peak: int, dent: Floats, outer: float, nodes: Nodes
) -> None:
    """Note for each node when it was touched, and its Maxwell elements less the fading integral."""
    K, J, N = law.creep_rate.size, law.E.size, scheme.s.size
    largest = path.state[peak, 3]
    step = 0
    for n in range(N - 1, -1, -1):
        square = largest**2 * (1.0 - scheme.s[n] ** 2)
        while step < peak - 1 and path.state[step + 1, 3] ** 2 < square:
            step += 1
        u, h = 1.0, path.time[step + 1] - path.time[step]
        if n == N - 1:
            u = 0.0
        elif n > 0:
            u = _crossing(path.edge[step], square - path.state[step, 3] ** 2, 1.0)
        time = path.time[step] + u * h
        nodes.touch[n] = time
        _fade(path.fading[step], law.rate, h, u, path.powers[step], nodes.fading, room.short)
        inside = 0.0 if outer <= 0.0 else 1.0 - square / outer**2
        s = math.sqrt(inside) if inside > 0.0 else 0.0
        for k in range(K):
            nodes.before[k, n] = 0.0
            if outer > 0.0:
                nodes.before[k, n] = _at(scheme, dent[k], s)
        for j in range(J):
            total = -nodes.fading[j]
            if outer > 0.0:
                for k in range(K):
                    total += law.mixed[j, k] * nodes.before[k, n] * math.exp(-law.creep_rate[k] * time)
            nodes.base[j, n] = total


@inner()
def _kelvin(law: Law, displacement: float, maxwell: Floats, load: float, out: Floats) -> None:
    """Kelvin elements (element,) of a spring from its Maxwell elements."""
    K = law.creep_rate.size
    rest = displacement - law.instantaneous * load
    for k in range(K):
        if law.is_liquid and k == K - 1:
            out[k] = rest
            return
        total = law.E_relaxed * displacement
        for j in range(law.E.size):
            total += law.E[j] * law.mixed[j, k] * maxwell[j]
        out[k] = law.C[k] * total
        rest -= out[k]


@inner()
def _sample_release(
    law: Law, scheme: Scheme, fall: Fall, room: Room, path: Path, peak: int, last: int, nodes: Nodes
) -> None:
    """Note for each node when it lets go, and its Kelvin elements then."""
    N = scheme.s.size
    largest = path.state[peak, 3]
    step, reached = peak, 0.0
    for n in range(N):
        place = scheme.s[n]
        while step < last - 1 and reached + _power_sum(path.edge[step], 1.0) < place:
            reached += _power_sum(path.edge[step], 1.0)
            step += 1
        u, h = 1.0, path.time[step + 1] - path.time[step]
        if n == 0:
            u = 0.0
        elif n < N - 1:
            u = _crossing(path.edge[step], place - reached, 1.0)
        time = path.time[step] + u * h
        nodes.release[n] = time
        _fade(path.fading[step], law.rate, h, u, path.powers[step], nodes.fading, room.short)
        x = largest * math.sqrt(max(1.0 - place**2, 0.0))
        depth = path.approach[step] + _power_sum(path.powers[step], u) - gap(fall, x)
        for j in range(law.E.size):
            nodes.fading[j] += nodes.base[j, n] * math.exp(-law.rate[j] * (time - nodes.touch[n]))
        _kelvin(law, depth, nodes.fading, 0.0, nodes.element)
        for k in range(law.creep_rate.size):
            nodes.after[k, n] = nodes.element[k]


@inner()
def _store(
    law: Law, scheme: Scheme, fall: Fall, center: Floats, path: Path, last: int, largest: float, nodes: Nodes
) -> None:
    """Energy held by the springs within the largest contact at the end of every step."""
    N, K = scheme.s.size, law.creep_rate.size
    for i in range(last + 1):
        time, total = path.time[i], 0.0
        for n in range(N):
            load = 0.0
            if time < nodes.touch[n] or (time == nodes.touch[n] and n == 0):
                for k in range(K):
                    nodes.element[k] = nodes.before[k, n] * math.exp(-law.creep_rate[k] * time)
            elif time < nodes.release[n]:
                x = largest * math.sqrt(max(1.0 - scheme.s[n] ** 2, 0.0))
                depth = path.approach[i] - gap(fall, x)
                load = law.E_relaxed * depth
                for j in range(law.E.size):
                    left = math.exp(-law.rate[j] * (time - nodes.touch[n]))
                    nodes.fading[j] = path.fading[i, j] + nodes.base[j, n] * left
                    load += law.E[j] * nodes.fading[j]
                _kelvin(law, depth, nodes.fading, load, nodes.element)
            else:
                for k in range(K):
                    left = math.exp(-law.creep_rate[k] * (time - nodes.release[n]))
                    nodes.element[k] = nodes.after[k, n] * left
            energy = 0.5 * law.instantaneous * load**2
            for k in range(law.C.size):
                whole = nodes.element[k] + center[k] * math.exp(-law.creep_rate[k] * time)
                energy += 0.5 * whole**2 / law.C[k]
            total += scheme.means[0, n] * largest * energy
        path.stored[i] = total
    for n in range(N):
        for k in range(K):
            left = math.exp(-law.creep_rate[k] * (path.time[last] - nodes.release[n]))
            nodes.after[k, n] *= left
            nodes.after[k, n] += center[k] * math.exp(-law.creep_rate[k] * path.time[last])


@inner()
def _begin(law: Law, scheme: Scheme, room: Room, path: Path, n: int, dent: Floats) -> None:
    """Set what a contact has gathered to nothing, and prepare its dents."""
    for k in range(law.creep_rate.size):
        room.last[k] = 0.0
        for m in range(scheme.s.size):
            total = 0.0
            for o in range(scheme.s.size):
                total += scheme.means[m, o] * dent[k, o]
            room.primitive[k, m] = total
        room.rim[k] = dent[k, 0]
    path.time[n] = 0.0
    for j in range(law.E.size):
        path.fading[n, j] = room.held[j] = 0.0


@inner()
def _attempt(
    law: Law,
    scheme: Scheme,
    fall: Fall,
    center: Floats,
    room: Room,
    path: Path,
    n: int,
    h: float,
    phase: Phase,
    field: Floats,
) -> float:
    """Solve for one step; return its error over what is allowed.

    It is what the polynomial through the stages misses of the force at the start.
    """
    _prepare(law, scheme, fall, center, path, n, h, room)
    _fields(law, scheme, room, path, n, h, phase, field)
    if not _newton(law, scheme, fall, room, path, n, h, phase):
        return _UNSOLVED
    error = scheme.gamma[0] * path.state[n, 2]
    for i in range(scheme.c.size):
        error += scheme.gamma[i + 1] * room.force[i]
    return abs(error) * h / (fall.mass * fall.tolerance)


@inner()
def _shorter(scheme: Scheme, room: Room, phase: Phase, error: float) -> float:
    """Part of a step with too large an error to try next."""
    S = scheme.c.size
    shorter = max(_SHRINK, _SAFETY * max(error, 1.0) ** (-1.0 / (S + 1.0)))
    if phase.recedes and error < _UNSOLVED and room.bulk[S - 1] < 0.0:
        # What lies behind the lift-off says nothing on the step before it.
        _edge_powers(scheme, room, phase, True)
        lifted = _crossing(room.short, -phase.bulk, 1.0)
        shorter = min(max(shorter, lifted), _SAFETY)
    return shorter


@inner()
def _event(
    scheme: Scheme, room: Room, path: Path, n: int, h: float, phase: Phase, central: float
) -> tuple[float, bool]:
    """Part of a step at which the phase ends, 1 when it does not, and whether that is its end.

    Negative when a contact that receded grows again.
    """
    S = scheme.c.size
    if phase.recedes:
        if room.bulk[S - 1] <= _AT_LIFT_OFF * central:
            _edge_powers(scheme, room, phase, True)
            part = _crossing(room.short, -phase.bulk, 1.25)
            return part, abs(part - 1.0) < 1e-9
        return (-1.0 if room.edge[S - 1] <= phase.start_edge else 1.0), False
    # Over the square of the radius that a steady growth would add in this step.
    steady = room.edge[S - 1] ** 2 * h / (path.time[n] + h)
    _edge_powers(scheme, room, phase, False)
    rise = _slope(room.short, 1.0) / steady
    if rise > _AT_SUMMIT:
        return 1.0, False
    return _summit(room.short), abs(rise) <= _AT_SUMMIT


@inner()
def _turn(
    law: Law, scheme: Scheme, fall: Fall, room: Room, path: Path, peak: int, dent: Floats, outer: float, nodes: Nodes
) -> float:
    """Sample the springs where the contact is largest; return the load of the central one."""
    _sample_touch(law, scheme, fall, room, path, peak, dent, outer, nodes)
    load = law.E_relaxed * path.approach[peak]
    for j in range(law.E.size):
        for m in range(scheme.s.size):
            left = math.exp(-law.rate[j] * (path.time[peak] - nodes.touch[m]))
            nodes.field[j, m] = nodes.base[j, m] * left
        load += law.E[j] * (nodes.field[j, scheme.s.size - 1] + path.fading[peak, j])
    return load


@lean()
def contact(
    law: Law,
    scheme: Scheme,
    fall: Fall,
    center: Floats,
    dent: Floats,
    outer: float,
    n: int,
    path: Path,
    room: Room,
    nodes: Nodes,
    has_ledger: bool,
) -> tuple[int, int, int, int]:
    """Follow one contact from touch to lift-off.

    Parameters
    ----------
    law, scheme, fall
        Material, method and body.
    center : array (element,) [m]
        Displacement of the central spring at touch.
    dent : array (element, node) [m]
        Those of the others less the central one's, on the nodes out to ``outer`` [m]; 0 there when
        the surface is fresh.
    n : int
        Where in the path to begin.
    path, room, nodes
        Filled; ``path.state[n]`` and ``path.approach[n]`` hold the start.
    has_ledger : bool
        Sample the dent and fill in the stored energy.

    Returns
    -------
    (int, int, int, int)
        How it ended, the steps taken, those until the contact was largest, and rejected ones.
    """
    dented = outer > 0.0
    peak, rejected = n, n - n
    tries = rejected
    _begin(law, scheme, room, path, n, dent)
    phase = Phase(False, dented, 0.0, outer, 0.0, 0.0, 0.0)
    h, field, central = fall.first, dent, 0.0
    while True:
        if n + 1 >= path.time.size:
            return FULL, n, peak, rejected
        h = min(h, fall.longest)
        is_tiny = tries > _TRIES or not h > 1e-16 * (path.time[n] + 1e-3 * fall.first)
        if phase.recedes and phase.bulk <= (_NEARLY_LIFTED if is_tiny else _AT_LIFT_OFF) * central:
            break
        if is_tiny:
            return FAILED, n, peak, rejected
        tries += 1
        error = _attempt(law, scheme, fall, center, room, path, n, h, phase, field)
        if not error <= 1.0:
            rejected += 1
            h *= _shorter(scheme, room, phase, error)
            continue
        part, ends = _event(scheme, room, path, n, h, phase, central)
        if part < 0.0:
            return TURNED, n, peak, rejected
        was_summit = not phase.recedes and part < 1e-4 and n > 0
        if part != 1.0 and not ends and not was_summit:
            h *= part
            continue
        tries = n - n
        if not was_summit:
            _accept(law, scheme, fall, room, path, n, h, phase)
            n += 1
        if phase.recedes and ends:
            break
        edge, load = room.edge[scheme.c.size - 1], room.bulk[scheme.c.size - 1]
        if phase.recedes:
            phase = Phase(True, False, phase.begin, phase.outer, edge, edge, load)
        elif ends or was_summit:
            peak = n
            central = _turn(law, scheme, fall, room, path, peak, dent, outer, nodes)
            field = nodes.field
            phase = Phase(True, False, path.time[n], path.state[n, 3], _FIRST_PLACE, 0.0, central)
        else:
            phase = Phase(False, dented, 0.0, outer, edge, edge**2, load)
        h *= min(_GROWTH, _SAFETY * max(error, 1e-12) ** (-1.0 / (scheme.c.size + 1.0)))
    path.state[n, 2] = path.state[n, 3] = 0.0
    if has_ledger:
        _sample_release(law, scheme, fall, room, path, peak, n, nodes)
        _store(law, scheme, fall, center, path, n, path.state[peak, 3], nodes)
    return LIFTED, n, peak, rejected


@inner()
def _fallen(velocity: float, gravity: float, dent: Floats, rate: Floats, time: float) -> float:
    """Approach [m] gained since lift-off over a recovering dent, on ground that stands still."""
    gained = (velocity + 0.5 * gravity * time) * time
    for k in range(rate.size):
        gained -= math.expm1(-rate[k] * time) * dent[k]
    return gained


@inner()
def _touch_of_dent(velocity: float, gravity: float, dent: Floats, rate: Floats) -> float:
    """Time of flight on rigid ground; 0 when the surface follows."""
    high = -2.0 * velocity / gravity
    low = 1e-3 * high
    while _fallen(velocity, gravity, dent, rate, low) >= 0.0:
        low *= 1e-3
        if low < _SHORTEST_FLIGHT * high:
            return 0.0
    if _fallen(velocity, gravity, dent, rate, high) <= 0.0:
        return high
    time = high
    for _ in range(_HALVINGS):
        over = _fallen(velocity, gravity, dent, rate, time)
        if over > 0.0:
            high = time
        else:
            low = time
        slope = velocity + gravity * time
        for k in range(rate.size):
            slope += rate[k] * math.exp(-rate[k] * time) * dent[k]
        new = time - over / slope if slope > 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - time) <= 4e-16 * time:
            break
        time = new
    return time


@inner()
def _swing_free(fall: Fall, u: float, w: float, time: float) -> tuple[float, float]:
    """Displacement and velocity of the plate, left alone for a time [s]."""
    omega = math.sqrt(fall.plate_stiffness / fall.plate_mass)
    rate = 0.5 * fall.plate_damping / fall.plate_mass
    damped = math.sqrt(max(omega**2 - rate**2, 0.0))
    left, c, s = math.exp(-rate * time), math.cos(damped * time), math.sin(damped * time)
    place = left * (u * c + (w + rate * u) / damped * s)
    return place, left * (w * c - (rate * w + omega**2 * u) / damped * s)


@inner()
def _reach(fall: Fall, u: float, w: float) -> float:
    """Largest displacement that the plate, left alone, can reach from now on."""
    return math.sqrt(fall.plate_mass / fall.plate_stiffness * w * w + u * u)


@inner()
def _over_plate(fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float, time: float) -> float:
    """How far the sphere, let alone, would have sunk into the surface on the plate."""
    return _fallen(velocity, fall.gravity, dent, rate, time) - (_swing_free(fall, u, w, time)[0] - u)


@inner()
def _touch_of_plate(fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float) -> float:
    """Time of flight above a ringing plate; -1 when the sphere does not come back, a defect.

    The plate is looked at so often that no touch is missed that lasts longer than a small part of
    its period, but only within reach of its swing, which only falls: a sphere above it is clear
    until it has fallen back.
    """
    look = 2.0 * math.pi * math.sqrt(fall.plate_mass / fall.plate_stiffness) / _LOOKS_PER_PERIOD
    rise = 2.0 * _reach(fall, u, w)
    longest = (-velocity + math.sqrt(velocity**2 + 2.0 * fall.gravity * rise)) / fall.gravity * 1.001
    start, end = 1e-9 * look, look
    while start < longest:
        if _over_plate(fall, velocity, dent, rate, u, w, end) > 0.0:
            while _over_plate(fall, velocity, dent, rate, u, w, start) >= 0.0:
                start *= 1e-2
                if start < _SHORTEST_FLIGHT * look:
                    return 0.0
            for _ in range(_HALVINGS):
                middle = 0.5 * (start + end)
                if not start < middle < end:
                    break
                if _over_plate(fall, velocity, dent, rate, u, w, middle) > 0.0:
                    end = middle
                else:
                    start = middle
            return end
        place, pace = _swing_free(fall, u, w, end)
        clear = u + _reach(fall, place, pace)
        if _fallen(velocity, fall.gravity, dent, rate, end) + clear < 0.0:
            low, high = end, longest
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                if not low < middle < high:
                    break
                if _fallen(velocity, fall.gravity, dent, rate, middle) + clear < 0.0:
                    low = middle
                else:
                    high = middle
            end = low
        start, end = end, end + look
    return -1.0


@lean()
def time_of_flight(fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float) -> float:
    """Time [s] from lift-off at a velocity [m/s] to the next touch.

    Parameters
    ----------
    fall : Fall
        What falls onto what.
    velocity : float [m/s]
        At lift-off, downwards positive.
    dent, rate : array (element,) [m], [1/s]
        Displacements of the elements of the central spring, and their rates of recovery.
    u, w : float [m], [m/s]
        Displacement and velocity of the plate.

    Returns
    -------
    float
        0 when the surface follows at once; negative when no touch was found, a defect.
    """
    parting = velocity - w
    for k in range(rate.size):
        parting += rate[k] * dent[k]
    if parting >= 0.0:
        return 0.0
    if fall.plate_mass > 0.0:
        return _touch_of_plate(fall, velocity, dent, rate, u, w)
    return _touch_of_dent(velocity, fall.gravity, dent, rate)


@inner()
def _largest(scheme: Scheme, path: Path, n: int, column: int, less: int, short: Floats) -> float:
    """Largest value over a contact of a column of the state, or of its difference to another."""
    S = scheme.c.size
    best = 0.0
    for step in range(n):
        start = path.state[step, column] - (path.state[step, less] if less >= 0 else 0.0)
        for p in range(S):
            short[p] = 0.0
        for m in range(S):
            value = path.stages[step, m, column] - (path.stages[step, m, less] if less >= 0 else 0.0)
            for p in range(S):
                short[p] += scheme.to_powers[p, m] * (value - start)
        for look in range(_LOOKS):
            low, high = look / _LOOKS, (look + 1) / _LOOKS
            best = max(best, start + _power_sum(short, high))
            if _slope(short, low) > 0.0 and _slope(short, high) < 0.0:
                for _ in range(50):
                    middle = 0.5 * (low + high)
                    if _slope(short, middle) > 0.0:
                        low = middle
                    else:
                        high = middle
                best = max(best, start + _power_sum(short, low))
    return best


@inner()
def _energy_lost(fall: Fall, path: Path, n: int, lost: float) -> tuple[float, float]:
    """Energy [J] that the motion has mislaid at lift-off, and the most on the way there."""
    first = path.state[0]
    most = abs(lost)
    now = lost
    for i in range(n + 1):
        end = path.state[i]
        now = lost + 0.5 * fall.mass * (end[1] ** 2 - first[1] ** 2) + end[6] + end[7]
        now -= fall.mass * fall.gravity * (end[0] - first[0])
        now += 0.5 * fall.plate_mass * (end[5] ** 2 - first[5] ** 2)
        now += 0.5 * fall.plate_stiffness * (end[4] ** 2 - first[4] ** 2)
        most = max(most, abs(now))
    return now, most


@lean()
def outcome_of(scheme: Scheme, fall: Fall, path: Path, n: int, room: Room, lost: float, row: Floats) -> float:
    """Fill in largest force, approach and energy mislaid, of a contact of ``n`` steps.

    Parameters
    ----------
    scheme, fall, path, room
        As :func:`contact` left them.
    n : int
        Steps.
    lost : float [J]
        Energy mislaid before.
    row : array (4,)
        Filled: largest force [N], approach [m] and plate's displacement [m], energy mislaid [J].

    Returns
    -------
    float
        The most energy mislaid on the way [J].
    """
    row[0] = _largest(scheme, path, n, 2, -1, room.short)
    row[1] = _largest(scheme, path, n, 0, 4, room.short)
    row[2] = _largest(scheme, path, n, 4, -1, room.short)
    row[3], most = _energy_lost(fall, path, n, lost)
    return most

"""One step of a contact by collocation, compiled: polynomials, the edge, and motion against force at Radau's points."""

import math

import numpy as np
from scipy.special import roots_jacobi

from labpipe.arrays import Floats
from labpipe.compilation import inner
from labpipe.contact.impact._records import N_NODES, STAGES, Fall, Law, Phase, Room

# Points of the rule that integrates a polynomial over the contact radius.
_GAUSS_POINTS = 80
# Part of the disagreement between the force and its polynomial that counts as error of a step.
_ERROR_SHARE = 0.02
_NEWTON_LIMIT = 12
#: Error of a step that was not solved.
UNSOLVED = math.inf

# Radau's points (stage,), and the weights (stage, stage) of integrals up to them; TO_POWERS (stage, stage) from values
# less the first to the coefficients of u, u^2, ...; GAMMA (stage + 1,) of the error.
POINTS = np.append(np.sort(0.5 * (roots_jacobi(STAGES - 1, 1.0, 0.0)[0] + 1.0)), 1.0)
_POWERS = np.arange(STAGES)
_VALUES = POINTS[:, None] ** _POWERS
WEIGHTS = (POINTS[:, None] ** (_POWERS + 1) / (_POWERS + 1)) @ np.linalg.inv(_VALUES)
TWICE = WEIGHTS @ WEIGHTS
TO_POWERS = np.linalg.inv(POINTS[:, None] ** (_POWERS + 1))
GAMMA = _ERROR_SHARE * np.append(1.0, -np.linalg.solve(_VALUES.T, np.eye(STAGES)[0]))
# Fields over the radius are polynomials in s = sqrt(1 - (x / edge)^2), held at the nodes (node,), with barycentric
# weights; SLOPE (node, node) differentiates over s, MEANS (node, node) gives twice the mean from the centre to each.
NODES = 0.5 * (1.0 - np.cos(math.pi * np.arange(N_NODES) / (N_NODES - 1)))
BARY: Floats = np.where(np.arange(N_NODES) % 2, -1.0, 1.0) * np.where(np.arange(N_NODES) % (N_NODES - 1), 1.0, 0.5)
SLOPE = BARY / BARY[:, None] / (NODES[:, None] - NODES + np.eye(N_NODES)) * (1.0 - np.eye(N_NODES))
SLOPE -= np.diag(SLOPE.sum(axis=1))


def interpolation(places: Floats) -> Floats:
    """Matrix (place, node) from values at the nodes to values at other places s."""
    away = places[:, None] - NODES
    is_node = away == 0.0
    weight = np.where(is_node.any(axis=1)[:, None], is_node, BARY / np.where(is_node, 1.0, away))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _means() -> Floats:
    """Matrix of MEANS; with x = edge cos(angle) and s = sin(angle) the integrand is smooth."""
    points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    mean = np.zeros((N_NODES, N_NODES))
    mean[-1, -1] = 2.0
    for n in range(N_NODES - 1):
        first = np.arcsin(NODES[n])
        half = 0.5 * (0.5 * math.pi - first)
        angle = first + half * (points + 1.0)
        mean[n] = 2.0 * (weights * half * np.sin(angle) @ interpolation(np.sin(angle))) / math.sqrt(1.0 - NODES[n] ** 2)
    return mean


MEANS = _means()


@inner()
def moments(z: float, out: Floats) -> None:
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
def value_at(values: Floats, s: float) -> float:
    """Value at ``s`` of the polynomial with ``values`` (node,) at the nodes."""
    top = bottom = 0.0
    for n in range(N_NODES):
        away = s - NODES[n]
        if away == 0.0:
            return values[n]
        share = BARY[n] / away
        top += share * values[n]
        bottom += share
    return top / bottom


@inner()
def dot(left: Floats, right: Floats) -> float:
    """Scalar product of two short rows."""
    total = 0.0
    for i in range(left.size):
        total += left[i] * right[i]
    return total


@inner()
def power_sum(coefficients: Floats, u: float) -> float:
    """Polynomial without constant term."""
    total = 0.0
    for p in range(coefficients.size - 1, -1, -1):
        total = (total + coefficients[p]) * u
    return total


@inner()
def fade(law: Law, start: Floats, h: float, u: float, powers: Floats, out: Floats, short: Floats) -> None:
    """Fading integrals (maxwell,) a part ``u`` of a step on, from those at its start."""
    for j in range(law.maxwells):
        z = law.rate[j] * h * u
        moments(z, short)
        total, power = 0.0, u
        for p in range(powers.size):
            total += (p + 1) * powers[p] * power * short[p]
            power *= u
        out[j] = math.exp(-z) * start[j] + total


@inner()
def eliminate(matrix: Floats, right: Floats) -> None:
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
def slope(coefficients: Floats, u: float) -> float:
    total = 0.0
    for p in range(coefficients.size - 1, -1, -1):
        total = total * u + (p + 1) * coefficients[p]
    return total


@inner()
def crossing(coefficients: Floats, value: float, highest: float) -> float:
    """First u up to ``highest`` at which the polynomial, rising or falling to it, has a value."""
    rises = value > 0.0
    low = high = 0.0
    for look in range(1, 9):
        high = highest * look / 8.0
        if (power_sum(coefficients, high) >= value) == rises:
            break
        low = high
    for _ in range(50):
        middle = 0.5 * (low + high)
        if (power_sum(coefficients, middle) >= value) == rises:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


@inner()
def maximum_between(coefficients: Floats, low: float, high: float) -> float:
    """Place of the maximum of the polynomial between a place where it rises and one where it does not."""
    for _ in range(50):
        middle = 0.5 * (low + high)
        if slope(coefficients, middle) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inner()
def summit(coefficients: Floats) -> float:
    """Part u of the step at which the polynomial first stops rising; 1 when it does not."""
    low, high = 0.0, 1.0
    for look in range(1, 17):
        high = look / 16.0
        if slope(coefficients, high) <= 0.0:
            break
        low = high
    return 1.0 if low == 1.0 else maximum_between(coefficients, low, high)


@inner()
def gap(fall: Fall, x: float) -> float:
    """Approach at which an undeformed spring at ``x`` [m] touches."""
    if fall.is_sphere:
        return x * math.atanh(min(x / fall.radius, 0.999999))
    return x * x / fall.radius


@inner()
def _steepness(fall: Fall, x: float) -> float:
    """Return the derivative of the gap by ``x``."""
    ratio = x / fall.radius
    return math.atanh(ratio) + ratio / (1.0 - ratio**2) if fall.is_sphere else 2.0 * ratio


@inner()
def gap_area(fall: Fall, x: float) -> float:
    """Integral of the gap from the centre to ``x`` [m]."""
    r = fall.radius
    ratio = x / r
    if not fall.is_sphere or ratio < 1e-3:
        return x**3 / (3.0 * r) * (1.0 + (0.2 * ratio**2 if fall.is_sphere else 0.0))
    ratio = min(ratio, 0.999999)
    return 0.5 * r * r * ((ratio**2 - 1.0) * math.atanh(ratio) + ratio)


@inner()
def advancing_edge(fall: Fall, room: Room, i: int, depth: float, outer: float, guess: float) -> float:
    """Radius where a surface with dents, out to ``outer``, lies at ``depth``; it rises outwards."""
    if depth <= 0.0:
        return 0.0
    if outer <= 0.0 and not fall.is_sphere:
        return math.sqrt(fall.radius * depth)
    low, high = 0.0, 0.999 * fall.radius
    x = min(max(guess, 1e-6 * outer), high)
    for _ in range(60):
        inside = 1.0 - (x / outer) ** 2
        s = math.sqrt(inside) if inside > 0.0 else 0.0
        rise = gap(fall, x) + value_at(room.field[i], s) - depth
        slope = _steepness(fall, x)
        if s > 1e-5:
            slope -= value_at(room.slope[i], s) * x / (s * outer**2)
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
def receding_edge(
    law: Law, fall: Fall, room: Room, i: int, depth: float, density: float, outer: float, guess: float
) -> float:
    """Place s where the load is 0; 1 when there is none left."""
    last = N_NODES - 1
    if law.E_relaxed * depth + room.field[i, last] + density <= 0.0:
        return 1.0
    low, high, s = 0.0, 1.0, guess
    for _ in range(60):
        x = outer * math.sqrt(max(1.0 - s * s, 0.0))
        load = law.E_relaxed * (depth - gap(fall, x)) + value_at(room.field[i], s) + density
        slope = 2.0 * s * outer**2 / fall.radius
        if fall.is_sphere and x > 0.0:
            slope = _steepness(fall, x) * s * outer**2 / x
        slope = law.E_relaxed * slope + value_at(room.slope[i], s)
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
def _let_plate_answer(fall: Fall, now: Floats, h: float, room: Room) -> None:
    """Add the motion of the plate: free, and per force."""
    for i in range(STAGES):
        pull = fall.plate_damping * now[5] + fall.plate_stiffness * (now[4] + POINTS[i] * h * now[5])
        for m in range(STAGES):
            inertia = fall.plate_damping * h * WEIGHTS[i, m] + fall.plate_stiffness * h * h * TWICE[i, m]
            room.matrix[i, m] = inertia + (fall.plate_mass if i == m else 0.0)
            room.plate[i, m] = 1.0 if i == m else 0.0
        room.plate[i, STAGES] = -pull
    eliminate(room.matrix[:], room.plate[:])  # of one type, whatever their shapes
    for i in range(STAGES):
        room.plate_free[i] = now[4] + POINTS[i] * h * now[5]
        for o in range(STAGES):
            room.plate_free[i] += h * h * TWICE[i, o] * room.plate[o, STAGES]
            for m in range(STAGES):
                room.answer[i, m] += h * h * TWICE[i, o] * room.plate[o, m]
        room.base[i] -= room.plate_free[i]


@inner()
def _prepare(law: Law, fall: Fall, room: Room, n: int, h: float) -> None:
    """Fill in the motion without force and per force of a step from the end ``n``, and the weights of its memory."""
    t = room.time[n]
    now = room.state[n]
    for i in range(STAGES):
        time = POINTS[i] * h
        dent = 0.0
        for k in range(law.elements):
            dent += room.center[k] * math.exp(-law.creep_rate[k] * (t + time))
        room.base[i] = now[0] + time * (now[1] + 0.5 * fall.gravity * time) - dent
        for m in range(STAGES):
            room.answer[i, m] = h * h * TWICE[i, m] / fall.mass
    if fall.plate_mass > 0.0:
        _let_plate_answer(fall, now, h, room)
    for j in range(law.maxwells):  # weights of the fading integrals, and the force per approach that they amount to
        for i in range(STAGES):
            power = POINTS[i]
            moments(law.rate[j] * h * power, room.short)
            for p in range(STAGES):
                room.weight[j, i, p] = (p + 1) * power * room.short[p]
                power *= POINTS[i]
    for i in range(STAGES):
        room.gain[i, :] = 0.0
        for p in range(STAGES):
            total = 0.0
            for j in range(law.maxwells):
                total += law.E[j] * room.weight[j, i, p]
            for m in range(STAGES):
                room.gain[i, m] += total * TO_POWERS[p, m]


@inner()
def _advance_force(law: Law, fall: Fall, room: Room, time: float, h: float, phase: Phase) -> None:
    """Force at the stages of an advancing contact, from the approaches there."""
    for i in range(STAGES):
        depth = room.delta[i]
        x = room.edge[i] = advancing_edge(fall, room, i, depth, phase.outer, room.edge[i])
        room.bulk[i] = 2.0 * (x * depth - gap_area(fall, x))
    for i in range(STAGES):
        total = law.E_relaxed * room.bulk[i] + room.known[i]
        for m in range(STAGES):
            total += room.gain[i, m] * (room.bulk[m] - phase.bulk)
        room.force[i] = total
    if phase.dented:
        _add_dents(law, room, time, h, phase.outer)


@inner()
def _add_dents(law: Law, room: Room, time: float, h: float, outer: float) -> None:
    """Add what the springs held when the edge reached them, integrated over time by parts."""
    for i in range(STAGES):
        x = room.edge[i]
        inside = 1.0 - (x / outer) ** 2
        s = math.sqrt(inside) if inside > 0.0 else 0.0
        for k in range(law.elements):
            edge_value = 0.0
            if inside < 0.0:
                edge_value = 2.0 * (x - outer) * room.rim[k]
            room.moment[i, k] = min(x, outer) * value_at(room.primitive[k], s) + edge_value
    for k in range(law.elements):
        rate = law.creep_rate[k]
        start = math.exp(-rate * time)
        for i in range(STAGES):
            total = math.exp(-rate * (time + POINTS[i] * h)) * room.moment[i, k] - start * room.last[k]
            for m in range(STAGES):
                fresh = math.exp(-rate * (time + POINTS[m] * h))
                total += h * WEIGHTS[i, m] * rate * fresh * room.moment[m, k]
            room.cross[i, k] = total
    for i in range(STAGES):
        for k in range(law.elements):
            room.force[i] += dot(room.table[i, k], room.cross[:, k])


@inner()
def _recede_force(law: Law, fall: Fall, room: Room, start: float, outer: float) -> None:
    """Force at the stages of a receding contact, from the approaches there."""
    for i in range(STAGES):
        density = room.known[i]
        for m in range(STAGES):
            density += room.gain[i, m] * (room.delta[m] - start)
        depth = room.delta[i]
        s = receding_edge(law, fall, room, i, depth, density, outer, room.edge[i])
        room.edge[i] = s
        x = outer * math.sqrt(max(1.0 - s * s, 0.0))
        room.radius[i] = x
        room.bulk[i] = law.E_relaxed * depth + room.field[i, N_NODES - 1] + density
        room.force[i] = 0.0
        if s < 1.0:
            elastic = 2.0 * law.E_relaxed * (x * depth - gap_area(fall, x))
            room.force[i] = elastic + x * (value_at(room.area[i], s) + 2.0 * density)


@inner()
def _newton(law: Law, fall: Fall, room: Room, n: int, h: float, phase: Phase) -> bool:
    """Solve for the approaches at the stages: motion against force."""
    time, start = room.time[n], room.approach[n]
    for i in range(STAGES):
        room.delta[i] = room.base[i] - room.answer[i].sum() * room.state[n, 2]
        room.edge[i] = phase.edge
    scale = 0.0
    for _ in range(_NEWTON_LIMIT):
        if phase.recedes:
            _recede_force(law, fall, room, start, phase.outer)
        else:
            _advance_force(law, fall, room, time, h, phase)
        for i in range(STAGES):
            room.right[i, 0] = room.delta[i] - room.base[i] + dot(room.answer[i], room.force[:])
        for i in range(STAGES):  # derivative of the miss; the load at the edge is 0 and adds none
            for m in range(STAGES):
                x = room.radius[m] if phase.recedes else room.edge[m]
                total = (1.0 if i == m else 0.0) + room.answer[i, m] * law.E_relaxed * 2.0 * x
                for o in range(STAGES):
                    width = room.radius[o] if phase.recedes else x
                    total += room.answer[i, o] * room.gain[o, m] * 2.0 * width
                room.matrix[i, m] = total
        eliminate(room.matrix[:], room.right[:])
        change = 0.0
        for i in range(STAGES):
            room.delta[i] -= room.right[i, 0]
            change = max(change, abs(room.right[i, 0]))
            scale = max(scale, abs(room.delta[i]))
        if not change < 1e300:
            return False
        if change <= 1e-14 * scale:
            return True
    return change <= 1e-10 * scale


@inner()
def _fields(law: Law, room: Room, n: int, h: float, phase: Phase) -> None:
    """Fill in the field that the edge meets at each stage, and what is left of the start."""
    count = law.maxwells if phase.recedes else law.elements
    for i in range(STAGES):
        time = room.time[n] + POINTS[i] * h
        room.field[i, :] = 0.0
        if phase.recedes or phase.dented:
            for k in range(count):
                if phase.recedes:
                    factor = law.E[k] * math.exp(-law.rate[k] * (time - phase.begin))
                else:
                    factor = math.exp(-law.creep_rate[k] * time)
                for m in range(N_NODES):
                    room.field[i, m] += factor * (room.node_field[k, m] if phase.recedes else room.dent[k, m])
            for n_node in range(N_NODES):  # derivative over s, and twice the mean from the centre
                room.slope[i, n_node] = dot(SLOPE[n_node], room.field[i])
                room.area[i, n_node] = dot(MEANS[n_node], room.field[i])
        room.known[i] = 0.0
        for j in range(law.maxwells):
            left = math.exp(-law.rate[j] * POINTS[i] * h)
            held = room.fading[n, j] if phase.recedes else room.held[j]
            room.known[i] += law.E[j] * left * held
        for k in range(law.elements if phase.dented and not phase.recedes else 0):
            room.table[i, k, :] = 0.0  # force per change of the dents' moments
            for p in range(STAGES):
                total = 0.0
                for j in range(law.maxwells):
                    total += law.E[j] * room.weight[j, i, p] * (law.mixed[j, k] - 1.0)
                for m in range(STAGES):
                    room.table[i, k, m] += total * TO_POWERS[p, m]


@inner()
def accept(law: Law, fall: Fall, room: Room, n: int, h: float, phase: Phase) -> None:
    """Write the step behind the end ``n`` down."""
    now, new = room.state[n], room.state[n + 1]
    room.time[n + 1] = room.time[n] + h
    room.approach[n + 1] = room.delta[STAGES - 1]
    work = loss = 0.0
    for i in range(STAGES):
        u, values = POINTS[i], room.stages[n, i]
        z = now[0] + u * h * (now[1] + 0.5 * fall.gravity * u * h)
        z -= h * h / fall.mass * dot(TWICE[i], room.force[:])
        v = now[1] + fall.gravity * u * h - h / fall.mass * dot(WEIGHTS[i], room.force[:])
        values[0], values[1], values[2] = z, v, room.force[i]
        values[3] = room.radius[i] if phase.recedes else room.edge[i]
        values[4] = values[5] = 0.0
        if fall.plate_mass > 0.0:
            values[4], values[5] = room.plate_free[i], now[5]
            for o in range(STAGES):
                pushed = dot(room.plate[o, :STAGES], room.force[:])
                values[4] += h * h * TWICE[i, o] * pushed
                values[5] += h * WEIGHTS[i, o] * (room.plate[o, STAGES] + pushed)
        share = h * WEIGHTS[STAGES - 1, i]
        work += share * room.force[i] * (v - values[5])
        loss += share * fall.plate_damping * values[5] ** 2
    for column in range(6):
        new[column] = room.stages[n, STAGES - 1, column]
    new[6], new[7] = now[6] + loss, now[7] + work
    for p in range(STAGES):
        room.powers[n, p] = room.edge_powers[n, p] = 0.0
        for m in range(STAGES):
            edge = room.edge[m] if phase.recedes else room.edge[m] ** 2
            room.powers[n, p] += TO_POWERS[p, m] * (room.delta[m] - room.approach[n])
            room.edge_powers[n, p] += TO_POWERS[p, m] * (edge - phase.start_edge)
    for j in range(law.maxwells):  # the fading integrals at the end
        left = math.exp(-law.rate[j] * h)
        room.fading[n + 1, j] = left * room.fading[n, j]
        for p in range(STAGES):
            room.fading[n + 1, j] += room.weight[j, STAGES - 1, p] * room.powers[n, p]
        if phase.recedes:
            continue
        room.held[j] *= left
        for m in range(STAGES):
            change = room.bulk[m] - phase.bulk
            for k in range(law.elements if phase.dented else 0):
                change += (law.mixed[j, k] - 1.0) * room.cross[m, k]
            for p in range(STAGES):
                room.held[j] += room.weight[j, STAGES - 1, p] * TO_POWERS[p, m] * change
    for k in range(law.elements if phase.dented and not phase.recedes else 0):
        room.last[k] = room.moment[STAGES - 1, k]


@inner()
def attempt(law: Law, fall: Fall, room: Room, n: int, h: float, phase: Phase) -> float:
    """Solve for one step; return its error over what is allowed.

    It is what the polynomial through the stages misses of the force at the start.
    """
    _prepare(law, fall, room, n, h)
    _fields(law, room, n, h, phase)
    if not _newton(law, fall, room, n, h, phase):
        return UNSOLVED
    error = GAMMA[0] * room.state[n, 2] + dot(GAMMA[1:], room.force[:])
    moved = fall.mass  # the reduced mass: a light plate errs more than the sphere, and its swing is in the force
    if fall.plate_mass > 0.0:
        moved *= fall.plate_mass / (fall.mass + fall.plate_mass)
    return abs(error) * h / (moved * fall.tolerance)

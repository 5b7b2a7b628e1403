"""The virtual rig's own drop: a dense reference that shares no code with the bundled simulator.

The simulator works with the creep compliance of a Prony series, implicit adaptive steps and
ballistic flights over a rigid floor. This reference works with the true relaxation function and
the whole history of every spring (:mod:`pipelines.rig.heredity`), explicit velocity Verlet,
several hundred springs, and a floor that may move: a damped oscillator under the sphere. Where
both agree, they agree for a reason.

Each spring of the one-dimensional foundation under the profile of a whole sphere, x artanh(x/R),
carries a surface displacement u::

    q(t) = ∫ E(t − s) du(s)

In contact u and the indentation of the elastic disc by q together follow the profile; free springs have q = 0. Over
a step u is linear, so no relaxation, however fast, limits the step. For contacts that only grow and
then only recede this is Ting's solution (J. Appl. Mech. 33 (1966) 845, doi:10.1115/1.3625192).

References
----------
Popov & Heß, Method of Dimensionality Reduction in Contact Mechanics and Friction (2015),
doi:10.1007/978-3-642-53876-6.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.compilation import lean
from labpipe.errors import InputError
from pipelines.rig.heredity import History, copy_of, no_history, press, pull, reach_of, remember, stiffness_of_step
from pipelines.rig.solids import Viscoelastic

GRAVITY = 9.81  # m/s², as in the thesis
CONTACT_STEP = 2e-6  # s; (ω Δt)²/24 is 1e-6 for a contact of 1 ms
_COARSER = ((4e-3, 8e-6), (40e-3, 20e-6))  # steps [s] from so long [s] after a touch: it rests
SPRINGS = 400
_IMPACT = 20e-3  # s; longer than any impact, so its modulus bounds the contact from above
_LATE, _LATE_STEPS, _SLOWEST = 0.5, 3.0, 3e-3
"""After so long [s], when nothing is compared any more, steps are three times as long, and grow as slow contacts last
(speed^-1/5, down to so many m/s): a restitution still errs by less than 1e-4."""
_REACH, _FEWER = 2.0, 0.9  # times its depth that a later contact may have; share of springs that is worth it
_PRESSED = 1e-15  # m, rounding of the displacement of a pressed spring
FLIGHT_GROWTH = 1.15  # ratio of successive recovery steps in flight; recovery is smooth in log t


@dataclass(frozen=True, slots=True)
class Floor:
    """The plate under the sphere as a damped oscillator; an infinite mass is a rigid floor."""

    mass: float = np.inf
    frequency: float = 400.0
    damping_ratio: float = 0.03


@dataclass(frozen=True, slots=True)
class Springs:
    """The state of all springs at chosen times.

    ``position`` (spring,) is the distance from the axis; ``displacement`` (time, spring) the
    surface displacement of the one-dimensional foundation, sphere and disc together; ``approach`` (time,) how far the
    sphere's lowest point would reach into the floor (negative in flight); ``contact_radius``
    (time,) is 0 in flight; ``resolution`` is half the distance of two springs.
    """

    time: Floats
    position: Floats
    displacement: Floats
    approach: Floats
    contact_radius: Floats
    resolution: float


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The reference motion: ``height`` of the sphere over first touch, and the times of its events.

    ``time`` starts at release. ``touch`` and ``liftoff`` are the times at which contact begins
    and ends; a last touch without lift-off is permanent contact. Speeds are those of the sphere in
    the laboratory's frame, as a sensor on the frame sees them, not relative to a moving floor.
    """

    time: Floats
    height: Floats
    velocity: Floats
    force: Floats
    contact_radius: Floats
    floor: Floats
    touch: Floats
    liftoff: Floats
    incoming_speed: Floats
    outgoing_speed: Floats
    springs: Springs | None = None

    def at(self, time: Floats) -> Floats:
        """Height at any time by cubic Hermite interpolation; the start height before release."""
        index = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        step = self.time[index + 1] - self.time[index]
        s = np.clip((time - self.time[index]) / step, 0.0, 1.0)
        z0, z1 = self.height[index], self.height[index + 1]
        m0, m1 = self.velocity[index] * step, self.velocity[index + 1] * step
        cubic: Floats = (
            (1 + 2 * s) * (1 - s) ** 2 * z0 + s * (1 - s) ** 2 * m0 + s**2 * (3 - 2 * s) * z1 + s**2 * (s - 1) * m1
        )
        return cubic


@lean()
def _contact(
    approach: float,
    speed: float,
    floor: float,
    floor_speed: float,
    u: Floats,
    history: History,
    begun: float,
    gap: Floats,
    weight: Floats,
    mass: float,
    gravity: float,
    floor_mass: float,
    floor_omega: float,
    floor_zeta: float,
    grid: Floats,
    record: Floats,
    kept: NDArray[np.int64],
    states: Floats,
    room: Floats,
    disc: float,
) -> tuple[int, bool]:
    """Integrate one contact; returns the number of steps and whether the sphere left.

    ``grid`` are the times of the steps since the contact began at ``begun``. ``states`` receives
    the springs after each of the steps ``kept`` (increasing). ``room`` (2, spring) is scratch.
    """
    place = 0
    n_springs = u.size
    base, rise = room[0], room[1]
    reach = reach_of(u)
    force, floor_force_acceleration = 0.0, 0.0
    acceleration = -gravity  # of the approach's opposite: upward positive motion of the sphere
    height = -approach + floor
    for n in range(grid.size - 1):
        step = grid[n + 1] - grid[n]
        now = begun + grid[n + 1]
        height += speed * step + 0.5 * acceleration * step * step
        floor += floor_speed * step + 0.5 * floor_force_acceleration * step * step
        approach = floor - height
        force, last, reach = press(history, now, step, approach, gap, weight, u, base, rise, reach, disc)
        remember(history, now - step, now, rise, reach)
        new_acceleration = force / mass - gravity
        speed += 0.5 * (acceleration + new_acceleration) * step
        acceleration = new_acceleration
        if floor_mass < np.inf:
            new_floor = (
                -force / floor_mass
                - floor_omega * floor_omega * floor
                - 2 * floor_zeta * floor_omega * (floor_speed + 0.5 * floor_force_acceleration * step)
            )
            floor_speed += 0.5 * (floor_force_acceleration + new_floor) * step
            floor_force_acceleration = new_floor
        record[n, 0], record[n, 1], record[n, 2] = height, speed, force
        record[n, 3], record[n, 4], record[n, 5] = gap[last] if last >= 0 else 0.0, floor, floor_speed
        if place < len(kept) and kept[place] == n:
            for i in range(n_springs):
                states[place, i] = max(u[i], approach - gap[i])
            place += 1
        if last < 0 and n > 2:
            return n + 1, True
    return grid.size - 1, False


@lean()
def _creep_back(u: Floats, history: History, begun: float, duration: float, room: Floats) -> None:
    base, rise = room[0], room[1]
    reach = reach_of(u)
    elapsed, step = 0.0, CONTACT_STEP
    while elapsed < duration and reach > 0:
        step = min(step, duration - elapsed)
        now = begun + elapsed + step
        stiffness = stiffness_of_step(history, step)
        pull(history, now, reach, base)
        for i in range(reach):
            rise[i] = -base[i] / stiffness
            u[i] += rise[i]
        remember(history, begun + elapsed, now, rise, reach)
        elapsed += step
        step *= FLIGHT_GROWTH


def _recover(u: Floats, history: History, begun: float, duration: float) -> None:
    """Let unloaded springs creep back for ``duration``, in steps that grow geometrically."""
    _creep_back(u, history, begun, duration, np.zeros((2, u.size)))


def _lengthened(now: float, speed: float, height: float) -> float:
    """Return how much longer the steps of a contact are that begins now."""
    return 1.0 if now <= _LATE else _LATE_STEPS * float(np.sqrt(2 * GRAVITY * height) / max(speed, _SLOWEST)) ** 0.2


def _contact_grid(duration: float, longer: float) -> Floats:
    """Return the times of the steps of a contact [s], from 0 to its longest duration."""
    ends = [*(begin for begin, _ in _COARSER), np.inf]
    steps = [longer * step for step in (CONTACT_STEP, *(step for _, step in _COARSER))]
    pieces: list[Floats] = [np.zeros(1)]
    begin = 0.0
    for step, end in zip(steps, ends, strict=True):
        count = int(np.ceil((min(end, duration) - begin) / step))
        if count > 0:
            pieces.append(np.asarray(begin + step * np.arange(1.0, count + 1.0), dtype=np.float64))
            begin = float(pieces[-1][-1])
    return np.concatenate(pieces)


def _floor_free(time: Floats, x0: float, v0: float, floor: Floor) -> tuple[Floats, Floats]:
    """Free motion of the damped floor from position ``x0`` and velocity ``v0``."""
    omega = 2 * np.pi * floor.frequency
    damped = omega * np.sqrt(1 - floor.damping_ratio**2)
    decay = np.exp(-floor.damping_ratio * omega * time)
    b = (v0 + floor.damping_ratio * omega * x0) / damped
    x = decay * (x0 * np.cos(damped * time) + b * np.sin(damped * time))
    v = -floor.damping_ratio * omega * x + decay * damped * (b * np.cos(damped * time) - x0 * np.sin(damped * time))
    return x, v


def of_sphere(position: Floats, radius: float) -> Floats:
    """Return the profile [m] of a whole sphere in the one-dimensional foundation, at distances from its axis [m]."""
    return np.asarray(position * np.arctanh(position / radius))


def reference_drop(
    solid: Viscoelastic,
    *,
    radius: float,
    mass: float,
    height: float,
    duration: float,
    floor: Floor | None = None,
    snapshots: Floats | None = None,
    profile: Callable[[Floats, float], Floats] = of_sphere,
    disc: float = 0.0,
) -> Trajectory:
    """Drop a viscoelastic sphere and record everything at the solver's own steps.

    ``mass`` [kg] is all that moves, ``height`` [m] the fall from rest to first touch, ``duration`` [s] counts from the
    release. ``snapshots`` (time,) [s], increasing, are times at which the springs are handed out too, and ``profile``
    is that of the body in the foundation, from distances from its axis and its radius. ``disc`` [1/Pa] is
    the compliance (1 − ν²)/E of an elastic disc.
    """
    if min(solid.unrelaxed, radius, mass, height, duration) <= 0:
        raise InputError("modulus, radius, mass, height and duration must be positive")
    floor = Floor() if floor is None else floor
    gap_of_impact, gap_at_rest = _deepest(solid, disc, radius, mass, height, duration)
    width = float(np.sqrt(radius * max(gap_of_impact, gap_at_rest))) / SPRINGS
    position: Floats = np.asarray((np.arange(SPRINGS) + 0.5) * width, dtype=np.float64)
    gap = profile(position, radius)
    weight = np.full(SPRINGS, 2 * width)
    u, history = np.zeros(SPRINGS), no_history(solid, SPRINGS, 1 / (1 - solid.nu**2))

    now, z, v, x, w = 0.0, height, 0.0, 0.0, 0.0
    pieces: list[Floats] = [np.array([[0.0, z, 0.0, 0.0, 0.0, 0.0]])]
    touch, liftoff, incoming, outgoing = [], [], [], []
    asked = np.empty(0) if snapshots is None else np.asarray(snapshots, float)
    shots: list[tuple[Floats, float, float]] = []
    while now < duration:
        flight = _flight_time(z, v, x, w, u, history, now, floor)
        flight = min(flight, duration - now)
        grid = np.linspace(0.0, flight, max(3, int(flight / 2e-4)))[1:]
        floor_x, floor_w = (
            _floor_free(grid, x, w, floor) if np.isfinite(floor.mass) else (np.zeros_like(grid), np.zeros_like(grid))
        )
        zero = np.zeros_like(grid)
        pieces.append(
            np.column_stack(
                [now + grid, z + v * grid - 0.5 * GRAVITY * grid**2, v - GRAVITY * grid, zero, zero, floor_x]
            )
        )
        shots += [
            _in_flight(time - now, z, v, x, w, u, history, now, floor)
            for time in asked[(asked >= now) & (asked < now + flight)]
        ]
        _recover(u, history, now, flight)
        now += flight
        z, v, x, w = pieces[-1][-1, 1], pieces[-1][-1, 2], floor_x[-1], floor_w[-1]
        if now >= duration:
            break
        steps = _contact_grid(duration - now, _lengthened(now, abs(v), height))
        record = np.empty((steps.size - 1, 6))
        due = asked[asked >= now]
        before = np.searchsorted(steps, due - now, side="right") - 2
        kept = np.unique(np.concatenate([before, before + 1]))
        kept = kept[kept >= 0]
        states, start = np.empty((len(kept), SPRINGS)), (u.copy(), x - z)
        n, left = _contact(
            x - z,
            v,
            x,
            w,
            u,
            history,
            now,
            gap,
            weight,
            mass,
            GRAVITY,
            floor.mass,
            2 * np.pi * floor.frequency,
            floor.damping_ratio,
            steps,
            record,
            kept,
            states,
            np.zeros((2, u.size)),
            disc,
        )
        record = record[:n]
        edge = float(record[:, 3].max())
        if edge >= gap[u.size - 1]:
            raise RuntimeError("the contact grew beyond the springs")
        # Under a moving floor the touch is foretold a few steps early; without force it is none.
        if is_touch := bool(np.any(record[:, 2] > 0.0)):
            touch.append(now)
            incoming.append(-v)
        for time, step in zip(due, before, strict=True):
            if step + 1 < n:
                share = (time - now - steps[step + 1]) / (steps[step + 2] - steps[step + 1])
                shots.append(_in_contact(int(step), share, start, kept, states, record, gap, position))
        times = now + steps[1 : n + 1]
        pieces.append(_rows(times, record, gap, position))
        now = float(times[-1])
        z, v, x, w = record[-1, 0], record[-1, 1], record[-1, 4], record[-1, 5]
        if left and is_touch:
            liftoff.append(_lifted(times, record[:, 2]))
            outgoing.append(v + GRAVITY * (now - liftoff[-1]))
            if snapshots is None:
                u, history = _within_reach(u, history, max(_REACH * edge, gap_at_rest), gap)
    table = np.concatenate(pieces)
    return Trajectory(
        time=table[:, 0],
        height=table[:, 1],
        velocity=table[:, 2],
        force=table[:, 3],
        contact_radius=table[:, 4],
        floor=table[:, 5],
        touch=np.array(touch),
        liftoff=np.array(liftoff),
        incoming_speed=np.array(incoming),
        outgoing_speed=np.array(outgoing),
        springs=_handed_out(asked, shots, position),
    )


def _lifted(time: Floats, force: Floats) -> float:
    """Return when the force ended: within the last step, where the power 2/3 of it runs into zero."""
    last = int(np.flatnonzero(force > 0.0)[-1])
    if last == 0 or force[last - 1] <= force[last]:
        return float(time[-1])
    before, after = force[last - 1 : last + 1] ** (2 / 3)
    return float(min(time[last] + (time[last] - time[last - 1]) * after / (before - after), time[-1]))


def _within_reach(u: Floats, history: History, reach: float, gap: Floats) -> tuple[Floats, History]:
    """Forget springs that no later, slower impact reaches; they bear nothing, and would cost as much as those in it."""
    count = int(np.searchsorted(gap, reach, side="right"))
    return (u[:count].copy(), copy_of(history, count)) if count < _FEWER * u.size else (u, history)


def _deepest(
    solid: Viscoelastic, disc: float, radius: float, mass: float, height: float, duration: float
) -> tuple[float, float]:
    """Bound the depth of impact and rest from above: Hertz with moduli that have relaxed longer than they can."""
    relaxed = solid.relaxation(np.array([_IMPACT, max(duration, _IMPACT)])) / (1 - solid.nu**2)
    of_impact, at_rest = relaxed / (1 + disc * relaxed)
    root = np.sqrt(radius)
    impact = (15 * mass * GRAVITY * height / (8 * of_impact * root)) ** 0.4
    static = (0.75 * mass * GRAVITY / (at_rest * root)) ** (2 / 3)
    return float(1.05 * impact + 0.5 * static), float(1.5 * static)


def _rows(times: NDArray[np.floating[Any]], record: Floats, gap: Floats, position: Floats) -> Floats:
    """Turn the record of a contact into rows of the trajectory; a spring covers half its width."""
    edge = _place(record[:, 3], gap, position) + np.where(record[:, 3] > 0, position[0], 0.0)
    return np.column_stack([times, record[:, 0], record[:, 1], record[:, 2], edge, record[:, 4]])


def _place(depth: Any, gap: Floats, position: Floats) -> Floats:
    """Return where the profile is so deep; its root is all but a straight line."""
    known, at = np.append(0.0, np.sqrt(gap)), np.append(0.0, position)
    return np.asarray(np.interp(np.sqrt(np.maximum(depth, 0.0)), known, at))


def _handed_out(asked: Floats, shots: list[tuple[Floats, float, float]], position: Floats) -> Springs | None:
    if not len(asked):
        return None
    if len(shots) != len(asked):
        raise InputError(f"{len(asked)} states were requested, {len(shots)} lie in the simulated time")
    u, approach, edge = (np.array(part) for part in zip(*shots, strict=True))
    half = 0.5 * float(position[1] - position[0])
    return Springs(asked, position, u, approach, edge, half)


def _in_flight(
    elapsed: float, z: float, v: float, x: float, w: float, u: Floats, history: History, begun: float, floor: Floor
) -> tuple[Floats, float, float]:
    """Springs and approach some time after the start of a flight."""
    recovered = u.copy()
    _recover(recovered, copy_of(history, u.size), begun, elapsed)
    level = 0.0
    if np.isfinite(floor.mass):
        level = float(_floor_free(np.array([elapsed]), x, w, floor)[0][0])
    return recovered, level - (z + v * elapsed - 0.5 * GRAVITY * elapsed**2), 0.0


def _in_contact(
    step: int,
    share: float,
    start: tuple[Floats, float],
    kept: NDArray[np.int64],
    states: Floats,
    record: Floats,
    gap: Floats,
    position: Floats,
) -> tuple[Floats, float, float]:
    """Springs and approach between two steps of a contact.

    A spring that is pressed in at both ends follows the profile at the very time; a free one
    moves smoothly.
    """
    second = states[np.searchsorted(kept, step + 1)]
    end = float(record[step + 1, 4] - record[step + 1, 0])
    if step < 0:
        first, begin = start
    else:
        first = states[np.searchsorted(kept, step)]
        begin = float(record[step, 4] - record[step, 0])
    approach = begin + share * (end - begin)
    u = first + share * (second - first)
    profile = approach - gap
    was_pressed = np.abs(first - (begin - gap)) < _PRESSED
    is_pressed = np.abs(second - (end - gap)) < _PRESSED
    u = np.where(is_pressed & ~was_pressed, first, u)  # it waits until the profile comes
    u = np.where(was_pressed & ~is_pressed, second, u)  # it stays where the profile leaves it
    u = np.maximum(u, profile)
    pressed = np.flatnonzero(np.abs(u - profile) < _PRESSED)
    if not len(pressed):
        return u, approach, 0.0
    edge = int(pressed[-1])
    radius = float(position[edge] + position[0])
    if edge + 1 < len(u) and u[edge + 1] == 0.0:  # on a fresh surface the profile tells exactly
        radius = float(_place(approach, gap, position))
    return u, approach, radius


def _flight_time(
    z: float, v: float, x: float, w: float, u: Floats, history: History, begun: float, floor: Floor
) -> float:
    """Time until the falling sphere meets the recovering dent at its centre."""
    apex = max(v, 0.0) / GRAVITY
    level = 0.0
    for _ in range(4):  # the dent recovers slowly against the flight: this converges at once
        span = apex + np.sqrt(max(2 * (z + v * apex - 0.5 * GRAVITY * apex**2 + level), 0) / GRAVITY)
        centre = u[:1].copy()
        _recover(centre, copy_of(history, 1), begun, span)
        level = float(centre[0])
    if not np.isfinite(floor.mass):
        return float(span)
    grid = np.linspace(0.0, span * 1.02 + 1e-4, 20001)[1:]
    floor_x, _ = _floor_free(grid, x, w, floor)
    clearance = z + v * grid - 0.5 * GRAVITY * grid**2 - floor_x + level
    # before the apex the dent is still deeper than ``level``, and the two cannot meet
    below = np.flatnonzero((clearance <= 0) & (grid > apex))
    if not len(below):
        return float(span)
    k = int(below[0])
    if k == 0 or clearance[k - 1] <= 0.0:  # a floor on its way up is there at the apex already
        return float(grid[k])
    share = clearance[k - 1] / (clearance[k - 1] - clearance[k])
    return float(grid[k - 1] + share * (grid[k] - grid[k - 1]))

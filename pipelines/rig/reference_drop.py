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
from pipelines.rig.apparatus import SPHERE
from pipelines.rig.heredity import History, copy_of, no_history, press, pull, reach_of, remember, stiffness_of_step
from pipelines.rig.solids import Viscoelastic

GRAVITY = SPHERE.gravity
CONTACT_STEP = 2e-6  # s; (ω Δt)²/24 is 1e-6 for a contact of 1 ms
FLIGHT_GROWTH = 1.15  # ratio of successive recovery steps in flight; recovery is smooth in log t


@dataclass(frozen=True, slots=True)
class Scheme:
    """Steps and springs of the reference; s, m/s.

    So long after a touch as ``coarser`` says, steps grow to those it says with it: the sphere rests. After ``late``,
    when nothing is compared any more, they are three times as long, and grow as slow contacts last (speed^-1/5, down to
    ``slowest``): a restitution still errs by less than 1e-4.
    """

    springs: int = 400
    coarser: tuple[tuple[float, float], ...] = ((4e-3, 8e-6), (40e-3, 20e-6))
    impact: float = 20e-3  # longer than any, so its modulus bounds the contact from above
    late: float = 0.5
    late_steps: float = 3.0
    slowest: float = 3e-3
    reach: float = 2.0  # times its depth that a later contact may have
    fewer: float = 0.9  # share of springs from which leaving the others out is worth it


_SCHEME = Scheme()


@dataclass(frozen=True, slots=True)
class Floor:
    """The plate under the sphere as a damped oscillator; an infinite mass is a rigid floor."""

    mass: float = np.inf
    frequency: float = 400.0
    damping_ratio: float = 0.03

    def free(self, time: Floats, x: float, v: float) -> tuple[Floats, Floats]:
        """Position and velocity after times without force, from a position and a velocity."""
        omega = 2 * np.pi * self.frequency
        rate, damped = self.damping_ratio * omega, omega * np.sqrt(1 - self.damping_ratio**2)
        decay, cosine, sine = np.exp(-rate * time), np.cos(damped * time), np.sin(damped * time)
        b = (v + rate * x) / damped
        moved = decay * (x * cosine + b * sine)
        return moved, -rate * moved + decay * damped * (b * cosine - x * sine)


@dataclass(frozen=True, slots=True)
class Springs:
    """The state of all springs at chosen times.

    ``position`` (spring,) is the distance from the axis; ``displacement`` (time, spring) the
    surface displacement of the one-dimensional foundation, sphere and disc together; ``approach`` (time,) how far the
    sphere's lowest point would reach into the floor (negative in flight); ``contact_radius``
    (time,) is 0 in flight; ``resolution`` is half the distance of two springs.
    """

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
    start: tuple[float, float, float, float],
    u: Floats,
    history: History,
    begun: float,
    gap: Floats,
    weight: float,
    mass: float,
    floor_law: tuple[float, float, float],
    grid: Floats,
    record: Floats,
    kept: NDArray[np.int64],
    states: Floats,
    disc: float,
) -> tuple[int, bool]:
    """Integrate one contact; returns the number of steps and whether the sphere left.

    ``start`` holds height and speed of the sphere and of the floor, whose law is mass, angular frequency and damping
    ratio; ``grid`` are the times of the steps since the contact began at ``begun``. ``states`` receives the springs
    after each of the steps ``kept`` (increasing).
    """
    height, speed, floor, floor_speed = start
    floor_mass, omega, zeta = floor_law
    place = 0
    base, rise, weights = np.zeros(u.size), np.zeros(u.size), np.full(u.size, weight)
    reach = reach_of(u)
    acceleration, floor_acceleration = -GRAVITY, 0.0
    for n in range(grid.size - 1):
        step = grid[n + 1] - grid[n]
        now = begun + grid[n + 1]
        height += speed * step + 0.5 * acceleration * step * step
        floor += floor_speed * step + 0.5 * floor_acceleration * step * step
        approach = floor - height
        force, last, reach = press(history, now, step, approach, gap, weights, u, base, rise, reach, disc)
        remember(history, now - step, now, rise, reach)
        new_acceleration = force / mass - GRAVITY
        speed += 0.5 * (acceleration + new_acceleration) * step
        acceleration = new_acceleration
        if floor_mass < np.inf:
            halfway = floor_speed + 0.5 * floor_acceleration * step
            new_floor = -force / floor_mass - omega * omega * floor - 2 * zeta * omega * halfway
            floor_speed += 0.5 * (floor_acceleration + new_floor) * step
            floor_acceleration = new_floor
        record[n, 0], record[n, 1], record[n, 2] = height, speed, force
        record[n, 3], record[n, 4], record[n, 5] = gap[last] if last >= 0 else 0.0, floor, floor_speed
        if place < len(kept) and kept[place] == n:
            for i in range(u.size):
                states[place, i] = max(u[i], approach - gap[i])
            place += 1
        if last < 0 and n > 2:
            return n + 1, True
    return grid.size - 1, False


@lean()
def _recover(u: Floats, history: History, begun: float, duration: float) -> None:
    """Let unloaded springs creep back for a time [s], in steps that grow geometrically."""
    base, rise = np.zeros(u.size), np.zeros(u.size)
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


def _contact_grid(now: float, duration: float, speed: float, height: float) -> Floats:
    """Return the times of the steps of a contact [s] that begins ``now`` at a speed, from 0 to its longest duration."""
    slow = float(np.sqrt(2 * GRAVITY * height) / max(speed, _SCHEME.slowest)) ** 0.2
    longer = 1.0 if now <= _SCHEME.late else _SCHEME.late_steps * slow
    pieces: list[Floats] = [np.zeros(1)]
    ends = [*(begin for begin, _ in _SCHEME.coarser), np.inf]
    begin = 0.0
    for step, end in zip((CONTACT_STEP, *(step for _, step in _SCHEME.coarser)), ends, strict=True):
        count = int(np.ceil((min(end, duration) - begin) / (longer * step)))
        if count > 0:
            pieces.append(np.asarray(begin + longer * step * np.arange(1.0, count + 1.0), dtype=np.float64))
            begin = float(pieces[-1][-1])
    return np.concatenate(pieces)


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
    width = float(np.sqrt(radius * max(gap_of_impact, gap_at_rest))) / _SCHEME.springs
    position: Floats = np.asarray((np.arange(_SCHEME.springs) + 0.5) * width, dtype=np.float64)
    gap = profile(position, radius)
    u, history = np.zeros(_SCHEME.springs), no_history(solid, _SCHEME.springs, 1 / (1 - solid.nu**2))
    floor_law = floor.mass, 2 * np.pi * floor.frequency, floor.damping_ratio

    now, z, v, x, w = 0.0, height, 0.0, 0.0, 0.0
    pieces: list[Floats] = [np.array([[0.0, z, 0.0, 0.0, 0.0, 0.0]])]
    touch, liftoff, incoming, outgoing = [], [], [], []
    asked = np.empty(0) if snapshots is None else np.asarray(snapshots, float)
    shots: list[tuple[Floats, float, float]] = []  # springs, approach and contact radius
    while now < duration:
        flight = min(_flight_time(z, v, x, w, u, history, now, floor), duration - now)
        grid = np.linspace(0.0, flight, max(3, int(flight / 2e-4)))[1:]
        (floor_x, floor_w), fallen = floor.free(grid, x, w), z + v * grid - 0.5 * GRAVITY * grid**2
        zero = np.zeros_like(grid)
        pieces.append(np.column_stack([now + grid, fallen, v - GRAVITY * grid, zero, zero, floor_x]))
        due = asked[len(shots) :] - now
        for since in due[due <= flight].tolist():
            recovered, level = u.copy(), float(floor.free(np.array(since), x, w)[0])
            _recover(recovered, copy_of(history, u.size), now, since)
            shots.append((recovered, level - (z + v * since - 0.5 * GRAVITY * since**2), 0.0))
        _recover(u, history, now, flight)
        now += flight
        z, v, x, w = pieces[-1][-1, 1], pieces[-1][-1, 2], floor_x[-1], floor_w[-1]
        if now >= duration:
            break
        steps = _contact_grid(now, duration - now, abs(v), height)
        due = np.maximum(asked[len(shots) :] - now, 0.0)
        due = due[due <= steps[-1]]
        steps = np.union1d(steps, due)  # a step ends wherever the springs are asked for
        record, kept = np.empty((steps.size - 1, 6)), np.maximum(np.searchsorted(steps, due) - 1, 0)
        states, start = np.empty((kept.size, u.size)), (z, v, x, w)
        n, left = _contact(start, u, history, now, gap, 2 * width, mass, floor_law, steps, record, kept, states, disc)
        record = record[:n]
        edge = float(record[:, 3].max())
        if edge >= gap[u.size - 1]:
            raise RuntimeError("the contact grew beyond the springs")
        # Under a moving floor the touch is foretold a few steps early; without force it is none.
        if is_touch := bool(np.any(record[:, 2] > 0.0)):
            touch.append(now)
            incoming.append(-v)
        # A spring covers half its width.
        times = now + steps[1 : n + 1]
        reached = _place(record[:, 3], gap, position) + np.where(record[:, 3] > 0, position[0], 0.0)
        pieces.append(np.column_stack([times, record[:, :3], reached, record[:, 4]]))
        shots += _in_contact(states, kept[kept < n], record, reached, gap, position)
        now = float(times[-1])
        z, v, x, w = record[-1, 0], record[-1, 1], record[-1, 4], record[-1, 5]
        if left and is_touch:
            liftoff.append(_lifted(times, record[:, 2]))
            outgoing.append(v + GRAVITY * (now - liftoff[-1]))
            # Springs that no later, slower impact reaches bear nothing, and would cost as much as those in it.
            count = int(np.searchsorted(gap, max(_SCHEME.reach * edge, gap_at_rest), side="right"))
            if not asked.size and count < _SCHEME.fewer * u.size:
                u, history = u[:count].copy(), copy_of(history, count)
    if len(shots) != asked.size:
        raise InputError(f"{asked.size} states were requested, {len(shots)} lie in the simulated time")
    seen = [np.array(part) for part in zip(*shots, strict=True)]
    springs = Springs(position, seen[0], seen[1], seen[2], 0.5 * width) if seen else None
    return Trajectory(  # type: ignore[call-arg]  # six columns
        *np.concatenate(pieces).T, np.array(touch), np.array(liftoff), np.array(incoming), np.array(outgoing), springs
    )


def _in_contact(
    states: Floats, kept: NDArray[np.int64], record: Floats, reached: Floats, gap: Floats, position: Floats
) -> list[tuple[Floats, float, float]]:
    """Return springs, approach and contact radius after the steps ``kept`` of a contact."""
    shots = []
    for u, step in zip(states, kept.tolist(), strict=False):
        approach, radius = float(record[step, 4] - record[step, 0]), float(reached[step])
        outer = int(np.searchsorted(gap, record[step, 3])) + 1
        if radius and outer < u.size and u[outer] == 0.0:  # on a fresh surface the profile tells exactly
            radius = float(_place(approach, gap, position))
        shots.append((u, approach, radius))
    return shots


def _lifted(time: Floats, force: Floats) -> float:
    """Return when the force ended: within the last step, where the power 2/3 of it runs into zero."""
    last = int(np.flatnonzero(force > 0.0)[-1])
    if last == 0 or force[last - 1] <= force[last]:
        return float(time[-1])
    before, after = force[last - 1 : last + 1] ** (2 / 3)
    return float(min(time[last] + (time[last] - time[last - 1]) * after / (before - after), time[-1]))


def _deepest(
    solid: Viscoelastic, disc: float, radius: float, mass: float, height: float, duration: float
) -> tuple[float, float]:
    """Bound the depth of impact and rest from above: Hertz with moduli that have relaxed longer than they can."""
    relaxed = solid.relaxation(np.array([_SCHEME.impact, max(duration, _SCHEME.impact)])) / (1 - solid.nu**2)
    of_impact, at_rest = relaxed / (1 + disc * relaxed)
    root = np.sqrt(radius)
    impact = (15 * mass * GRAVITY * height / (8 * of_impact * root)) ** 0.4
    static = (0.75 * mass * GRAVITY / (at_rest * root)) ** (2 / 3)
    return float(1.05 * impact + 0.5 * static), float(1.5 * static)


def _place(depth: Any, gap: Floats, position: Floats) -> Floats:
    """Return where the profile is so deep; its root is all but a straight line."""
    known, at = np.append(0.0, np.sqrt(gap)), np.append(0.0, position)
    return np.asarray(np.interp(np.sqrt(np.maximum(depth, 0.0)), known, at))


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
    clearance = z + v * grid - 0.5 * GRAVITY * grid**2 - floor.free(grid, x, w)[0] + level
    # before the apex the dent is still deeper than ``level``, and the two cannot meet
    below = np.flatnonzero((clearance <= 0) & (grid > apex))
    if not len(below):
        return float(span)
    k = int(below[0])
    if k == 0 or clearance[k - 1] <= 0.0:  # a floor on its way up is there at the apex already
        return float(grid[k])
    share = clearance[k - 1] / (clearance[k - 1] - clearance[k])
    return float(grid[k - 1] + share * (grid[k] - grid[k - 1]))

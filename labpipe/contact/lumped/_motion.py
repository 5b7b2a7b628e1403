"""The motion of appendix A's sphere: a sequence of flights, loading and unloading phases.

Every phase is smooth, so that an ordinary integrator of high order does it; what changes the law
(the sphere turns, leaves, or is free of force) ends a phase. See :mod:`._collision`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from labpipe.arrays import Floats
from labpipe.errors import InputError

_POINTS_IN_CONTACT = 65
_POINTS_IN_FLIGHT = 33
# Work that a motion may take: some 10 s.
_MAX_EVALUATIONS = 1_000_000
# A bounce lower than this part of the static overlap is rest: it cannot be seen. So is a swing in
# contact whose force differs from the weight by what this amplitude amounts to.
_REST_SHARE = 1e-3
_REST_UNBALANCE = 1.5 * _REST_SHARE
_FORCE_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class CollisionLaw:
    """Force between sphere and flat.

    ``stiffness`` [N/m^1.5]: χ; ``damping`` [N s/m^1.5]: c_v; ``yield_depth`` [m]: elastic overlap beyond which the
    overlap is permanent; infinite for none; ``unloading_multiplier``: f, at least 1; ``as_printed``: the thesis's
    unloading, see the module.
    """

    stiffness: float
    damping: float
    yield_depth: float
    unloading_multiplier: float
    as_printed: bool


class Dent(NamedTuple):
    """What the flat remembers: the deepest overlap so far and the permanent one."""

    deepest: float
    permanent: float


class Phase(NamedTuple):
    """A stretch of smooth motion: position, velocity and force at times in [start, end]."""

    start: float
    end: float
    motion: Callable[[Floats], tuple[Floats, Floats, Floats]]
    permanent: float
    is_contact: bool


@dataclass(frozen=True, slots=True)
class Bounce:
    """One contact."""

    impact_time: float
    contact_duration: float
    impact_speed: float
    rebound_speed: float
    peak_force: float
    peak_overlap: float
    permanent_overlap: float
    energy_dissipated: float


class Motion:
    """The sphere's motion as a sequence of phases; x is the height of its lowest point."""

    def __init__(self, law: CollisionLaw, mass: float, gravity: float, rtol: float) -> None:
        self.law = law
        self.rtol = rtol
        self.mass = mass
        self.gravity = gravity
        self.evaluations = 0
        static = (mass * gravity / law.stiffness) ** (2.0 / 3.0)
        self.rest_speed = float(np.sqrt(2.0 * gravity * _REST_SHARE * static))

    def run(self, height: float, duration: float, most: int | None = None) -> tuple[list[Phase], list[Bounce]]:
        """Return all phases up to ``duration`` and all contacts, or only so many."""
        phases: list[Phase] = []
        bounces: list[Bounce] = []
        now, x, v, dent = 0.0, height, 0.0, Dent(0.0, 0.0)
        while now < duration and len(bounces) != most:
            flight = self._flight(now, x, v, dent.permanent, duration)
            phases.append(flight)
            now, x = flight.end, -dent.permanent
            if now >= duration:
                break
            v = float(flight.motion(np.array([now]))[1][0])
            if -v <= self.rest_speed and bounces:
                phases.append(self._at_rest(now, dent.permanent, duration))
                break
            contact = list(self._contact(now, x, v, dent, duration))
            phases += [phase for phase, _ in contact]
            dent = contact[-1][1]
            bounces.append(self._bounce(v, contact))
            last = phases[-1]
            now = last.end
            x, v = (float(column[0]) for column in last.motion(np.array([now]))[:2])
        return phases, bounces

    def force(self, x: float, v: float, dent: Dent, *, loading: bool) -> float:
        """Contact force before it is clipped at zero."""
        law = self.law
        depth = -x
        multiplier, permanent = law.unloading_multiplier, dent.permanent
        if law.as_printed:
            permanent = max(permanent, depth - law.yield_depth) if loading else permanent
            factor = 1.0 if loading else multiplier
        elif depth >= dent.deepest and loading:
            permanent, factor = max(0.0, depth - law.yield_depth), 1.0
        else:
            factor = multiplier
        elastic = max(depth - permanent, 0.0)
        return law.stiffness * factor * elastic**1.5 - law.damping * np.sqrt(elastic) * v

    def _settled(self, depth: float, dent: Dent) -> Dent:
        """Dent after the motion has turned at an overlap."""
        deepest = max(depth, dent.deepest)
        plastic = max(0.0, deepest - self.law.yield_depth)
        if self.law.as_printed:
            return Dent(deepest, max(dent.permanent, plastic))
        # Unloading starts at the force that loading has reached.
        spring = (deepest - plastic) * self.law.unloading_multiplier ** (-2.0 / 3.0)
        return Dent(deepest, max(dent.permanent, deepest - spring))

    def _flight(self, now: float, x: float, v: float, permanent: float, end: float) -> Phase:
        g = self.gravity
        fall = max(x + permanent, 0.0)
        landing = now + (v + np.sqrt(v**2 + 2.0 * g * fall)) / g

        def motion(t: Floats) -> tuple[Floats, Floats, Floats]:
            s = t - now
            return x + v * s - 0.5 * g * s**2, v - g * s, np.zeros_like(s)

        return Phase(now, min(float(landing), end), motion, permanent, is_contact=False)

    def _at_rest(self, now: float, permanent: float, end: float) -> Phase:
        weight = self.mass * self.gravity
        stiffness = self.law.stiffness * self.law.unloading_multiplier
        level = -permanent - (weight / stiffness) ** (2.0 / 3.0)
        return self._resting(now, level, permanent, end)

    def _resting(self, now: float, level: float, permanent: float, end: float) -> Phase:
        weight = self.mass * self.gravity

        def motion(t: Floats) -> tuple[Floats, Floats, Floats]:
            return np.full_like(t, level), np.zeros_like(t), np.full_like(t, weight)

        return Phase(now, end, motion, permanent, is_contact=True)

    def _contact(self, now: float, x: float, v: float, dent: Dent, end: float) -> Iterator[tuple[Phase, Dent]]:
        """Yield the phases of one contact, each with the dent it leaves."""
        can_leave = True
        while True:
            loading = v < 0.0
            phase, reason = self._integrate(now, x, v, dent, end, loading=loading, can_leave=can_leave)
            now = phase.end
            x, v = (float(column[0]) for column in phase.motion(np.array([now]))[:2])
            if reason == "turned" and loading:
                dent = self._settled(-x, dent)
                v = 0.0
            yield phase._replace(permanent=dent.permanent), dent
            if reason == "released":
                # Free of force while still in its dent: it leaves if its speed carries it out.
                if v**2 > -2.0 * self.gravity * (x + dent.permanent):
                    return
                can_leave = False
            if reason in ("left", "end"):
                return
            if reason == "turned" and self._is_balanced(x, dent):
                yield self._resting(now, x, dent.permanent, end), dent
                return
            if reason == "turned" and not loading:
                # The sphere turns downwards without having left: it may come to rest here.
                v = -np.finfo(float).tiny

    def _is_balanced(self, x: float, dent: Dent) -> bool:
        """Look whether either law, at a turn, carries the weight closely enough to be at rest."""
        weight = self.mass * self.gravity
        forces = (self.force(x, 0.0, dent, loading=way) for way in (True, False))
        return all(abs(force / weight - 1.0) < _REST_UNBALANCE for force in forces)

    def _integrate(
        self, now: float, x: float, v: float, dent: Dent, end: float, *, loading: bool, can_leave: bool
    ) -> tuple[Phase, str]:
        def unclipped(state: Floats) -> float:
            return self.force(float(state[0]), float(state[1]), dent, loading=loading)

        def rates(_t: float, state: Floats) -> list[float]:
            push = max(unclipped(state), 0.0)
            return [float(state[1]), push / self.mass - self.gravity]

        def turned(_t: float, state: Floats) -> float:
            return float(state[1])

        def left(_t: float, state: Floats) -> float:
            return float(-state[0] - dent.permanent)

        def released(_t: float, state: Floats) -> float:
            # Divided by the root of the overlap, so that it crosses zero with a slope.
            elastic = max(float(-state[0]) - dent.permanent, 0.0)
            multiplier = self.law.unloading_multiplier
            return self.law.stiffness * multiplier * elastic - self.law.damping * float(state[1])

        events = [turned, left, released] if can_leave and not loading else [turned, left]
        for event, direction in zip(events, (1.0 if loading else -1.0, -1.0, -1.0), strict=False):
            event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
        scale = np.array([max(abs(x), self.rest_speed**2 / self.gravity), abs(v) + self.rest_speed])
        solution = solve_ivp(
            rates,
            # Time counts from the touch, so that a long fall before it costs no digits.
            (0.0, end - now),
            [x, v],
            method="DOP853",
            rtol=self.rtol,
            atol=self.rtol * scale,
            events=events,
            dense_output=True,
        )
        if not solution.success:
            raise InputError(f"the motion could not be integrated at {now:.6g} s: {solution.message}")
        self.evaluations += int(solution.nfev)
        if self.evaluations > _MAX_EVALUATIONS:
            raise InputError(
                f"the motion took {self.evaluations} evaluations of the force up to {now:.6g} s of {end:.6g} s; give a "
                "shorter duration, a higher drop or more damping"
            )
        dense = solution.sol

        def motion(t: Floats) -> tuple[Floats, Floats, Floats]:
            states = np.atleast_2d(dense(t - now).T)
            force = np.array([max(unclipped(state), 0.0) for state in states])
            return states[:, 0], states[:, 1], force

        names = ("turned", "left", "released")
        found = [name for name, at in zip(names, solution.t_events, strict=False) if at.size]
        reason = found[0] if found else "end"
        phase = Phase(now, now + float(solution.t[-1]), motion, dent.permanent, is_contact=True)
        return phase, reason

    def _bounce(self, speed: float, contact: list[tuple[Phase, Dent]]) -> Bounce:
        phases = [phase for phase, _ in contact]
        samples = [phase.motion(grid(phase)) for phase in phases]
        x = np.concatenate([sample[0] for sample in samples])
        velocity = float(samples[-1][1][-1])
        start, lift = phases[0].start, phases[-1].end
        # The contact ends where the force does; what is still in contact at the end does not.
        has_left = velocity > 0.0 and float(samples[-1][2][-1]) <= _FORCE_ROUNDING * max(
            float(sample[2].max()) for sample in samples
        )
        rebound = velocity if has_left else np.nan
        kinetic = 0.5 * (speed**2 - rebound**2)
        return Bounce(
            impact_time=start,
            contact_duration=lift - start if has_left else np.nan,
            impact_speed=-speed,
            rebound_speed=rebound,
            peak_force=float(max(sample[2].max() for sample in samples)),
            peak_overlap=float(-x.min()),
            permanent_overlap=contact[-1][1].permanent,
            energy_dissipated=float(self.mass * (kinetic + self.gravity * (x[0] - x[-1]))),
        )


def grid(phase: Phase) -> Floats:
    """Return the times (time,) in s at which a phase is sampled, its ends included."""
    points = _POINTS_IN_CONTACT if phase.is_contact else _POINTS_IN_FLIGHT
    return np.linspace(phase.start, phase.end, points)

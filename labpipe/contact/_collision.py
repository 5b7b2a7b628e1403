r"""Appendix A: a bouncing sphere with a Hertz spring, a dashpot, a yield depth and stiff unloading.

A semi-empirical model that the thesis fitted before its boundary elements. With the overlap
ζ = a − y_c,

.. math::
    m \ddot y_c = -m g + \max(0, \chi \zeta_{el}^{3/2} + c_v \sqrt{\zeta_{el}} \dot\zeta),
    \qquad \zeta_{el} = \zeta - \zeta_{perm}.

Two versions:

- ``as_printed=True`` (figure A.1): χ = 2E√a/(3(1 − ν²)), which is the law of two *identical*
  spheres; permanent overlap max(ζ − ζ_yield) and stiffness χ f while unloading, equation (A.8),
  so that for f > 1 the force jumps up where the motion turns and the model *gains* energy there;
- default: χ = 4E√a/(3(1 − ν²)), a sphere on a rigid flat, twice as much; unloading with stiffness
  χ f starts at the force that loading has reached, so the permanent overlap grows by what the
  stiffer spring does not give back, and energy is lost: e = f^{-1/3} without damping.

The total force never pulls. The material has no memory; for that use :func:`labpipe.contact.drop`.

References
----------
.. [1] N. V. Brilliantov, F. Spahn, J.-M. Hertzsch, T. Pöschel, Phys. Rev. E 53 (1996) 5382,
   https://doi.org/10.1103/PhysRevE.53.5382.
.. [2] O. R. Walton, R. L. Braun, J. Rheol. 30 (1986) 949, https://doi.org/10.1122/1.549893.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.units import Measure, require_positive, si
from labpipe.variables import described, variable

# Energy gained in an impact by less than this part is rounding.
_ENERGY_ROUNDING = 1e-6
_FINEST, _COARSEST = 1e-13, 1e-3  # tolerances


def collision(
    radius: Measure,
    mass: Measure,
    height: Measure,
    *,
    youngs_modulus: Measure = 3.2e9,
    nu: float = 0.35,
    damping: float = 0.0,
    yield_depth: Measure = np.inf,
    unloading_multiplier: float = 1.0,
    duration: Measure = 0.5,
    gravity: Measure = 9.81,
    as_printed: bool = False,
    time: ArrayLike | None = None,
    impacts: int | None = None,
    rtol: float = 1e-11,
) -> xr.Dataset:
    """Drop a sphere with the collision law of appendix A.

    Numbers are in SI; lengths, mass, modulus and time may be texts with a unit, ``"9.525 mm"``.

    Parameters
    ----------
    radius : float [m]
        a, of the sphere.
    mass : float [kg]
        Everything that falls.
    height : float [m]
        Fall from rest to first touch.
    youngs_modulus : float [Pa]
        E; the thesis uses 3.2 GPa for acrylic.
    nu : float
        Poisson's ratio.
    damping : float [N s/m^1.5]
        c_v; the thesis uses 13 700 to 16 800.
    yield_depth : float [m]
        ζ_yield; the thesis's "yield stress of 2.0e-5 m" is 20 µm. Infinite: no plasticity.
    unloading_multiplier : float
        f ≥ 1.
    duration : float [s]
        From the release.
    gravity : float [m/s²]
        At least 0 is needed for a fall; positive.
    as_printed : bool
        The thesis's χ and unloading, see the module.
    time : array (time,) [s], optional
        Output times from the release on, rising; by default the phases of the motion are sampled.
    impacts : int, optional
        After which the motion is no longer followed; by default all until the end are.
    rtol : float
        Relative error of each step within a contact, 1e-13 to 1e-3, some ten times more across the
        yield depth, where the law has a kink; flights are exact.

    Returns
    -------
    Dataset
        Over ``time`` (0 at release): ``displacement`` [m] (upwards, 0 at first touch),
        ``velocity`` [m/s], ``force`` [N], ``overlap``, ``permanent_overlap_so_far`` [m]; over
        ``impact``: ``impact_time``, ``contact_duration`` [s], ``impact_speed``, ``rebound_speed``
        [m/s], ``restitution``, ``peak_force`` [N], ``peak_overlap``,
        ``permanent_overlap`` [m], ``energy_dissipated`` [J].
        A sphere that comes to rest leaves the last impact without a rebound: NaN.

    Raises
    ------
    InputError
        A number lies outside its domain, or the motion takes too much work.

    Warns
    -----
    UserWarning
        The printed law returned more energy than the impact brought.

    Examples
    --------
    >>> found = collision(9.525e-3, 0.505, 1.5e-3, damping=15e3, duration=0.02)
    >>> 0.5 < float(found.restitution[0]) < 1.0
    True
    """
    radius, mass = si(radius, "m", "radius"), si(mass, "kg", "mass")
    height, duration = si(height, "m", "height"), si(duration, "s", "duration")
    yield_depth, gravity = si(yield_depth, "m", "yield_depth"), si(gravity, "m/s2", "gravity")
    youngs_modulus = si(youngs_modulus, "Pa", "youngs_modulus")
    require_positive(radius=radius, youngs_modulus=youngs_modulus, mass=mass, height=height)
    require_positive(duration=duration, gravity=gravity)
    if not -1.0 < nu <= 0.5:
        raise InputError(f"Poisson's ratio is {nu}, expected above -1 and at most 0.5")
    if not 0.0 <= damping < np.inf:
        raise InputError(f"damping is {damping} N s/m^1.5, expected a number from 0 up")
    if not yield_depth > 0.0:
        raise InputError(f"yield_depth is {yield_depth} m, expected a positive length or infinity")
    if not 1.0 <= unloading_multiplier < np.inf:
        raise InputError(f"unloading_multiplier is {unloading_multiplier}, expected a number from 1 up")
    stiffness = contact_stiffness(radius, youngs_modulus, nu, as_printed=as_printed)
    law = CollisionLaw(stiffness, damping, yield_depth, unloading_multiplier, as_printed)
    if not _FINEST <= rtol <= _COARSEST:
        raise InputError(f"rtol is {rtol}, expected {_FINEST:g} to {_COARSEST:g}")
    motion = Motion(law, mass, gravity, rtol)
    phases, bounces = motion.run(height, duration, impacts)
    grids = [grid(phase) for phase in phases]
    instants = np.unique(np.concatenate(grids)) if time is None else _checked_times(time, duration)
    gained = [-bounce.energy_dissipated / (mass * bounce.impact_speed**2) for bounce in bounces]
    if as_printed and any(share > _ENERGY_ROUNDING for share in gained):
        warnings.warn(
            "the law as printed gained energy in an impact (its force jumps up where the sphere "
            "turns); use as_printed=False for unloading that loses energy",
            UserWarning,
            stacklevel=2,
        )
    return _dataset(phases, bounces, instants, motion.evaluations)


def contact_stiffness(radius: float, youngs_modulus: float, nu: float, *, as_printed: bool = False) -> float:
    """Hertz stiffness χ [N/m^1.5] of a sphere on a rigid flat, 4E√a/(3(1 − ν²)).

    ``as_printed=True`` gives the thesis's 2E√a/(3(1 − ν²)), half as much.

    Examples
    --------
    >>> right = contact_stiffness(9.525e-3, 3.2e9, 0.35)
    >>> right / contact_stiffness(9.525e-3, 3.2e9, 0.35, as_printed=True)
    2.0
    """
    factor = 2.0 if as_printed else 4.0
    return float(factor * youngs_modulus * np.sqrt(radius) / (3.0 * (1.0 - nu**2)))


def _checked_times(time: ArrayLike, duration: float) -> Floats:
    times = np.asarray(time, dtype=float)
    if times.ndim != 1 or times.size == 0 or not np.all(np.diff(times) > 0.0):
        raise InputError(f"output times must be one rising row, found the shape {times.shape}")
    if not (times[0] >= 0.0 and times[-1] <= duration):
        raise InputError(f"output times must lie from 0 to the duration of {duration} s")
    return times


def _sampled(phases: list[Phase], time: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Position, velocity, force and permanent overlap at the times."""
    starts = np.array([phase.start for phase in phases])
    which = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(phases) - 1)
    rows = np.zeros((4, time.size))
    for n in np.unique(which):
        used = which == n
        rows[:3, used] = phases[n].motion(time[used])
        rows[3, used] = phases[n].permanent
    return rows[0], rows[1], rows[2], rows[3]


_ROWS = {
    "impact_time": ("s", "time of touch"),
    "contact_duration": ("s", "duration of the contact"),
    "impact_speed": ("m/s", "speed at touch"),
    "rebound_speed": ("m/s", "speed at lift-off"),
    "peak_force": ("N", "largest contact force"),
    "peak_overlap": ("m", "largest overlap"),
    "permanent_overlap": ("m", "permanent overlap after the contact"),
    "energy_dissipated": ("J", "energy lost in the contact"),
}


def _dataset(phases: list[Phase], bounces: list[Bounce], time: Floats, evaluations: int) -> xr.Dataset:
    x, velocity, force, permanent = _sampled(phases, time)
    series = {
        "displacement": (x, "m", "displacement of the sphere, upwards, 0 at first touch"),
        "velocity": (velocity, "m/s", "velocity of the sphere, upwards"),
        "force": (force, "N", "contact force"),
        "overlap": (np.maximum(-x, 0.0), "m", "overlap of sphere and flat"),
        "permanent_overlap_so_far": (permanent, "m", "permanent overlap so far"),
    }
    variables = {name: variable("time", values, units, text) for name, (values, units, text) in series.items()}
    for name, (units, text) in _ROWS.items():
        values = np.array([getattr(bounce, name) for bounce in bounces])
        variables[name] = variable("impact", values, units, text)
    restitution = variables["rebound_speed"][1] / variables["impact_speed"][1]
    labels = described("1", "coefficient of restitution")
    variables["restitution"] = ("impact", restitution, labels)
    coordinates = {
        "time": variable("time", time, "s", "time from the release"),
        "impact": variable("impact", np.arange(len(bounces)), "1", "impact"),
    }
    work = json.dumps({"evaluations": evaluations, "phases": len(phases)})
    return xr.Dataset(variables, coordinates, {"work": work})


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
    """Memory of the flat: the deepest overlap so far and the permanent one."""

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
                stiffness = self.law.stiffness * self.law.unloading_multiplier
                level = -dent.permanent - (self.mass * self.gravity / stiffness) ** (2.0 / 3.0)
                phases.append(self._resting(now, level, dent.permanent, duration))
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

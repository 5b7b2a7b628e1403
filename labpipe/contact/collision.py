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

import json
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from labpipe.errors import InputError

Array = NDArray[np.float64]

_RTOL = 1e-11
_POINTS_IN_CONTACT = 65
_POINTS_IN_FLIGHT = 33
_MAX_PHASES = 20_000
# A bounce lower than this part of the static overlap is rest: it cannot be seen.
_REST_SHARE = 1e-3
_FORCE_ROUNDING = 1e-9
_ENERGY_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class CollisionLaw:
    """Force between sphere and flat.

    Attributes
    ----------
    stiffness : float [N/m^1.5]
        χ.
    damping : float [N s/m^1.5]
        c_v.
    yield_depth : float [m]
        Elastic overlap beyond which the overlap is permanent; infinite for none.
    unloading_multiplier : float
        f, at least 1.
    as_printed : bool
        The thesis's unloading, see the module.
    """

    stiffness: float
    damping: float
    yield_depth: float
    unloading_multiplier: float
    as_printed: bool


class _Dent(NamedTuple):
    """What the flat remembers: the deepest overlap so far and the permanent one."""

    deepest: float
    permanent: float


class _Phase(NamedTuple):
    """A stretch of smooth motion: position, velocity and force at times in [start, end]."""

    start: float
    end: float
    motion: Callable[[Array], tuple[Array, Array, Array]]
    permanent: float
    is_contact: bool


@dataclass(frozen=True, slots=True)
class _Bounce:
    """One contact."""

    impact_time: float
    contact_duration: float
    impact_speed: float
    rebound_speed: float
    peak_force: float
    peak_overlap: float
    permanent_overlap: float
    energy_dissipated: float


def collision(
    radius: float,
    mass: float,
    height: float,
    *,
    youngs_modulus: float = 3.2e9,
    nu: float = 0.35,
    damping: float = 0.0,
    yield_depth: float = np.inf,
    unloading_multiplier: float = 1.0,
    duration: float = 0.5,
    gravity: float = 9.81,
    as_printed: bool = False,
    time: ArrayLike | None = None,
) -> xr.Dataset:
    """Drop a sphere with the collision law of appendix A.

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
        A number lies outside its domain, or the motion has too many phases.

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
    law = _law(radius, youngs_modulus, nu, damping, yield_depth, unloading_multiplier, as_printed)
    _require_positive(mass=mass, height=height, duration=duration, gravity=gravity)
    motion = _Motion(law, mass, gravity)
    phases, bounces = motion.run(height, duration)
    instants = _instants(phases) if time is None else _checked_times(time, duration)
    gained = [-bounce.energy_dissipated / (mass * bounce.impact_speed**2) for bounce in bounces]
    if as_printed and any(share > _ENERGY_ROUNDING for share in gained):
        warnings.warn(
            "the law as printed gained energy in an impact (its force jumps up where the sphere "
            "turns); use as_printed=False for unloading that loses energy",
            UserWarning,
            stacklevel=2,
        )
    return _dataset(phases, bounces, instants, motion.evaluations)


def contact_stiffness(
    radius: float, youngs_modulus: float, nu: float, *, as_printed: bool = False
) -> float:
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


def _law(
    radius: float,
    youngs_modulus: float,
    nu: float,
    damping: float,
    yield_depth: float,
    unloading_multiplier: float,
    as_printed: bool,
) -> CollisionLaw:
    _require_positive(radius=radius, youngs_modulus=youngs_modulus)
    if not -1.0 < nu <= 0.5:
        message = f"Poisson's ratio is {nu}, expected above -1 and at most 0.5"
        raise InputError(message)
    if not (np.isfinite(damping) and damping >= 0.0):
        message = f"damping is {damping} N s/m^1.5, expected a number from 0 up"
        raise InputError(message)
    if not yield_depth > 0.0:
        message = f"yield_depth is {yield_depth} m, expected a positive length or infinity"
        raise InputError(message)
    if not (np.isfinite(unloading_multiplier) and unloading_multiplier >= 1.0):
        message = f"unloading_multiplier is {unloading_multiplier}, expected a number from 1 up"
        raise InputError(message)
    stiffness = contact_stiffness(radius, youngs_modulus, nu, as_printed=as_printed)
    return CollisionLaw(stiffness, damping, yield_depth, unloading_multiplier, as_printed)


class _Motion:
    """The sphere's motion as a sequence of phases; x is the height of its lowest point."""

    def __init__(self, law: CollisionLaw, mass: float, gravity: float) -> None:
        self.law = law
        self.mass = mass
        self.gravity = gravity
        self.evaluations = 0
        static = (mass * gravity / law.stiffness) ** (2.0 / 3.0)
        self.rest_speed = float(np.sqrt(2.0 * gravity * _REST_SHARE * static))

    def run(self, height: float, duration: float) -> tuple[list[_Phase], list[_Bounce]]:
        """Return all phases up to ``duration`` and all contacts."""
        phases: list[_Phase] = []
        bounces: list[_Bounce] = []
        now, x, v, dent = 0.0, height, 0.0, _Dent(0.0, 0.0)
        while now < duration:
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
            if len(phases) > _MAX_PHASES:
                message = f"more than {_MAX_PHASES} phases of motion; give a shorter duration"
                raise InputError(message)
        return phases, bounces

    def force(self, x: float, v: float, dent: _Dent, *, loading: bool) -> float:
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

    def _settled(self, depth: float, dent: _Dent) -> _Dent:
        """Dent after the motion has turned at an overlap."""
        deepest = max(depth, dent.deepest)
        plastic = max(0.0, deepest - self.law.yield_depth)
        if self.law.as_printed:
            return _Dent(deepest, max(dent.permanent, plastic))
        # Unloading starts at the force that loading has reached.
        spring = (deepest - plastic) * self.law.unloading_multiplier ** (-2.0 / 3.0)
        return _Dent(deepest, max(dent.permanent, deepest - spring))

    def _flight(self, now: float, x: float, v: float, permanent: float, end: float) -> _Phase:
        g = self.gravity
        fall = max(x + permanent, 0.0)
        landing = now + (v + np.sqrt(v**2 + 2.0 * g * fall)) / g

        def motion(t: Array) -> tuple[Array, Array, Array]:
            s = t - now
            return x + v * s - 0.5 * g * s**2, v - g * s, np.zeros_like(s)

        return _Phase(now, min(float(landing), end), motion, permanent, is_contact=False)

    def _at_rest(self, now: float, permanent: float, end: float) -> _Phase:
        weight = self.mass * self.gravity
        stiffness = self.law.stiffness * self.law.unloading_multiplier
        level = -permanent - (weight / stiffness) ** (2.0 / 3.0)

        def motion(t: Array) -> tuple[Array, Array, Array]:
            return np.full_like(t, level), np.zeros_like(t), np.full_like(t, weight)

        return _Phase(now, end, motion, permanent, is_contact=True)

    def _contact(
        self, now: float, x: float, v: float, dent: _Dent, end: float
    ) -> Iterator[tuple[_Phase, _Dent]]:
        """Yield the phases of one contact, each with the dent it leaves."""
        can_leave = True
        for _ in range(_MAX_PHASES):
            loading = v < 0.0
            phase, reason = self._integrate(
                now, x, v, dent, end, loading=loading, can_leave=can_leave
            )
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
            if reason == "turned" and not loading:
                # The sphere turns downwards without having left: it may come to rest here.
                v = -np.finfo(float).tiny
        message = f"a contact took more than {_MAX_PHASES} turns; give a shorter duration"
        raise InputError(message)

    def _integrate(
        self,
        now: float,
        x: float,
        v: float,
        dent: _Dent,
        end: float,
        *,
        loading: bool,
        can_leave: bool,
    ) -> tuple[_Phase, str]:
        def unclipped(state: Array) -> float:
            return self.force(float(state[0]), float(state[1]), dent, loading=loading)

        def rates(_t: float, state: Array) -> list[float]:
            push = max(unclipped(state), 0.0)
            return [float(state[1]), push / self.mass - self.gravity]

        def turned(_t: float, state: Array) -> float:
            return float(state[1])

        def left(_t: float, state: Array) -> float:
            return float(-state[0] - dent.permanent)

        def released(_t: float, state: Array) -> float:
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
            (now, end),
            [x, v],
            method="DOP853",
            rtol=_RTOL,
            atol=_RTOL * scale,
            events=events,
            dense_output=True,
        )
        if not solution.success:
            message = f"the motion could not be integrated at {now:.6g} s: {solution.message}"
            raise InputError(message)
        self.evaluations += int(solution.nfev)
        dense = solution.sol

        def motion(t: Array) -> tuple[Array, Array, Array]:
            states = np.atleast_2d(dense(t).T)
            force = np.array([max(unclipped(state), 0.0) for state in states])
            return states[:, 0], states[:, 1], force

        names = ("turned", "left", "released")
        found = [name for name, at in zip(names, solution.t_events, strict=False) if at.size]
        reason = found[0] if found else "end"
        phase = _Phase(now, float(solution.t[-1]), motion, dent.permanent, is_contact=True)
        return phase, reason

    def _bounce(self, speed: float, contact: list[tuple[_Phase, _Dent]]) -> _Bounce:
        phases = [phase for phase, _ in contact]
        samples = [phase.motion(_grid(phase)) for phase in phases]
        x = np.concatenate([sample[0] for sample in samples])
        velocity = float(samples[-1][1][-1])
        start, lift = phases[0].start, phases[-1].end
        # The contact ends where the force does; what is still in contact at the end does not.
        has_left = velocity > 0.0 and float(samples[-1][2][-1]) <= _FORCE_ROUNDING * max(
            float(sample[2].max()) for sample in samples
        )
        rebound = velocity if has_left else np.nan
        kinetic = 0.5 * (speed**2 - rebound**2)
        return _Bounce(
            impact_time=start,
            contact_duration=lift - start if has_left else np.nan,
            impact_speed=-speed,
            rebound_speed=rebound,
            peak_force=float(max(sample[2].max() for sample in samples)),
            peak_overlap=float(-x.min()),
            permanent_overlap=contact[-1][1].permanent,
            energy_dissipated=float(self.mass * (kinetic + self.gravity * (x[0] - x[-1]))),
        )


def _grid(phase: _Phase) -> Array:
    points = _POINTS_IN_CONTACT if phase.is_contact else _POINTS_IN_FLIGHT
    return np.linspace(phase.start, phase.end, points)


def _instants(phases: list[_Phase]) -> Array:
    return np.unique(np.concatenate([_grid(phase) for phase in phases]))


def _checked_times(time: ArrayLike, duration: float) -> Array:
    times = np.asarray(time, dtype=float)
    if times.ndim != 1 or times.size == 0 or not np.all(np.diff(times) > 0.0):
        message = f"output times must be one rising row, found the shape {times.shape}"
        raise InputError(message)
    if not (times[0] >= 0.0 and times[-1] <= duration):
        message = f"output times must lie from 0 to the duration of {duration} s"
        raise InputError(message)
    return times


def _sampled(phases: list[_Phase], time: Array) -> tuple[Array, Array, Array, Array]:
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


def _dataset(
    phases: list[_Phase], bounces: list[_Bounce], time: Array, evaluations: int
) -> xr.Dataset:
    x, velocity, force, permanent = _sampled(phases, time)
    series = {
        "displacement": (x, "m", "displacement of the sphere, upwards, 0 at first touch"),
        "velocity": (velocity, "m/s", "velocity of the sphere, upwards"),
        "force": (force, "N", "contact force"),
        "overlap": (np.maximum(-x, 0.0), "m", "overlap of sphere and flat"),
        "permanent_overlap_so_far": (permanent, "m", "permanent overlap so far"),
    }
    variables = {
        name: ("time", values, {"units": units, "long_name": text})
        for name, (values, units, text) in series.items()
    }
    for name, (units, text) in _ROWS.items():
        values = np.array([getattr(bounce, name) for bounce in bounces])
        variables[name] = ("impact", values, {"units": units, "long_name": text})
    restitution = variables["rebound_speed"][1] / variables["impact_speed"][1]
    labels = {"units": "1", "long_name": "coefficient of restitution"}
    variables["restitution"] = ("impact", restitution, labels)
    coordinates = {
        "time": ("time", time, {"units": "s", "long_name": "time from the release"}),
        "impact": ("impact", np.arange(len(bounces)), {"units": "1", "long_name": "impact"}),
    }
    work = json.dumps({"evaluations": evaluations, "phases": len(phases)})
    return xr.Dataset(variables, coordinates, {"work": work})


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            message = f"{name} is {value}, expected a positive number"
            raise InputError(message)

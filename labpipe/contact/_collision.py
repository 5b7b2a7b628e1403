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
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.units import Measure, require_positive, si
from labpipe.variables import variable

# Work that a motion may take: some 10 s.
_MAX_EVALUATIONS = 1_000_000
# A bounce lower than this part of the static overlap is rest: it cannot be seen. So is a swing in
# contact whose force differs from the weight by what this amplitude amounts to.
_REST_SHARE = 1e-3

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
    for name, value, is_inside, expected in (
        ("Poisson's ratio", nu, -1.0 < nu <= 0.5, "above -1 and at most 0.5"),
        ("damping", damping, 0.0 <= damping < np.inf, "a number from 0 up (N s/m^1.5)"),
        ("yield_depth", yield_depth, yield_depth > 0.0, "a positive length (m) or infinity"),
        ("unloading_multiplier", unloading_multiplier, 1.0 <= unloading_multiplier < np.inf, "a number from 1 up"),
        ("rtol", rtol, 1e-13 <= rtol <= 1e-3, "1e-13 to 1e-3"),
    ):
        if not is_inside:
            raise InputError(f"{name} is {value}, expected {expected}")
    stiffness = contact_stiffness(radius, youngs_modulus, nu, as_printed=as_printed)
    motion = _Motion(stiffness, damping, yield_depth, unloading_multiplier, as_printed, mass, gravity, rtol)
    motion.run(height, duration, impacts)
    phases, rows = motion.phases, np.array(motion.rows).reshape(-1, len(_ROWS)).T
    if time is None:
        times = np.unique(np.concatenate([phase.grid() for phase in phases]))
    else:
        times = np.asarray(time, dtype=float)
        if times.ndim != 1 or times.size == 0 or not np.all(np.diff(times) > 0.0):
            raise InputError(f"output times must be one rising row, found the shape {times.shape}")
        if not (times[0] >= 0.0 and times[-1] <= duration):
            raise InputError(f"output times must lie from 0 to the duration of {duration} s")
    table = dict(zip(_ROWS, rows, strict=True))
    # Energy gained in an impact by less than a millionth is rounding.
    if as_printed and np.any(table["energy_dissipated"] < -1e-6 * mass * table["impact_speed"] ** 2):
        warnings.warn(
            "the law as printed gained energy in an impact (its force jumps up where the sphere "
            "turns); use as_printed=False for unloading that loses energy",
            UserWarning,
            stacklevel=2,
        )
    which = np.searchsorted([phase.start for phase in phases], times, side="right") - 1
    x, velocity, force, permanent = np.zeros((4, times.size))
    for n in np.unique(which):
        used = which == n
        x[used], velocity[used], force[used] = phases[n].motion(times[used])
        permanent[used] = phases[n].permanent
    variables = {
        "displacement": variable("time", x, "m", "displacement of the sphere, upwards, 0 at first touch"),
        "velocity": variable("time", velocity, "m/s", "velocity of the sphere, upwards"),
        "force": variable("time", force, "N", "contact force"),
        "overlap": variable("time", np.maximum(-x, 0.0), "m", "overlap of sphere and flat"),
        "permanent_overlap_so_far": variable("time", permanent, "m", "permanent overlap so far"),
    }
    variables |= {name: variable("impact", values, *_ROWS[name]) for name, values in table.items()}
    restitution = table["rebound_speed"] / table["impact_speed"]
    variables["restitution"] = variable("impact", restitution, "1", "coefficient of restitution")
    coordinates = {
        "time": variable("time", times, "s", "time from the release"),
        "impact": variable("impact", np.arange(rows.shape[1]), "1", "impact"),
    }
    work = json.dumps({"evaluations": motion.evaluations, "phases": len(phases)})
    return xr.Dataset(variables, coordinates, {"work": work})


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


class _Phase(NamedTuple):
    """A stretch of smooth motion: position, velocity and force at times in [start, end]."""

    start: float
    end: float
    motion: Callable[[Floats], tuple[Floats, Floats, Floats]]
    permanent: float
    is_contact: bool

    def grid(self) -> Floats:
        """Return times (time,) in s to sample it at, its ends included."""
        return np.linspace(self.start, self.end, 65 if self.is_contact else 33)

    def last(self) -> tuple[float, float]:
        """Position and velocity at the end."""
        x, v, _ = self.motion(np.array([self.end]))
        return float(x[0]), float(v[0])


@dataclass
class _Motion:
    """The sphere's motion as a sequence of phases; x is the height of its lowest point.

    ``stiffness`` χ, ``damping`` c_v, ``yield_depth`` (overlap beyond which it is permanent), ``multiplier`` f and
    ``as_printed`` are those of the law; the flat remembers its ``deepest`` and its ``permanent`` overlap [m].
    """

    stiffness: float
    damping: float
    yield_depth: float
    multiplier: float
    as_printed: bool
    mass: float
    gravity: float
    rtol: float
    deepest: float = 0.0
    permanent: float = 0.0
    rest_speed: float = 0.0
    evaluations: int = 0
    phases: list[_Phase] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def run(self, height: float, duration: float, most: int | None) -> None:
        """Follow all phases up to ``duration`` [s], or so many contacts."""
        now, x, v, g = 0.0, height, 0.0, self.gravity
        static = (self.mass * g / self.stiffness) ** (2.0 / 3.0)
        self.rest_speed = float(np.sqrt(2.0 * g * _REST_SHARE * static))
        while now < duration and len(self.rows) != most:
            landing = now + (v + np.sqrt(v**2 + 2.0 * g * max(x + self.permanent, 0.0))) / g
            self._fall(now, x, v, min(float(landing), duration), g)
            now = self.phases[-1].end
            if now >= duration:
                return
            x, v = -self.permanent, self.phases[-1].last()[1]
            if -v <= self.rest_speed and self.rows:
                sag = (self.mass * g / (self.stiffness * self.multiplier)) ** (2.0 / 3.0)
                self._fall(now, x - sag, 0.0, duration, 0.0)
                return
            first = len(self.phases)
            lift, lifted_at, rebound = self._contact(now, x, v, duration)
            samples = [phase.motion(phase.grid()) for phase in self.phases[first:]]
            moved, force = (np.concatenate([sample[i] for sample in samples]) for i in (0, 2))
            lost = self.mass * (0.5 * (v**2 - rebound**2) + g * (x - lifted_at))
            self.rows.append((now, lift - now, -v, rebound, force.max(), -moved.min(), self.permanent, lost))
            now, (x, v) = self.phases[-1].end, self.phases[-1].last()

    def force(self, x: float, v: float, dent: tuple[float, float], *, loading: bool) -> float:
        """Contact force before it is clipped at zero, on a dent of a deepest and a permanent overlap [m]."""
        depth, (deepest, permanent), factor = -x, dent, self.multiplier
        if self.as_printed and loading:
            permanent, factor = max(permanent, depth - self.yield_depth), 1.0
        elif depth >= deepest and loading:
            permanent, factor = max(0.0, depth - self.yield_depth), 1.0
        elastic = max(depth - permanent, 0.0)
        return self.stiffness * factor * elastic**1.5 - self.damping * np.sqrt(elastic) * v

    def _fall(self, now: float, x: float, v: float, end: float, gravity: float) -> None:
        """Add a phase of constant acceleration: free fall, or with none rest under the weight."""
        push = self.mass * (self.gravity - gravity)

        def motion(t: Floats) -> tuple[Floats, Floats, Floats]:
            s = t - now
            return x + v * s - 0.5 * gravity * s**2, v - gravity * s, np.full_like(s, push)

        self.phases.append(_Phase(now, end, motion, self.permanent, is_contact=push > 0.0))

    def _contact(self, now: float, x: float, v: float, end: float) -> tuple[float, float, float]:
        """Follow one contact and the dent that it leaves; return when the force ended, x and v then, NaN if never."""
        while True:
            loading = v < 0.0
            phase, reason, released = self._integrate(now, x, v, end, loading=loading)
            now, (x, v) = phase.end, phase.last()
            if reason == "turned" and loading:
                v = 0.0
                self.deepest = max(-x, self.deepest)
                plastic = max(0.0, self.deepest - self.yield_depth)
                if not self.as_printed:  # unloading starts at the force that loading has reached
                    plastic = self.deepest - (self.deepest - plastic) * self.multiplier ** (-2.0 / 3.0)
                self.permanent = max(self.permanent, plastic)
            self.phases.append(phase._replace(permanent=self.permanent))
            if reason == "left":
                return released
            # At a turn either law may carry the weight closely enough to be at rest.
            forces = np.array(
                [self.force(x, 0.0, (self.deepest, self.permanent), loading=way) for way in (True, False)]
            )
            is_resting = np.all(np.abs(forces / (self.mass * self.gravity) - 1.0) < 1.5 * _REST_SHARE)
            if reason == "turned" and is_resting:
                self._fall(now, x, 0.0, end, 0.0)
            if reason == "end" or is_resting:
                return np.nan, np.nan, np.nan
            if not loading:  # it turns downwards without having left: it may come to rest here
                v = -np.finfo(float).tiny

    def _integrate(
        self, now: float, x: float, v: float, end: float, *, loading: bool
    ) -> tuple[_Phase, str, tuple[float, float, float]]:
        """Follow the contact until its speed turns, it leaves or the time is over; say when the force ended too."""
        dent = _, permanent = self.deepest, self.permanent

        def unclipped(state: Floats) -> float:
            return self.force(float(state[0]), float(state[1]), dent, loading=loading)

        def rates(_t: float, state: Floats) -> list[float]:
            push = max(unclipped(state), 0.0)
            return [float(state[1]), push / self.mass - self.gravity]

        def turned(_t: float, state: Floats) -> float:
            return float(state[1])

        def left(_t: float, state: Floats) -> float:
            return float(-state[0] - permanent)

        def released(_t: float, state: Floats) -> float:
            # Divided by the root of the overlap, so that it crosses zero with a slope.
            elastic = max(float(-state[0]) - permanent, 0.0)
            return self.stiffness * self.multiplier * elastic - self.damping * float(state[1])

        events = [turned, left, released]
        for event, is_last, direction in zip(
            events, (True, True, False), (1.0 if loading else -1.0, -1.0, -1.0), strict=True
        ):
            event.terminal, event.direction = is_last, direction  # type: ignore[attr-defined]
        scale = np.array([max(abs(x), self.rest_speed**2 / self.gravity), abs(v) + self.rest_speed])
        # Time counts from the touch, so that a long fall before it costs no digits.
        span, tolerance = (0.0, end - now), {"rtol": self.rtol, "atol": self.rtol * scale}
        solution = solve_ivp(rates, span, [x, v], method="DOP853", events=events, dense_output=True, **tolerance)
        if not solution.success:
            raise InputError(f"the motion could not be integrated at {now:.6g} s: {solution.message}")
        self.evaluations += int(solution.nfev)
        if self.evaluations > _MAX_EVALUATIONS:
            raise InputError(
                f"the motion took {self.evaluations} evaluations of the force up to {now:.6g} s of {end:.6g} s; give a "
                "shorter duration, a higher drop or more damping"
            )

        def motion(t: Floats) -> tuple[Floats, Floats, Floats]:
            states = np.atleast_2d(solution.sol(t - now).T)
            force = np.array([max(unclipped(state), 0.0) for state in states])
            return states[:, 0], states[:, 1], force

        phase = _Phase(now, now + float(solution.t[-1]), motion, permanent, is_contact=True)
        free = (phase.end, *phase.last())
        if solution.t_events[2].size and not loading:
            height, speed = solution.y_events[2][-1].tolist()
            free = now + float(solution.t_events[2][-1]), height, speed
        found = [event.__name__ for event, at in zip(events[:2], solution.t_events, strict=False) if at.size]
        return phase, found[0] if found else "end", free

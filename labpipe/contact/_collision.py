r"""Appendix A: a bouncing sphere with a Hertz spring, a dashpot, a yield depth and stiff unloading.

A semi-empirical model that the thesis fitted before its boundary elements. With the overlap
ζ = a − y_c,

.. math::
    m \ddot y_c = -m g + \max(0, \chi \zeta_{el}^{3/2} + c_v \sqrt{\zeta_{el}} \dot\zeta),
    \qquad \zeta_{el} = \zeta - \zeta_{perm}.

Two versions:

- ``as_printed=True`` (figure A.1): χ = 2E√a/(3(1 − ν²)), the law of two *identical* spheres; permanent overlap
  max(ζ − ζ_yield) and stiffness χ f while unloading, equation (A.8), so that for f > 1 the force jumps up where the
  motion turns and the model *gains* energy there;
- default: χ = 4E√a/(3(1 − ν²)), a sphere on a rigid flat, twice as much; unloading with stiffness χ f starts at the
  force that loading has reached, so that energy is lost: e = f^{-1/3} without damping.

The total force never pulls. The material has no memory; for that use :func:`labpipe.contact.drop`.

References
----------
.. [1] N. V. Brilliantov, F. Spahn, J.-M. Hertzsch, T. Pöschel, Phys. Rev. E 53 (1996) 5382,
   https://doi.org/10.1103/PhysRevE.53.5382.
.. [2] O. R. Walton, R. L. Braun, J. Rheol. 30 (1986) 949, https://doi.org/10.1122/1.549893.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from labpipe.arrays import Floats
from labpipe.contact._memory import checked_times
from labpipe.errors import InputError
from labpipe.units import Measure, require_positive, si
from labpipe.variables import variable

# Work that a motion may take: some 10 s.
_MAX_EVALUATIONS = 1_000_000
# A bounce lower than this part of the static overlap is rest: it cannot be seen. So is a swing in
# contact whose force differs from the weight by what this amplitude amounts to.
_REST_SHARE = 1e-3

_SERIES = {
    "displacement": ("m", "displacement of the sphere, upwards, 0 at first touch"),
    "velocity": ("m/s", "velocity of the sphere, upwards"),
    "force": ("N", "contact force"),
}
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
        Positive.
    as_printed : bool
        The thesis's χ and unloading, see the module.
    time : array (time,) [s], optional
        Output times from the release on, rising; by default the phases of the motion are sampled.
    impacts : int, optional
        After which the motion is no longer followed; by default all until the end are.
    rtol : float
        Relative error of each step within a contact, 1e-13 to 1e-3; flights are exact.

    Returns
    -------
    Dataset
        Over ``time`` (0 at release): ``displacement`` [m] (upwards, 0 at first touch), ``velocity`` [m/s], ``force``
        [N]; over ``impact``: ``impact_time``, ``contact_duration`` [s], ``impact_speed``, ``rebound_speed`` [m/s],
        ``restitution``, ``peak_force`` [N], ``peak_overlap``, ``permanent_overlap`` [m], ``energy_dissipated`` [J]. A
        sphere that comes to rest leaves the last impact without a rebound: NaN.

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
    phases, table = motion.phases, dict(zip(_ROWS, np.array(motion.rows).reshape(-1, len(_ROWS)).T, strict=True))
    own = np.unique(np.concatenate([sampled for sampled, _ in phases]))
    times = own if time is None else checked_times(time, duration)
    # Energy gained in an impact by less than a millionth is rounding.
    if as_printed and np.any(table["energy_dissipated"] < -1e-6 * mass * table["impact_speed"] ** 2):
        warnings.warn(
            "the law as printed gained energy in an impact (its force jumps up where the sphere "
            "turns); use as_printed=False for unloading that loses energy",
            UserWarning,
            stacklevel=2,
        )
    which = np.searchsorted([sampled[0] for sampled, _ in phases], times, side="right") - 1
    moved = np.concatenate([phases[n][1](times[which == n]) for n in np.unique(which)], axis=1)
    variables = {name: variable("time", row, *words) for row, (name, words) in zip(moved, _SERIES.items(), strict=True)}
    variables |= {name: variable("impact", values, *_ROWS[name]) for name, values in table.items()}
    restitution = table["rebound_speed"] / table["impact_speed"]
    variables["restitution"] = variable("impact", restitution, "1", "coefficient of restitution")
    coordinates = {
        "time": variable("time", times, "s", "time from the release"),
        "impact": variable("impact", np.arange(restitution.size), "1", "impact"),
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


# A stretch of smooth motion: times (time,) [s] that sample it with its ends, and height, speed and force at any.
_Phase = tuple[Floats, Callable[[Floats], Floats]]


@dataclass
class _Motion:
    """The sphere's motion as a sequence of phases; x is its lowest point."""

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
    evaluations: int = 0
    rest_speed: float = 0.0
    phases: list[_Phase] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def run(self, height: float, duration: float, most: int | None) -> None:
        """Follow all phases up to ``duration`` [s], or so many contacts."""
        now, x, v, g = 0.0, height, 0.0, self.gravity
        static = (self.mass * g / self.stiffness) ** (2.0 / 3.0)
        self.rest_speed = math.sqrt(2.0 * g * _REST_SHARE * static)
        while len(self.rows) != most:
            speed = math.sqrt(max(v**2 + 2.0 * g * (x + self.permanent), 0.0))
            landing = now + (v + speed) / g
            self._coast(now, min(landing, duration), x, v, g)
            if landing >= duration:
                return
            now, x, v = landing, -self.permanent, -speed
            if speed <= self.rest_speed and self.rows:
                sag = (self.mass * g / (self.stiffness * self.multiplier)) ** (2.0 / 3.0)
                self._coast(now, duration, x - sag, 0.0, 0.0)
                return
            first = len(self.phases)
            lifted = self._contact(now, x, v, duration)
            moved = np.concatenate([motion(times) for times, motion in self.phases[first:]], axis=1)
            at, risen, rebound = lifted or (math.nan, math.nan, math.nan)
            lost = self.mass * (0.5 * (v**2 - rebound**2) + g * (x - risen))
            self.rows.append((now, at - now, -v, rebound, moved[2].max(), -moved[0].min(), self.permanent, lost))
            if lifted is None:
                return
            now, x, v = lifted

    def force(self, x: float, v: float, dent: tuple[float, float], *, loading: bool) -> float:
        """Contact force before it is clipped at zero, on a dent of a deepest and a permanent overlap [m]."""
        depth, (deepest, permanent), factor = -x, dent, self.multiplier
        if self.as_printed and loading:
            permanent, factor = max(permanent, depth - self.yield_depth), 1.0
        elif depth >= deepest and loading:
            permanent, factor = max(0.0, depth - self.yield_depth), 1.0
        elastic = max(depth - permanent, 0.0)
        return self.stiffness * factor * elastic**1.5 - self.damping * math.sqrt(elastic) * v

    def _coast(self, now: float, end: float, x: float, v: float, gravity: float) -> None:
        """Add a phase of constant acceleration: free flight, or with none rest under the weight."""
        push = self.mass * (self.gravity - gravity)

        def motion(t: Floats) -> Floats:
            s = t - now
            return np.stack([x + v * s - 0.5 * gravity * s**2, v - gravity * s, np.full_like(s, push)])

        self.phases.append((np.linspace(now, end, 33), motion))

    def _contact(self, now: float, x: float, v: float, end: float) -> tuple[float, float, float] | None:
        """Follow a contact and the dent that it leaves; return when its force ended, x and v then, None if never."""
        g = self.gravity
        while True:
            loading = v < 0.0
            now, x, v, reason = self._integrate(now, x, v, end, loading=loading)
            if reason == "end":
                return None
            if reason == "released":
                if x + 0.5 * v**2 / g > -self.permanent:
                    return now, x, v
                self._coast(now, min(now + v / g, end), x, v, g)  # it rises without force, and falls back
                now, x = now + v / g, x + 0.5 * v**2 / g
                if now >= end:
                    return None
            # At a turn either law may carry the weight closely enough to be at rest.
            forces = [self.force(x, 0.0, (self.deepest, self.permanent), loading=way) for way in (True, False)]
            if all(abs(force / (self.mass * g) - 1.0) < 1.5 * _REST_SHARE for force in forces):
                self._coast(now, end, x, 0.0, 0.0)
                return None
            v = 0.0 if loading else -np.finfo(float).tiny

    def _integrate(
        self, now: float, x: float, v: float, end: float, *, loading: bool
    ) -> tuple[float, float, float, str]:
        """Follow the contact until its speed turns, its force ends or the time is over; return the state then."""
        dent = _, permanent = self.deepest, self.permanent

        def pushed(state: Floats) -> float:
            return max(self.force(float(state[0]), float(state[1]), dent, loading=loading), 0.0)

        def rates(_t: float, state: Floats) -> list[float]:
            return [float(state[1]), pushed(state) / self.mass - self.gravity]

        def turned(_t: float, state: Floats) -> float:
            return float(state[1])

        def released(_t: float, state: Floats) -> float:
            # Divided by the root of the overlap, so that it crosses zero with a slope.
            return self.stiffness * self.multiplier * (float(-state[0]) - permanent) - self.damping * float(state[1])

        events: list[Any] = [turned] if loading else [turned, released]
        for event in events:
            event.terminal, event.direction = True, 1.0 if loading else -1.0
        scale = np.array([max(abs(x), self.rest_speed**2 / self.gravity), abs(v) + self.rest_speed])
        # Time counts from the touch, so that a long fall before it costs no digits.
        span, tolerance = (0.0, end - now), {"rtol": self.rtol, "atol": self.rtol * scale}
        solution = solve_ivp(rates, span, [x, v], method="DOP853", events=events, dense_output=True, **tolerance)
        self.evaluations += int(solution.nfev)
        if not solution.success or self.evaluations > _MAX_EVALUATIONS:
            raise InputError(
                f"the motion took {self.evaluations} evaluations of the force up to {now:.6g} s of {end:.6g} s; give a "
                f"shorter duration, a higher drop or more damping ({solution.message})"
            )

        def motion(t: Floats) -> Floats:
            states = solution.sol(t - now)
            return np.vstack([states, [pushed(state) for state in states.T]])

        found = [event.__name__ for event, at in zip(events, solution.t_events, strict=True) if at.size]
        reached, (last, speed, _) = now + float(solution.t[-1]), motion(np.array([now + solution.t[-1]]))[:, 0].tolist()
        if loading and found:
            self.deepest = max(-last, self.deepest)
            plastic = max(0.0, self.deepest - self.yield_depth)
            if not self.as_printed:  # unloading starts at the force that loading has reached
                plastic = self.deepest - (self.deepest - plastic) * self.multiplier ** (-2.0 / 3.0)
            self.permanent = max(self.permanent, plastic)
        self.phases.append((np.linspace(now, reached, 65), motion))
        return reached, last, speed, found[0] if found else "end"

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

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.contact.lumped._motion import Bounce, CollisionLaw, Motion, Phase, grid
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
    law = _law(radius, youngs_modulus, nu, damping, yield_depth, unloading_multiplier, as_printed)
    require_positive(mass=mass, height=height, duration=duration, gravity=gravity)
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


def _law(
    radius: float,
    youngs_modulus: float,
    nu: float,
    damping: float,
    yield_depth: float,
    unloading_multiplier: float,
    as_printed: bool,
) -> CollisionLaw:
    require_positive(radius=radius, youngs_modulus=youngs_modulus)
    if not -1.0 < nu <= 0.5:
        raise InputError(f"Poisson's ratio is {nu}, expected above -1 and at most 0.5")
    if not (np.isfinite(damping) and damping >= 0.0):
        raise InputError(f"damping is {damping} N s/m^1.5, expected a number from 0 up")
    if not yield_depth > 0.0:
        raise InputError(f"yield_depth is {yield_depth} m, expected a positive length or infinity")
    if not (np.isfinite(unloading_multiplier) and unloading_multiplier >= 1.0):
        raise InputError(f"unloading_multiplier is {unloading_multiplier}, expected a number from 1 up")
    stiffness = contact_stiffness(radius, youngs_modulus, nu, as_printed=as_printed)
    return CollisionLaw(stiffness, damping, yield_depth, unloading_multiplier, as_printed)


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

"""A sphere on a viscoelastic half-space under a prescribed load or approach: static loading of thesis chapter 3."""

from __future__ import annotations

import json
from typing import Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep, checked_history, checked_load
from labpipe.contact._springs import sphere_bed
from labpipe.contact._stepping import Control, March
from labpipe.contact.sphere._counter_body import Substrate, counter_compliance
from labpipe.contact.sphere.hertz import static_approach, static_load
from labpipe.errors import InputError
from labpipe.materials import Solid, solid
from labpipe.units import Measure, si
from labpipe.variables import variable

Profile = Literal["parabola", "sphere"]

# Springs within the largest contact radius: force good to 1e-6, radius to 1e-5 where the pressure falls smoothly to
# zero; where a relaxation far shorter than the loading leaves hardly an instantaneous compliance, force to 5e-4.
_SPRINGS = 400
# The exact sphere has another gap; springs a little beyond the parabola's reach cover it.
_SPARE_REACH = 1.02


def load_sphere(
    material: Solid,
    radius: Measure,
    time: ArrayLike,
    load: ArrayLike,
    *,
    profile: Profile = "parabola",
    substrate: Substrate = None,
    rtol: float = 1e-4,
) -> xr.Dataset:
    """Approach and contact radius of a sphere under a history of load.

    Parameters
    ----------
    material : Prony, or str
        Viscoelastic body, or its name.
    radius : float, or text with a unit [m]
        Of the sphere.
    time : array (time,) [s]
        Never falling. A load step is two samples at one time; a first load above 0 is a step.
    load : array (time,) [N]
        At least 0, linear between the samples.
    profile : {"parabola", "sphere"}
        Shape of the gap; the exact sphere differs by 7e-4 in force at a/R = 0.08.
    substrate : "sapphire", (float [Pa], float) or None
        Elastic counter-body: a name, or Young's modulus and Poisson's ratio; None is a rigid one.
    rtol : float
        Error to aim at, over the largest force (or approach, by load).

    Returns
    -------
    Dataset
        Over ``time``: ``approach`` [m], ``force`` [N], ``contact_radius`` [m]; attribute ``work`` (JSON counts).

    Raises
    ------
    InputError
        A load is negative, the history has a gap or runs backwards, the radius is not positive, or the contact would
        not be small against the sphere.

    See Also
    --------
    press_sphere : the same by prescribed approach.
    labpipe.contact.drop : with inertia.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> acrylic = Prony(2e9, [2e9], [0.5e-3], nu=0.35)
    >>> found = load_sphere(acrylic, 9.525e-3, [0.0, 10.0], [4.954, 4.954])
    >>> np.round(found.approach.values * 1e6, 3)
    array([4.116, 6.534])
    """
    body = material, radius, substrate, profile
    return _pressed(body, *checked_load(time, load), "force", rtol)


def press_sphere(
    material: Solid,
    radius: Measure,
    time: ArrayLike,
    approach: ArrayLike,
    *,
    profile: Profile = "parabola",
    substrate: Substrate = None,
    rtol: float = 1e-4,
) -> xr.Dataset:
    """Force and contact radius of a sphere under a history of approach.

    Parameters
    ----------
    approach : array (time,) [m]
        Positive inwards from first touch of the undeformed surface, linear between the samples.

    See Also
    --------
    load_sphere : the other parameters and the returned Dataset.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> body = Prony(0.1, [0.9], [1.0], nu=0.0)
    >>> found = press_sphere(body, 1.0, [0.0, 1.0], [0.0, 1e-2])
    >>> round(float(found.force[1] / (4 / 3 * 1e-3)), 4)
    0.7236
    """
    body = material, radius, substrate, profile
    return _pressed(body, *checked_history(time, approach, "approach"), "displacement", rtol)


def _pressed(
    body: tuple[Solid, Measure, Substrate, str], time: Floats, value: Floats, control: Control, rtol: float
) -> xr.Dataset:
    """March springs out to the largest contact radius through a checked history of load or approach."""
    material, stated, substrate, profile = body
    creep, radius = Creep.of(solid(material)).on(counter_compliance(substrate)), si(stated, "m", "radius")
    largest = max(float(value.max()), np.finfo(float).tiny)
    if control == "force":
        softest = float(creep.compliance(float(time[-1] - time[0])))
        reach = float(static_load(largest, radius, 1.0 / softest).contact_radius)
    else:
        reach = float(static_approach(largest, radius, 1.0).contact_radius)
    if profile not in ("parabola", "sphere"):
        raise InputError(f'profile "{profile}" is unknown; use "parabola" or "sphere"')
    if profile == "sphere" and _SPARE_REACH * reach * (1.0 + 2.0 / _SPRINGS) >= radius:
        raise InputError(
            f"the contact would be as wide as the sphere ({reach:.4g} m against a radius of "
            f"{radius:.4g} m); reduce the load or the approach"
        )
    limit = "the contact reaches the end of the springs; give a smaller load or approach"
    march = March(sphere_bed(radius, _SPARE_REACH * reach, _SPRINGS, profile), creep, control, rtol, limit)
    answers = np.array([answer[:3] for answer in map(np.copy, march.run(time, value))])
    columns = {
        "approach": ("m", "Approach of the sphere", answers[:, 0]),
        "force": ("N", "Normal force", answers[:, 1]),
        "contact_radius": ("m", "Contact radius", answers[:, 2]),
    }
    counts = march.counts | {"springs": march.contact.size, "terms": creep.n_terms}
    return xr.Dataset(
        {name: variable("time", values, units, text) for name, (units, text, values) in columns.items()},
        {"time": variable("time", time, "s", "Time")},
        {"work": json.dumps(counts)},
    )

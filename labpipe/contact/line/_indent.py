r"""Indentation of a viscoelastic half-plane or bonded layer by a periodic row of tips.

Thesis chapter 2, with another time integration than its eqs. (2.13) to (2.15): the hereditary
integral of a Prony series is exact by a recursion whose cost does not grow with the history (R. L.
Taylor, K. S. Pister, G. L. Goudreau, 1970, https://doi.org/10.1002/nme.1620020106;
:mod:`labpipe.contact.memory`), and a nested contact needs no linear solve
(:mod:`labpipe.contact.springs`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.contact.line._simulate import DEFAULT_RTOL, Output, Request, simulate
from labpipe.contact.memory import checked_history, checked_load
from labpipe.materials import Solid, solid
from labpipe.units import Measure, si


def indent(
    material: Solid,
    tip_radius: Measure,
    period: Measure,
    depth: Measure,
    time: ArrayLike,
    displacement: ArrayLike,
    profile: str | ArrayLike = "parabola",
    thickness: Measure = np.inf,
    elements: int | None = None,
    *,
    rtol: float | None = DEFAULT_RTOL,
    outputs: Sequence[Output] = (),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Press a periodic row of tips into a viscoelastic surface by a prescribed displacement.

    Lengths are numbers in SI or texts with a unit, ``"2 mm"``.

    Parameters
    ----------
    material : Prony, or str
        Viscoelastic solid, or its name; no terms is an elastic one.
    tip_radius : float [m]
        Radius of curvature R of a tip.
    period : float [m]
        Distance λ between tips.
    depth : float [m]
        Out-of-plane contact length, summed over the tips: forces are line force times depth.
    time : array (time,) [s]
        Irregular as you like, never falling; two samples at one time are a jump. The surface is
        undeformed before the first sample; a first displacement in contact is a jump.
    displacement : array (time,) [m]
        Approach, positive into the surface, from first touch of the undeformed surface; linear
        between the samples. Negative is out of contact.
    profile : {"parabola", "circle", "cosine"} or array (element,) [m]
        Shape of a tip, or heights over one period at x = (i − N/2) λ/N, infinite where there is no
        indenter. Parabola and circle differ by 0.7 % in force at δ = R/10. An array's displacement
        counts from height 0.
    thickness : float [m]
        Of the layer bonded to a rigid base; infinite for the half-plane.
    elements : int, optional
        Strips per period, even; 1024, or the length of the profile's array.
    rtol : float or None
        Error to aim at, over the largest force (or approach, by load); steps adapt, at least two
        between samples. None takes one step whatever their distance.
    outputs : sequence of {"pressure", "surface", "energy"}
        Further variables.
    progress : callable, optional
        Called now and then with the fraction of the samples that is done.

    Returns
    -------
    Dataset
        Over ``time``: ``displacement`` [m], ``force`` [N], ``contact_half_width`` [m] (half of the
        total contact length of a period). On request ``pressure`` [Pa], ``surface`` [m] (positive
        into the body) over (``time``, ``x``); ``work_done``, ``stored_energy``,
        ``dissipated_energy`` [J]. Attributes: ``work`` (JSON counts), ``solver``,
        ``datum`` of displacements ("mean surface" or "rigid base (absolute)"),
        and with energies ``energy_error``: the largest difference of the work done and what is
        stored and dissipated, relative to the work; it is what the steps in time mislay.

    Raises
    ------
    InputError
        A value lies outside its domain, the history has a gap or runs backwards, a
        half-plane would be in full contact, a circle in contact at ``|x| = R``, or the contact
        does not grow and shrink from the centre of the period.

    Notes
    -----
    Constant Poisson's ratio, no friction, no adhesion, small slopes. A half-plane's approach is
    relative to the mean surface, because its mean displacement is not defined.

    References
    ----------
    Thesis eqs. (2.7)-(2.16).

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> rubber = Prony(7.6e6, [], [], nu=0.5)
    >>> result = indent(rubber, 2e-3, 8e-3, 18e-3, [0.0], [1e-4], profile="cosine")
    >>> round(float(result.force[0]), 1)
    12.4
    """
    times, values = checked_history(time, displacement, "displacement")
    request = _request(material, tip_radius, period, depth, profile, thickness, elements)
    return simulate(request, times, values, "displacement", rtol, outputs, progress)


def indent_load(
    material: Solid,
    tip_radius: Measure,
    period: Measure,
    depth: Measure,
    time: ArrayLike,
    load: ArrayLike,
    profile: str | ArrayLike = "parabola",
    thickness: Measure = np.inf,
    elements: int | None = None,
    *,
    rtol: float | None = DEFAULT_RTOL,
    outputs: Sequence[Output] = (),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Press a periodic row of tips into a viscoelastic surface by a prescribed load.

    Parameters
    ----------
    load : array (time,) [N]
        Compressive load, at least 0, linear between the samples; a first load above 0 is a jump.

    Returns
    -------
    Dataset
        As :func:`indent`; ``displacement`` is the solution. Without load it is where the tip just
        touches the recovering surface.

    Raises
    ------
    InputError
        As :func:`indent`; or a load is negative.

    See Also
    --------
    indent : all other parameters, and the same run by displacement.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> rubber = Prony(7.6e6, [], [], nu=0.5)
    >>> result = indent_load(rubber, 2e-3, 8e-3, 18e-3, [0.0], [12.4], profile="cosine")
    >>> round(float(result.displacement[0]) * 1e3, 3)
    0.1
    """
    times, values = checked_load(time, load)
    request = _request(material, tip_radius, period, depth, profile, thickness, elements)
    return simulate(request, times, values, "force", rtol, outputs, progress)


def _request(
    material: Solid,
    tip_radius: Measure,
    period: Measure,
    depth: Measure,
    profile: str | ArrayLike,
    thickness: Measure,
    elements: int | None,
) -> Request:
    """Bring what was given to SI."""
    lengths = {"tip_radius": tip_radius, "period": period, "depth": depth, "thickness": thickness}
    in_si = {name: si(value, "m", name) for name, value in lengths.items()}
    return Request(solid(material), profile=profile, elements=elements, **in_si)

"""Radius of the contact between a sphere and a flat, from a film of its interference fringes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from labpipe.frames import FrameSource, as_frames
from labpipe.units import Measure, Quantity, si

if TYPE_CHECKING:
    import xarray as xr


def contact_radius(
    frames: FrameSource | NDArray[np.generic],
    pixel_size: Measure,
    sphere_radius: Measure,
    wavelength: Measure | None,
    exposure: Measure | NDArray[np.float64] | None = None,
    *,
    phase: float | None = None,
    shape: Literal["auto", "circle", "ellipse"] = "auto",
    fringes: float = 3.0,
    full: bool = False,
    any_disc: bool = False,
    reduced_modulus: Measure | None = None,
    work_of_adhesion: Measure | None = None,
    u_work_of_adhesion: Measure = 0.0,
    u_pixel_size: Measure = 0.0,
    u_sphere_radius: Measure = 0.0,
    u_wavelength: Measure = 0.0,
    u_phase: float = 0.0,
) -> xr.Dataset:
    """Measure the radius of a contact in every frame of a film.

    Lengths and times are numbers in SI or texts with a unit, ``"4.1 um"``, ``"633 nm"``.

    Parameters
    ----------
    frames : FrameSource or array (frame, row, column)
        Grey images of the contact seen through the flat, linear in light; real numbers in any unit.
    pixel_size : float [m]
        Width of a pixel in the plane of the contact.
    sphere_radius : float [m]
        Effective radius of curvature.
    wavelength : float or None [m]
        Wavelength of the light; None for white or unknown light: then only the edge of the spot is measured, for a
        nominal wavelength of 550 nm.
    exposure : float or array (frame,), optional [s]
        Exposure time; by default that of the film. It determines how far the radius moves while the shutter is open,
        and its acceleration shifts the mean over the exposure.
    phase : float, optional [rad]
        Phase in the contact, π where it is dark, 0 where it is bright. By default found from the film.
    shape : "auto", "circle" or "ellipse"
        Whether circles are ellipses (oblique view, unequal scales): when the largest contacts of the film say so,
        never, or free in every frame.
    fringes : float
        Number of fringes used, half a wavelength of gap each. Three hold nearly all that is known about the radius;
        more multiply the effect of an error in R or the wavelength.
    full : bool
        Read and fit every frame: no shortcuts.
    any_disc : bool
        Whether every sharp disc without fringes is a contact. By default one is only when it lies where fringes show
        contacts in the frames around it, or, where none are resolved, when it grows or shrinks as a contact does.
    reduced_modulus : float, optional [Pa]
        E* = E/(1 - ν²). With it the edge of an adhesive contact is determined, and adhesion enters the systematic
        budget.
    work_of_adhesion : float, optional [J/m2]
        w of the surfaces; by default anything up to 50 mJ/m², that of a clean smooth polymer. 0 for surfaces that do
        not stick.
    u_work_of_adhesion : float, optional [J/m2]
        Its standard uncertainty.
    u_pixel_size, u_sphere_radius, u_wavelength : float, optional [m]
        Standard uncertainties, for the systematic budget.
    u_phase : float, optional [rad]
        Standard uncertainty of the phase, for the budget.

    Returns
    -------
    Dataset over ``frame``
        ``radius`` : Hertz-equivalent radius in the middle of the exposure, that of the Hertz contact with the same gap
        around it; for ellipses of the circle of equal area [m]; NaN where there is none; ``u_radius`` : its standard
        uncertainty from noise, from errors of the model where the residual exceeds noise, and from the acceleration
        within the exposure (with "edge": that of the estimate) [m]; ``radius_systematic`` : standard uncertainty that
        all frames share, and ``systematic_part`` (frame, source) its parts, from the uncertainties given [m];
        ``edge_radius``, ``u_edge_radius`` : of the edge of the contact by JKR, farther out where the surfaces stick,
        with its whole standard uncertainty, also if they attract each other across up to a nanometre (Maugis), where it
        lies nearer to Hertz's; NaN without a modulus [m]; ``centre_x``, ``centre_y`` [px] with ``u_``; ``in_contact`` :
        whether there is a contact; ``radius_bound`` : where the sphere touches or hovers, which counts as no contact,
        the radius that one would not exceed [m]; ``valid`` : False for damaged frames; ``method`` : 0 none, 1 fringe
        fit, 2 edge, 3 between equal frames (a frame at rest that was not read whole; the radius is interpolated), 4
        wider than the frame (in contact, without a radius), 5 fringe fit of a gap that is not Hertz's (on a body that
        still recovers); ``travel`` : change of the radius during the exposure as the blur shows it, without sign [m];
        ``misfit`` : residual beyond noise as a share of the modulation [1]; ``gap_factor`` : factor of the gap beside
        the contact against Hertz's, 1 unless fitted [1]; ``residual_ratio`` : residual divided by noise [1];
        ``visibility`` [1]; ``semi_axis_major``, ``semi_axis_minor`` [m], ``axis_angle`` (major axis, from x towards y)
        [rad]. Attributes: ``phase`` (used) and ``u_phase`` (rad), ``phase_scale_ratio`` with
        ``u_`` (found / given of 1/(λ R), 1 where the film does not contradict),
        ``flat_radius`` (of a flat worn into the sphere, 0 for none) [m], ``blur`` (of the lens) [px], ``least_radius``
        (below it a contact cannot be distinguished from a touch, and counts as none) [m], ``wavelength_used``,
        ``note``, ``work`` (counts).

    Raises
    ------
    InputError
        A value out of its range, or frames that are not grey images.

    Warns
    -----
    UserWarning
        The fringes contradict R, wavelength or pixel size; frames were measured by the edge of the spot or damaged; the
        sphere is worn flat; the wavelength is not known; fringes are finer than pixels.

    Notes
    -----
    Adhesion opens the gap in the same shape as a smaller Hertz contact, so that fringes show a Hertz-equivalent radius:
    that which a model without adhesion should be compared with. The edge of a contact that sticks lies R √(πw/(2aE*))
    farther out (:func:`.adhesive_edge`).

    The gap of a Hertz contact opens like (r - a)^(3/2), so that the image shows no edge at r = a. The radius follows
    from a fit of the interference pattern of the first fringes to all pixels of a ring, with centre, light and its
    slopes, visibility and the blur by the motion of the radius as further unknowns. Phase, scale, blur of the lens,
    oblique view, coherence, harmonics of many beams, uneven light and a flat worn into the sphere are determined once
    per film, where they explain its largest contacts better by the Bayesian information criterion. An error of the
    model that remains widens ``u_radius`` by the jackknife over parts of the ring. Next to every contact that does not
    stick the gap opens with the power 3/2, with Hertz's factor unless the body still recovers from a dent: where
    Hertz's gap does not explain a frame, the factor is fitted too. A dark centre alone is no contact: in coherent light
    a sphere that touches without load, or hovers, differs from a small contact by the phase of the gap only. A contact
    must agree with the frames around it: it grows from nothing and returns to it within its duration.

    Examples
    --------
    >>> y, x = np.mgrid[:128, :160]
    >>> r = np.maximum(4e-6 * np.hypot(x - 80.2, y - 63.7) / 150e-6, 1.0)
    >>> gap = 150e-6**2 / (np.pi * 9.525e-3) * (np.sqrt(r**2 - 1.0) + (r**2 - 2.0) * np.arccos(1.0 / r))
    >>> image = 120.0 * (1.0 - 0.8 * np.cos(4.0 * np.pi * gap / 633e-9))
    >>> found = contact_radius(np.stack([image]).astype(np.uint8), 4e-6, 9.525e-3, 633e-9)
    >>> bool(abs(found.radius[0] - 150e-6) < 0.1e-6), int(found.method[0])
    (True, 1)

    References
    ----------
    A. Ovcharenko et al., Tribol. Lett. 23 (2006) 55-63, https://doi.org/10.1007/s11249-006-9113-9
    """
    from labpipe.imaging.films import in_grey_levels
    from labpipe.imaging.fringes._arguments import FilmOptions, check_film
    from labpipe.imaging.fringes._dataset import make_dataset
    from labpipe.imaging.fringes._film import measure_film

    film = as_frames(frames)
    options = FilmOptions(
        si(pixel_size, "m or m/px", "pixel_size"),
        si(sphere_radius, "m", "sphere_radius"),
        None if wavelength is None else si(wavelength, "m", "wavelength"),
        si(exposure, "s", "exposure") if isinstance(exposure, str | Quantity) else exposure,
        phase,
        shape,
        fringes,
        full,
        None if reduced_modulus is None else si(reduced_modulus, "Pa", "reduced_modulus"),
        None if work_of_adhesion is None else si(work_of_adhesion, "J/m2", "work_of_adhesion"),
        any_disc,
    )
    check_film(film, options)
    uncertainties = {
        "pixel_size": si(u_pixel_size, "m or m/px", "u_pixel_size"),
        "sphere_radius": si(u_sphere_radius, "m", "u_sphere_radius"),
        "wavelength": si(u_wavelength, "m", "u_wavelength"),
        "phase": u_phase,
        "work_of_adhesion": si(u_work_of_adhesion, "J/m2", "u_work_of_adhesion"),
    }
    film = in_grey_levels(film)
    return make_dataset(film, options, measure_film(film, options), uncertainties)

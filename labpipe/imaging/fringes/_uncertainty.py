"""Uncertainty that all radii of a film share; that of single frames is in :mod:`._ring_fit` and :mod:`._motion`."""

import math

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.imaging.fringes._adhesive_edge import NOMINAL_WAVELENGTH, edge_shift
from labpipe.imaging.fringes._arguments import FilmOptions
from labpipe.imaging.fringes._film_result import FilmResult
from labpipe.imaging.fringes._ring_fit import OPTICAL, Parameter, RingFit

#: Sources of the systematic budget, in the order of the coordinate.
SOURCES = ("sphere_radius", "wavelength", "pixel_size", "phase", "adhesion")


def systematic(fit: RingFit, result: FilmResult, options: FilmOptions, uncertainties: dict[str, float]) -> Floats:
    """Parts of the systematic uncertainty (m), in the order of :data:`SOURCES`.

    R, wavelength and pixel size change the scale of the phase; pixel size also the length itself. With the phase count
    the other properties of the optics that the film was calibrated for.
    """
    pixel, u = options.pixel_size, result.calibration.u
    by_scale = fit.sensitivity[Parameter.SCALE] * pixel
    by_optics = [fit.sensitivity.get(p, 0.0) * pixel * u.get(p, 0.0) for p in (Parameter.PHASE, *OPTICAL)]
    relative = uncertainties["pixel_size"] / pixel
    relative_wavelength = uncertainties["wavelength"] / (options.wavelength or NOMINAL_WAVELENGTH)
    return np.abs(
        [
            by_scale * uncertainties["sphere_radius"] / options.sphere_radius,
            by_scale * math.hypot(relative_wavelength, u.get(Parameter.SCALE, 0.0)),
            (fit.radius * pixel - 2.0 * by_scale) * relative,
            math.hypot(fit.sensitivity[Parameter.PHASE] * pixel * uncertainties["phase"], *by_optics),
            0.0,
        ]
    )


def adhesive_edges(
    values: dict[str, Floats], parts: Floats, is_spot: Flags, options: FilmOptions, u_work: float
) -> None:
    """Enter the edge of adhesive contacts (JKR), and adhesion among what all frames share.

    Without a stated work of adhesion the edge lies anywhere between Hertz's and that of a clean smooth polymer.
    """
    seen = np.isfinite(values["radius"]) & (values["radius"] > 0.0)
    if options.reduced_modulus is None or not seen.any():
        return
    radius = values["radius"][seen]
    bodies = options.sphere_radius, options.reduced_modulus, options.work_of_adhesion, u_work
    shift, u = edge_shift(radius, *bodies, options.wavelength, is_spot[seen])
    known = np.hypot(values["u_radius"][seen], np.sqrt(np.nansum(parts[seen] ** 2, axis=1)))
    parts[seen, SOURCES.index("adhesion")] = np.hypot(shift, u)
    values["edge_radius"][seen], values["u_edge_radius"][seen] = radius + shift, np.hypot(known, u)

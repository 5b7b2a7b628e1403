"""Checked arguments of :func:`labpipe.imaging.contact_radius`."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.frames import FrameSource
from labpipe.imaging.fringes._adhesive_edge import USUAL_WORK, adhesive_edge


@dataclass(frozen=True)
class FilmOptions:
    """Arguments of :func:`.contact_radius`, under the same names."""

    pixel_size: float
    sphere_radius: float
    wavelength: float | None
    exposure: float | NDArray[np.float64] | None = None
    phase: float | None = None
    shape: str = "auto"
    fringes: float = 3.0
    full: bool = False
    reduced_modulus: float | None = None
    work_of_adhesion: float | None = None
    any_disc: bool = False


def check_film(film: FrameSource, options: FilmOptions) -> None:
    """Refuse arguments outside their range with an InputError that names what was found and what was expected."""
    lengths = {"pixel_size": (options.pixel_size, 1e-9, 1e-3), "sphere_radius": (options.sphere_radius, 1e-6, 10.0)}
    if options.wavelength is not None:
        lengths["wavelength"] = (options.wavelength, 100e-9, 20e-6)
    for name, (value, low, high) in lengths.items():
        if not low <= value <= high:
            raise InputError(f"{name} must lie between {low:g} and {high:g} m, found {value} m")
    if options.shape not in {"auto", "circle", "ellipse"}:
        raise InputError(f'shape must be "auto", "circle" or "ellipse", found {options.shape!r}')
    if not 0.5 <= options.fringes <= 20.0:
        raise InputError(f"fringes must be between 0.5 and 20, found {options.fringes}")
    if options.phase is not None and not math.isfinite(options.phase):
        raise InputError(f"phase must be a finite angle in rad, found {options.phase}")
    if options.work_of_adhesion is not None and options.reduced_modulus is None:
        raise InputError("work_of_adhesion tells the edge of a contact together with reduced_modulus: give both")
    if options.reduced_modulus is not None:
        work = USUAL_WORK if options.work_of_adhesion is None else options.work_of_adhesion
        adhesive_edge(1.0, options.sphere_radius, options.reduced_modulus, work)
    if len(film.shape) != 3 or min(film.shape[1:]) < 16:
        raise InputError(f"frames must be grey images of 16 x 16 px or more, found {film.shape}")
    if len(film) == 0:
        raise InputError("the film holds no frames")
    if options.exposure is not None:
        exposure = np.asarray(options.exposure, float)
        is_shaped = exposure.shape in {(), (len(film),)}
        if not is_shaped or not (np.isfinite(exposure) & (exposure >= 0.0)).all():
            found = f"one per frame ({len(film)}), not negative; found {options.exposure}"
            raise InputError(f"exposure must be one time in s or {found}")


def exposure_times(film: FrameSource, options: FilmOptions) -> Floats | None:
    """Exposure time of every frame in s, from the caller or the film; None when unknown."""
    exposure = film.exposure if options.exposure is None else options.exposure
    return None if exposure is None else np.broadcast_to(np.asarray(exposure, float), (len(film),))

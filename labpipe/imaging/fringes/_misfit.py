"""What errors of the model that fits leave make of the radii of a film."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.films import FilmReader
from labpipe.imaging.fringes._blank_frames import FilmResult
from labpipe.imaging.fringes._interference import Optics
from labpipe.imaging.fringes._open_gap import has_free_gap
from labpipe.imaging.fringes._radial_scan import edge_width
from labpipe.imaging.fringes._ring_fit import FitSettings, RingFit, cells_of_parts, ring_around, shared_covariance
from labpipe.imaging.fringes._ring_noise import unsteadiness
from labpipe.imaging.fringes._ring_parameters import Parameter

#: Travel in the exposure, in widths of the first bright ring, from which errors of the model are those of the motion.
_FAR_TRAVEL = 1.5


def weigh_misfits(reader: FilmReader, result: FilmResult) -> None:
    """Tell what errors of the model make of the radius in the frames that show some.

    How the contact moves over many fringes, and how a gap opens that is not Hertz's, is wrong in the same way in
    all parts of the ring: that stays at its worst.
    """
    view = result.view
    for index, fit in result.fits.items():
        width = edge_width(float(fit.parameters[Parameter.RADIUS]), view.optics)
        is_far = float(fit.parameters[Parameter.SMEAR]) > (_FAR_TRAVEL * width) ** 2
        if fit.worst_deviation > 0.0 and not is_far and not has_free_gap(fit):
            frame = reader.whole(index)
            result.fits[index] = with_misfit_weighed(frame, fit, view.optics, view.settings, view.levels)


def with_misfit_weighed(
    frame: NDArray[np.generic],
    fit: RingFit,
    optics: Optics,
    settings: FitSettings,
    levels: tuple[float, float] = (-math.inf, math.inf),
) -> RingFit:
    """Tell what errors of the model make of the radius, from what parts of the ring say; unchanged without any."""
    if fit.worst_deviation == 0.0 or Parameter.RADIUS not in fit.free:
        return fit
    ring = ring_around(frame, fit.parameters, optics, settings, levels)
    if ring is None:
        return fit
    cells, place = cells_of_parts(fit, ring, optics), fit.free.index(Parameter.RADIUS)
    by_noise = fit.noise * fit.leverage
    unsteady = math.sqrt(max(unsteadiness(cells.normals, cells.pulls, place) - by_noise**2, 0.0))
    return replace(fit, covariance=shared_covariance(fit, cells.scores), unsteady=unsteady)

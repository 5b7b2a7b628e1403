"""Refuse what films show whose rows are not those of one instant."""

import warnings

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.frames import FrameSource
from labpipe.imaging.dic._reference import Status
from labpipe.imaging.dic._results import Displacements
from labpipe.imaging.films import MOSAIC, mosaic_of, read_rows


def refuse_rows(
    found: Displacements, rows: dict[int, Floats], indices: NDArray[np.int64], is_static: Flags, film: FrameSource
) -> str:
    """Take back the results of frames whose rows show two instants, or repeat each other.

    A frame of two instants shows two displacements. Where most moving frames do, the film is interlaced, and none of
    its frames tells where a point was when.

    ``found`` is changed in place. ``rows``: of frames that were looked at, (piece, 16), see :func:`.row_sums`;
    ``indices`` (frame,): frames of ``found`` in the film; ``is_static`` (frame,): those of the reference. ``film`` is
    asked for one frame where rows differ: under a colour filter columns do as well, and nothing is refused. Returns
    what is wrong with the film, "" when nothing is; a UserWarning says the same.
    """
    seen = np.array([int(index) in rows for index in indices], bool)
    if not seen.any():
        return ""
    steps = np.where(is_static[seen, None], np.nan, _steps(found.value)[seen])
    sums = [rows[int(index)] for index in indices[seen]]
    told = read_rows(sums, is_first_still=bool(is_static[seen][0]), steps=steps)
    refused = np.zeros(len(indices), bool)
    text = ""
    if told.is_repeated:
        refused[:] = True
        text = (
            "every second row of the film repeats its neighbour or is the mean of both: it shows one field of "
            "an interlaced recording, and displacements down the rows cannot be told; keep every second row of "
            "it, and give the height of a row as twice that of a pixel"
        )
    elif not (told.is_interlaced(steps) or told.is_combed.any()):
        return ""
    elif mosaic_of(np.asarray(film[int(indices[seen][0])], np.float64) - film.levels[0]) > MOSAIC:
        text = (
            "odd and even rows and columns of the film differ in brightness throughout, as under a colour camera's "
            "filter (Bayer pattern), which adds to all uncertainties; export it as grey, interpolated"
        )
    elif told.is_interlaced(steps):
        refused = ~is_static
        text = (
            "odd and even rows of the frames show different instants: the film is interlaced, so that no frame after "
            "the static ones tells where a point was when; record progressive frames, or keep every second row and "
            "give the height of a row as twice that of a pixel"
        )
    else:
        refused[np.flatnonzero(seen)[told.is_combed]] = True
        most = int(np.argmax(told.apart))
        text = (
            f"odd and even rows of {int(told.is_combed.sum())} of {int(seen.sum())} frames show different instants, "
            f"by {told.apart[most]:.2g} px in frame {int(indices[seen][most])}: these frames were left out"
        )
    found.refuse(refused, Status.INTERLACED)
    warnings.warn(text, UserWarning, stacklevel=3)
    return text


def _steps(value: Floats) -> Floats:
    """Motion (frame, 2) in px from frame to frame, median of the points; NaN where none was found."""
    mean_step = 0.5 * (value[2:, :, :2] - value[:-2, :, :2])
    step = np.concatenate([value[1:2, :, :2] - value[:1, :, :2], mean_step, value[-1:, :, :2] - value[-2:-1, :, :2]])
    step = step[: len(value)]
    found = np.full((len(value), 2), np.nan)
    ordered, number = np.sort(step, axis=1), np.isfinite(step[..., 0]).sum(axis=1)  # NaN last
    rows = np.arange(len(step))
    found[: len(step)] = 0.5 * (ordered[rows, np.maximum(number - 1, 0) // 2] + ordered[rows, number // 2])
    return found

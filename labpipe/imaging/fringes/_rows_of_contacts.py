"""Leave out frames of contacts whose odd and even rows are of two instants."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.films import (
    MOSAIC,
    PIECE,
    FilmReader,
    RowsSeen,
    is_inside,
    mosaic_of,
    pieces_of,
    read_rows,
    row_sums,
)
from labpipe.imaging.fringes._blank_frames import FilmResult
from labpipe.imaging.fringes._radial_scan import edge_width
from labpipe.imaging.fringes._ring_parameters import Parameter

#: Frames whose rows are compared at first.
_MOST_FRAMES = 12
#: Pieces along a ring, and along the longer side of a frame without one.
_ALONG_RING, _ALONG_FRAME = 12, 8
#: Change of the radius (px) from frame to frame up to which two instants are one.
_AT_REST = 0.01


def leave_out_rows(reader: FilmReader, result: FilmResult) -> None:
    """Count frames as damaged whose rows are of two instants, or repeat each other.

    Frames are tried in which the radius changes most. An edge sharper than the pixels has steps that look
    like teeth here and there, but only two instants have them outwards, or inwards, all around. When a
    frame shows that, all frames are looked at, and those in which the radius changes are left out even when
    their teeth are too small to be seen.

    Parameters
    ----------
    reader : FilmReader
        The film.
    result : FilmResult
        Changed in place.
    """
    change = _changes(result)
    tried = sorted(change, key=lambda index: -change[index])[:_MOST_FRAMES]
    if not tried:
        return
    told = _told(reader, result, tried)
    if not (told.is_repeated or told.is_combed.any()):
        return
    if mosaic_of(np.asarray(reader.whole(tried[0]), float)) > MOSAIC:  # under a colour filter all rows differ
        return
    if told.is_repeated:
        result.repeats_rows = True
        result.leave_out([*change, *result.blanks])
    elif any(told.are_outwards(k, _outwards(result, tried[k])) for k in np.flatnonzero(told.is_combed).tolist()):
        every = sorted({*change, *result.blanks})
        combed = {index for index, shows in zip(every, _told(reader, result, every).is_combed, strict=True) if shows}
        result.combed = combed
        result.leave_out(combed | {index for index, step in change.items() if step > _AT_REST})


def _changes(result: FilmResult) -> dict[int, float]:
    """Largest change of the radius (px) to the frames beside each frame in contact."""
    radius = {index: edge.half_radius for index, edge in result.edges.items()}
    radius |= {index: float(fit.parameters[Parameter.RADIUS]) for index, fit in result.fits.items()}
    frames = sorted(radius)
    change = dict.fromkeys(frames, 0.0)
    for one, other in itertools.pairwise(frames):
        step = abs(radius[other] - radius[one])
        change[one], change[other] = max(change[one], step), max(change[other], step)
    return change


def _told(reader: FilmReader, result: FilmResult, frames: list[int]) -> RowsSeen:
    """Look at the rows of frames where their contacts are."""
    sums = [row_sums(pieces_of(reader.whole(index), _corners(result, index))) for index in frames]
    return read_rows(sums, is_first_still=False)


def _corners(result: FilmResult, index: int) -> NDArray[np.int64]:
    """First columns and rows (piece, 2) of pieces along the first fringes, or all over the frame."""
    rows, columns = result.view.shape
    circle = _circle(result, index)
    if circle is None:
        step = max(PIECE, max(rows, columns) // _ALONG_FRAME)
        grid = np.meshgrid(np.arange(0, columns - PIECE + 1, step), np.arange(0, rows - PIECE + 1, step))
        return _even(np.stack([axis.ravel() for axis in grid], axis=1).astype(float))
    x, y, radius = circle
    angle = 2.0 * math.pi * (np.arange(_ALONG_RING) + 0.5) / _ALONG_RING
    away = radius + edge_width(radius, result.view.optics)
    found = _even(np.stack([x + away * np.cos(angle), y + away * np.sin(angle)], axis=1) - 0.5 * PIECE)
    return found[is_inside(found, (rows, columns))]


def _circle(result: FilmResult, index: int) -> tuple[float, float, float] | None:
    """Centre and radius (px) of the contact in a frame, if there is one."""
    if index in result.fits:
        p = result.fits[index].parameters
        return float(p[Parameter.X]), float(p[Parameter.Y]), float(p[Parameter.RADIUS])
    if index in result.edges:
        edge = result.edges[index]
        return edge.x, edge.y, edge.half_radius
    return None


def _outwards(result: FilmResult, index: int) -> Floats:
    """Directions (piece, 2) from the centre of the contact in a frame to its pieces."""
    circle = _circle(result, index)
    away = _corners(result, index) + 0.5 * PIECE - (circle[:2] if circle else (0.0, 0.0))
    return np.asarray(away / np.hypot(*away.T)[:, None])


def _even(corners: Floats) -> NDArray[np.int64]:
    """Whole columns and rows, all of which begin with the same field."""
    found = np.rint(corners).astype(np.int64)
    found[:, 1] -= found[:, 1] % 2
    return found

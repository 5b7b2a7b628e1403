"""Leave out frames of contacts whose odd and even rows are of two instants."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.films import PIECE, FilmReader, RowsSeen, pieces_of, read_rows, row_sums
from labpipe.imaging.fringes._blank_frames import FilmResult
from labpipe.imaging.fringes._radial_scan import edge_width
from labpipe.imaging.fringes._ring_fit import Parameter

#: Frames of either kind, with and without a contact, whose rows are compared.
_MOST_FRAMES = 12
#: Pieces along a ring, and along the longer side of a frame without one.
_ALONG_RING, _ALONG_FRAME = 12, 8
#: Change of the radius (px) from frame to frame up to which two instants are one.
_AT_REST = 0.01


def leave_out_rows(reader: FilmReader, result: FilmResult) -> None:
    """Count frames as damaged whose rows are of two instants, or repeat each other.

    Frames are tried in which the radius changes most, and some without a contact: teeth may be the
    reason that none is found. When some show two instants, all frames are looked at, and those in which
    the radius changes are left out even when their teeth are too small to be seen.

    Parameters
    ----------
    reader : FilmReader
        The film.
    result : FilmResult
        Changed in place.
    """
    change = _changes(result)
    contacts = sorted(change, key=lambda index: -change[index])[:_MOST_FRAMES]
    blanks = np.array(sorted(result.blanks.keys() - change.keys()), np.int64)
    if len(blanks) > _MOST_FRAMES:
        blanks = blanks[np.linspace(0, len(blanks) - 1, _MOST_FRAMES).round().astype(int)]
    tried = [*contacts, *map(int, blanks)]
    told = _told(reader, result, tried)
    if told.is_repeated:
        result.repeats_rows = True
        result.leave_out([*change, *result.blanks])
    elif told.is_combed.any():
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
    return read_rows([row_sums(pieces_of(reader.whole(index), _corners(result, index))) for index in frames])


def _corners(result: FilmResult, index: int) -> NDArray[np.int64]:
    """First columns and rows (piece, 2) of pieces along the first fringes, or all over the frame."""
    rows, columns = result.view.shape
    if index in result.fits:
        p = result.fits[index].parameters
        x, y, radius = (float(p[n]) for n in (Parameter.X, Parameter.Y, Parameter.RADIUS))
    elif index in result.edges:
        edge = result.edges[index]
        x, y, radius = edge.x, edge.y, edge.half_radius
    else:
        step = max(PIECE, max(rows, columns) // _ALONG_FRAME)
        grid = np.meshgrid(np.arange(0, columns - PIECE + 1, step), np.arange(0, rows - PIECE + 1, step))
        return _even(np.stack([axis.ravel() for axis in grid], axis=1).astype(float))
    angle = 2.0 * math.pi * (np.arange(_ALONG_RING) + 0.5) / _ALONG_RING
    away = radius + edge_width(radius, result.view.optics)
    return _even(np.stack([x + away * np.cos(angle), y + away * np.sin(angle)], axis=1) - 0.5 * PIECE)


def _even(corners: Floats) -> NDArray[np.int64]:
    """Whole columns and rows, all of which begin with the same field."""
    found = np.rint(corners).astype(np.int64)
    found[:, 1] -= found[:, 1] % 2
    return found

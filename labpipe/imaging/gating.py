"""When there may be contact in a film under the disc, from a glance at a few pixels.

Contact is dark. A coarse pass over every few frames, in a band of rows, finds where the dark spot
lies; a second pass reads a few pixels there in all frames. Both err on the side of reading too
much: Newton's rings of a near sphere are dark now and then too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.frames import FrameSource

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_EVERY = 4  # frames of the coarse pass: an impact that lasts four frames is not missed
_BAND = 64  # rows of the coarse pass
_BLOCK = 16  # px; below the diameter of the smallest contact that is to be found
_DARK = 0.6  # of the plain light: the middle of a fringe is below, the mean of fringes above
_AROUND = 3  # frames kept before and after a dark one


@dataclass(frozen=True)
class Glance:
    """Times in which there may be contact, and what finding them took.

    ``windows`` are (start, end) in s, or None when the glance excludes nothing; ``frames`` the
    indices inside; ``pixels_read`` counts the glances.
    """

    windows: tuple[tuple[float, float], ...] | None
    frames: Indices
    pixels_read: int


def contact_windows(film: FrameSource) -> Glance:
    """Find the times of a film in which there may be contact.

    Parameters
    ----------
    film : FrameSource
        Of the view under the disc; the contact is darker than its surroundings.

    Returns
    -------
    Glance
        ``windows`` is None when nothing dark is seen, when all is dark, or for a short film.
    """
    everything = np.arange(len(film))
    sound = np.flatnonzero(film.valid)
    if len(sound) < 4 * _EVERY:
        return Glance(None, everything, 0)
    _, rows, columns = film.shape
    top = max(0, (rows - _BAND) // 2)
    band = film.roi(slice(top, min(rows, top + _BAND)), slice(0, columns))
    coarse = sound[::_EVERY]
    blocks = np.stack([_block_means(band[int(i)]) for i in coarse])
    pixels = len(coarse) * int(np.prod(band.shape[1:]))
    light = float(np.percentile(blocks, 75)) - film.levels[0]
    dark = blocks - film.levels[0] < _DARK * light
    share = dark.reshape(len(coarse), -1).mean(axis=1)
    if light <= 0 or not dark.any() or share.min() > 0.5:
        return Glance(None, everything, pixels)
    place = _centre(dark[int(np.argmax(share))])
    y, x = (top + place[0] * _BLOCK, place[1] * _BLOCK)
    spot = film.roi(slice(y, min(rows, y + _BLOCK)), slice(x, min(columns, x + _BLOCK)))
    is_dark = np.zeros(len(film), dtype=bool)
    for index in sound:
        level = float(np.mean(spot[int(index)])) - film.levels[0]
        is_dark[index] = level < _DARK * light
    is_dark[coarse[share > 0.25 * share.max()]] = True
    pixels += len(sound) * int(np.prod(spot.shape[1:]))
    kept = np.convolve(is_dark, np.ones(2 * _AROUND + 1), "same") > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], kept.astype(int), [0]])))
    time = film.time
    windows = tuple(
        (float(time[start]), float(time[stop - 1]))
        for start, stop in zip(edges[::2], edges[1::2], strict=True)
    )
    return Glance(windows, np.flatnonzero(kept), pixels)


def _block_means(image: NDArray[np.generic]) -> Floats:
    rows, columns = (n // _BLOCK for n in image.shape)
    rows, columns = max(rows, 1), max(columns, 1)
    part = image[: rows * _BLOCK, : columns * _BLOCK].astype(float)
    high, wide = min(_BLOCK, image.shape[0]), min(_BLOCK, image.shape[1])
    return np.asarray(part.reshape(rows, high, columns, wide).mean(axis=(1, 3)))


def _centre(dark: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the dark block nearest to the middle of all dark ones."""
    places = np.argwhere(dark)
    nearest = np.argmin(((places - places.mean(axis=0)) ** 2).sum(axis=1))
    row, column = places[nearest]
    return int(row), int(column)

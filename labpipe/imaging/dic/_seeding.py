"""Find where a subset went without knowing anything: template matching on reduced images.

Good to about a pixel, which is all that the subset solver needs as a start. Used for the first
frame, after gaps, and when correlation is lost; never for a result.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32
from labpipe.imaging.dic._neighbour_outliers import carried

#: Least half width of a template in the full image (px): smaller ones are found everywhere.
_TEMPLATE = 32
#: Least correlation of the reduced template; noise is averaged away there, so a true match is high.
_COARSE_SCORE = 0.6
#: Correlation of the subset itself from which no further template is tried.
_FULL_SCORE = 0.5
#: Places of the reduced image that are tried in the full one.
_CANDIDATES = 3
#: Half width of the tiles that find the rotation of a large subset (px).
_TILE = 20
#: A subset of at most this half width is matched as a whole (px).
_WHOLE = 25
#: Reach of the search in the full image beyond the reduced pixel (px): rotation moves the tiles.
_REFINE = 6
#: Two seeds belong to one rigid motion, and a proposal is confirmed, when they agree within this (px).
AGREEMENT = 2.5


@dataclass(frozen=True)
class Pyramid:
    """An image and its reduced copy; ``factor`` full pixels make one reduced pixel."""

    image: Floats32
    small: Floats32
    factor: int


def make_pyramid(image: Floats32) -> Pyramid:
    """Blur and reduce an image, by 4 where it is large enough.

    Parameters
    ----------
    image : float32 array (row, column)
        Grey levels.
    """
    import cv2

    # Sums of squares of single precision hold no faint pattern on a bright ground, and the matching
    # takes small numbers for none: the pattern itself, about zero and of the size one, is matched.
    spread = float(image.std(dtype=np.float64)) or 1.0
    image = np.asarray((image - image.mean(dtype=np.float64)) / spread, np.float32)
    factor = 4 if min(image.shape) >= 192 else 2 if min(image.shape) >= 96 else 1
    if factor == 1:
        return Pyramid(image, image, 1)
    rows, columns = (size // factor for size in image.shape)
    blurred = cv2.GaussianBlur(image, (0, 0), factor / 2)
    whole = blurred[: rows * factor, : columns * factor]
    small = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return Pyramid(image, np.asarray(small, np.float32), factor)


def find_subset(reference: Pyramid, frame: Pyramid, centre: tuple[int, int], half: int) -> tuple[Floats, float] | None:
    """Look for a subset of the reference anywhere in a frame.

    Parameters
    ----------
    reference, frame : Pyramid
        Of the same size.
    centre : (x, y) [px]
        Centre of the subset in the reference.
    half : int [px]
        Half width of the subset.

    Returns
    -------
    motion : array (6,)
        ``(u, u_x, u_y, v, v_x, v_y)`` as in :mod:`._subsets`.
    score : float [1]
        Correlation of the full-size template. None of both when nothing in the frame resembles the subset.
    """
    import cv2

    best: tuple[Floats, float] | None = None
    # A wide template is unmistakable, but may hold background; the subset alone does not.
    for reach in sorted({max(half, _TEMPLATE), half}, reverse=True):
        factor, (rows, columns) = reference.factor, reference.small.shape
        left, top = max(0, (centre[0] - reach) // factor), max(0, (centre[1] - reach) // factor)
        right, bottom = min(columns, (centre[0] + reach) // factor + 1), min(rows, (centre[1] + reach) // factor + 1)
        template = reference.small[top:bottom, left:right]
        if min(template.shape) < 4 or float(template.std()) == 0.0:
            continue
        scores = np.nan_to_num(cv2.matchTemplate(frame.small, template, cv2.TM_CCOEFF_NORMED), nan=-1.0, posinf=-1.0)
        for _ in range(_CANDIDATES):  # the best few places of the reduced frame
            row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
            if scores[row, column] < _COARSE_SCORE:
                break
            shift = int(column - left) * factor, int(row - top) * factor
            scores[max(0, row - 2) : row + 3, max(0, column - 2) : column + 3] = -1.0
            found = _refine(reference, frame, centre, half, shift)
            if found is not None and (best is None or found[1] > best[1]):
                best = found
        if best is not None and best[1] > _FULL_SCORE:
            return best
    return best


def _refine(
    reference: Pyramid, frame: Pyramid, centre: tuple[int, int], half: int, shift: tuple[int, int]
) -> tuple[Floats, float] | None:
    """Search the full image around a displacement, in tiles when the subset is large."""
    if half <= _WHOLE:
        found = _match_tile(reference, frame, centre, half, shift)
        return None if found is None else (np.array([found[0], 0.0, 0.0, found[1], 0.0, 0.0]), found[2])
    inset = half - _TILE
    offsets = [(j, i) for j in (-inset, 0, inset) for i in (-inset, 0, inset)]
    tiles = [_match_tile(reference, frame, (centre[0] + j, centre[1] + i), _TILE, shift) for j, i in offsets]
    seen = [n for n, tile in enumerate(tiles) if tile is not None]
    if len(seen) < 3:
        return None
    places, table = np.array(offsets, float)[seen], np.array([tiles[n] for n in seen])
    motion, fits = fit_motion(places, table[:, :2])
    return (motion, float(table[fits, 2].mean())) if fits.sum() >= 3 else None


def _match_tile(
    reference: Pyramid, frame: Pyramid, centre: tuple[int, int], half: int, shift: tuple[int, int]
) -> tuple[float, float, float] | None:
    """Displacement (u, v) in whole px and correlation of a tile of the full image."""
    import cv2

    x, y = centre
    rows, columns = reference.image.shape
    if x - half < 0 or y - half < 0 or x + half >= columns or y + half >= rows:
        return None
    template = reference.image[y - half : y + half + 1, x - half : x + half + 1]
    reach = half + _REFINE + reference.factor
    left, top = max(0, x + shift[0] - reach), max(0, y + shift[1] - reach)
    right, bottom = min(columns, x + shift[0] + reach + 1), min(rows, y + shift[1] + reach + 1)
    area = frame.image[top:bottom, left:right]
    if min(area.shape) < 2 * half + 1 or float(template.std()) == 0.0:
        return None
    scores = cv2.matchTemplate(area, template, cv2.TM_CCOEFF_NORMED)
    scores = np.nan_to_num(scores, nan=-1.0, posinf=-1.0)
    row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
    return (float(left + column + half - x), float(top + row + half - y), float(scores[row, column]))


def fit_motion(places: Floats, shifts: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Fit one rigid motion to displacements of which some may be wrong, by random sample consensus.

    Parameters
    ----------
    places : array (point, 2) [px]
        Positions (x, y) from any origin.
    shifts : array (point, 2) [px]
        Displacements there.

    Returns
    -------
    motion : array (6,)
        Motion at the origin of ``places``; zero where no two displacements agree.
    fits : bool array (point,)
        Displacements that agree with it.
    """
    import cv2

    matrix, inliers = None, None
    if len(places) > 1:
        matrix, inliers = cv2.estimateAffinePartial2D(
            places, places + shifts, method=cv2.RANSAC, ransacReprojThreshold=AGREEMENT
        )
    if matrix is None or inliers is None or inliers.sum() < 2:
        return np.zeros(6), np.zeros(len(places), bool)
    fits = inliers[:, 0] > 0
    turn = np.arctan2(matrix[1, 0], matrix[0, 0])
    cosine, sine = np.cos(turn) - 1.0, np.sin(turn)
    motion = np.array([0.0, cosine, -sine, 0.0, sine, cosine])
    motion[[0, 3]] = (shifts[fits] - carried(motion, places[fits])).mean(axis=0)
    return motion, fits

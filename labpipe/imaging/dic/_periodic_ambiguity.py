"""Patterns that repeat themselves within a subset: a match one period away is as good as the right one."""

import numpy as np

from labpipe.arrays import Flags, Floats, Floats32
from labpipe.imaging.dic._solver import OVERHANG, SOLVED, solve
from labpipe.imaging.dic._subsets import Subsets

#: Half width (px) of the least template, and the farthest repetition that is looked for.
_TEMPLATE, _FARTHEST = 7, 32
#: Correlation that separates one peak from the next: the half maximum.
_HALF_MAXIMUM = 0.5
#: Correlation in whole pixels from which a repetition is refined: half a pixel off the peak of the finest pattern.
_WORTH = 0.65


def best_repetition(image: Floats32, coefficients: Floats32, order: int, subsets: Subsets) -> Floats:
    """Greatest correlation of each subset with another place near it in the reference.

    Parameters
    ----------
    image : float32 array (row, column)
        Reference.
    coefficients : float32 array
        Its spline, see :func:`.prefilter`.
    order : 3 or 5
        Order of the spline.
    subsets : Subsets
        Those cut out of it.

    Returns
    -------
    array (point,) [1]
        Over all peaks apart from the subset's own place, within half its width; the ridge along an edge belongs to
        its own place. The middle of the subset is matched in whole pixels, and the best match refined.
    """
    import cv2

    rows, columns = image.shape
    result = np.zeros(len(subsets))
    start = np.zeros((len(subsets), 6))
    for n, (x, y, half) in enumerate(subsets.layout[:, :3].tolist()):
        inner, reach = min(max(_TEMPLATE, half // 2), half), min(half, _FARTHEST)
        left, top = max(0, x - inner - reach), max(0, y - inner - reach)
        area = image[top : min(rows, y + inner + reach + 1), left : min(columns, x + inner + reach + 1)]
        template = image[y - inner : y + inner + 1, x - inner : x + inner + 1]
        scores = cv2.matchTemplate(area, template, cv2.TM_CCOEFF_NORMED)
        count, peaks = cv2.connectedComponents((scores > _HALF_MAXIMUM).astype(np.uint8))
        if count == 2:  # the background and its own place
            continue
        scores[(peaks == 0) | (peaks == peaks[y - inner - top, x - inner - left])] = 0.0
        row, column = np.unravel_index(int(scores.argmax()), scores.shape)
        result[n] = scores[row, column]
        start[n, [0, 3]] = column + inner + left - x, row + inner + top - y
    chosen = np.flatnonzero(result > _WORTH)
    window = (-OVERHANG, columns - 1 + OVERHANG, -OVERHANG, rows - 1 + OVERHANG)
    refined = solve(subsets, coefficients, order, chosen, start[chosen], origin=(0, 0), window=window, capture=1.0)
    result[chosen] = np.where(refined.code == SOLVED, refined.zncc, result[chosen])
    return result


def is_ambiguous(zncc: Floats, repetition: Floats, min_zncc: float) -> Flags:
    """Tell matches that are hardly better than a repetition of the pattern itself.

    Parameters
    ----------
    zncc : array (point,) [1]
        Correlation of each match.
    repetition : array (point,) [1]
        From :func:`best_repetition`.
    min_zncc : float [1]
        Correlation from which a place counts as a match: a repetition below it misleads nobody.

    Returns
    -------
    bool array (point,)
        The match leaves over half of what the repetition leaves, or more.
    """
    return np.asarray((repetition >= min_zncc) & (1.0 - zncc**2 > 0.5 * (1.0 - repetition**2)))

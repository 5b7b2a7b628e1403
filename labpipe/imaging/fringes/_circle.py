"""A circle through scattered points."""

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError


def fit_circle(points: Floats) -> tuple[float, float, float]:
    """Fit a circle to points, also when they cover only an arc.

    Parameters
    ----------
    points : array (point, 2)
        Coordinates (x, y) of three or more points that are not on one line.

    Returns
    -------
    x, y, radius : float
        Centre and radius in the unit of the points.

    Raises
    ------
    InputError
        Fewer than three points, or points on one line.

    Notes
    -----
    Taubin's fit (IEEE Trans. PAMI 13 (1991) 1115, https://doi.org/10.1109/34.103273): the algebraic distance is
    normalised by the mean of its squared gradient, which takes away most of the pull to small circles that short arcs
    have. OpenCV has no fit of circles.

    Examples
    --------
    >>> angle = np.linspace(0.0, 1.0, 20)
    >>> arc = np.column_stack([3.0 + 5.0 * np.cos(angle), 5.0 * np.sin(angle) - 1.0])
    >>> [round(float(value), 6) for value in fit_circle(arc)]
    [3.0, -1.0, 5.0]
    """
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise InputError(f"a circle needs three or more points (x, y), found shape {points.shape}")
    middle = points.mean(axis=0)
    centred = points - middle
    square = (centred**2).sum(axis=1)
    mean_square = float(square.mean())
    if mean_square == 0.0:
        raise InputError("the points are all the same; a circle needs three different ones")
    root = np.sqrt(mean_square)
    *_, vectors = np.linalg.svd(np.column_stack([(square - mean_square) / (2.0 * root), centred]), full_matrices=False)
    curvature, *slope = vectors[-1]
    curvature /= 2.0 * root
    if abs(curvature) * root < 1e-9 * np.hypot(*slope):
        raise InputError("the points lie on one line; no circle passes through them")
    x, y = -np.array(slope) / (2.0 * curvature) + middle
    radius = np.sqrt(slope[0] ** 2 + slope[1] ** 2 + 4.0 * curvature**2 * mean_square) / (2.0 * abs(curvature))
    return float(x), float(y), float(radius)

"""Does a whole curve agree with its model? Means over stretches of it, against their whole covariance.

Neighbouring points of a curve err together: by the calibration, by the inputs of the model, and by
noise that lasts. So a curve is laid against its model in a few stretches. What an input does to all
of them is known from its sensitivity; what is each stretch's own, from the scatter within it.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError
from labpipe.judging._agreement import Agreement, agreement

_OPEN = 0.05
"""Part of a shared uncertainty by which its effects may have another shape than their sensitivities say."""
_BATCHES = 10
_TREND = 2  # degree: flights and relaxations that differ do so along arcs
_FEWEST = 6  # batches of a stretch from which its scatter can be told


def along_curve(difference: ArrayLike, own: ArrayLike, effects: ArrayLike) -> Agreement | None:
    """Compare a curve with its model.

    Parameters
    ----------
    difference : array (stretch,)
        Means of measured minus model.
    own : array (stretch,)
        Their standard uncertainties by noise, see :func:`stretches`.
    effects : array (effect, stretch)
        What one standard uncertainty of each input and calibration does to the means.

    Returns
    -------
    Agreement or None
        None where no stretch is known with an uncertainty.

    Raises
    ------
    InputError
        Sizes differ.

    Notes
    -----
    Sensitivities are good to some per cent: 5 % of what the effects do to a stretch, or of a difference
    that is larger, is allowed for beside, as slack (see :func:`labpipe.judging.agreement`), and adds no
    degree of freedom.

    Examples
    --------
    >>> found = along_curve([0.3, -0.2], [0.2, 0.1], [])
    >>> round(found.chi2, 2), found.degrees_of_freedom
    (6.25, 2.0)
    """
    d, u = np.asarray(difference, float), np.asarray(own, float)
    shared = np.asarray(effects, float).reshape(-1, d.size)
    if u.shape != d.shape:
        raise InputError(f"{d.size} stretches of a curve want as many uncertainties, found {u.size}")
    known = np.isfinite(d) & np.isfinite(u) & np.isfinite(shared).all(axis=0)
    known &= (u > 0.0) | (shared != 0.0).any(axis=0)
    if not known.any():
        return None
    d, u, shared = d[known], u[known], shared[:, known]
    by_effects = np.sum(shared**2, axis=0)
    slack = _OPEN**2 * np.where(by_effects > 0.0, np.maximum(by_effects, d**2), 0.0)
    return agreement(d, shared.T @ shared + np.diag(u**2 + slack), slack)


def stretches(values: ArrayLike, places: Sequence[Integers]) -> tuple[Floats, Floats]:
    """Return the means of a residual over stretches, and their standard uncertainties by its own noise.

    Parameters
    ----------
    values : array (sample,)
        Measured minus model.
    places : sequence of array of int
        Samples of each stretch, in order.

    Returns
    -------
    means, u : array (stretch,)
        NaN where a stretch has too few samples.

    Notes
    -----
    Means of ten batches scatter about their parabola as the noise does whose memory is shorter than a
    batch; few batches are allowed for by Student's distribution. A bend along a stretch is no noise.

    Examples
    --------
    >>> means, u = stretches(np.arange(100.0), [np.arange(100)])
    >>> float(means[0]), float(u[0])
    (49.5, 0.0)
    """
    found = [_of_stretch(np.asarray(values, float)[place]) for place in places]
    means, u = np.array(found, float).reshape(-1, 2).T
    return means, u


def stretch_means(curves: Iterable[Floats], places: Sequence[Integers]) -> Floats:
    """Return the means of several curves over the same stretches.

    Parameters
    ----------
    curves : iterable of array (sample,)
        Such as what one standard uncertainty of each input does.
    places : sequence of array of int
        Samples of each stretch.

    Returns
    -------
    array (curve, stretch)
    """
    return np.array([[one[place].mean() for place in places] for one in curves])


def _of_stretch(values: Floats) -> tuple[float, float]:
    count = min(_BATCHES, values.size)
    if count < _FEWEST:
        return np.nan, np.nan
    batches = np.array([part.mean() for part in np.array_split(values, count)])
    place = np.arange(count) - 0.5 * (count - 1)
    bent = np.linalg.qr(np.vander(place, _TREND + 1))[0]
    left = batches - bent @ (bent.T @ batches)
    freedom = count - bent.shape[1]
    # variance of Student's distribution over that of a normal one
    wider = freedom / (freedom - 2.0) if freedom > 2 else 3.0
    scatter = float(left @ left) / freedom
    rounding = (np.finfo(float).eps * float(np.abs(values).max())) ** 2
    return float(values.mean()), 0.0 if scatter <= 100.0 * rounding else float(np.sqrt(wider * scatter / count))

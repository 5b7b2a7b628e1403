"""What a comparison could have noticed: the smallest error of an input that it would have shown."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from labpipe.judging._agreement import directions

_LIMIT = 0.95


def detectable(sensitivities: ArrayLike, covariance: ArrayLike, slack: ArrayLike | None = None) -> np.ndarray:
    """Return the smallest error of each input that the comparison would have shown, with 95 % probability.

    An error e of an input shifts the differences by s e and makes chi square noncentral with
    lambda = e^2 s' C^-1 s; it is shown when chi square exceeds its 95 % limit. Other inputs are
    held at their uncertainty, which stands in C.

    Parameters
    ----------
    sensitivities : array (row, input)
        Derivatives of the differences (measured minus predicted) to each input.
    covariance : array (row, row)
        Of the differences.
    slack : array (row,), optional
        As for :func:`labpipe.judging.agreement`.

    Returns
    -------
    array (input,)
        In the unit of each input; infinite where the comparison does not see it.

    Examples
    --------
    >>> detectable([[1.0], [0.0]], [[1.0, 0.0], [0.0, 1.0]]).round(2)
    array([3.93])
    """
    S = np.asarray(sensitivities, float)
    C = np.atleast_2d(np.asarray(covariance, float))
    if S.ndim == 1:
        S = S[:, None]
    root, count = directions(C, slack)
    strength = np.linalg.norm(root @ S, axis=0)
    wanted = np.sqrt(_noncentrality(count))
    return np.divide(wanted, strength, out=np.full(len(strength), np.inf), where=strength > 0.0)


def _noncentrality(degrees_of_freedom: float) -> float:
    from scipy.optimize import brentq

    limit = special.chdtri(degrees_of_freedom, 1 - _LIMIT)
    return float(brentq(lambda x: 1 - special.chndtr(limit, degrees_of_freedom, x) - _LIMIT, 1e-6, 1e3 + 10 * limit))

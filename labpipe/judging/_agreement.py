"""Do measurement and model agree? Differences against their whole covariance.

For differences d with covariance C, chi square = d' C^-1 d has as many degrees of freedom as C has
independent directions (JCGM 102; generalised least squares). What two rows share - one calibration,
one modulus - stands off the diagonal, so that it is neither counted twice nor lost.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import special  # scipy.stats takes longer to load than a judgement to read

from labpipe.errors import InputError

ModelVerdict = Literal["agrees", "differs", "undecided", "none"]

_SINGULAR = 1e-9
"""Part of the largest variance (of correlations) below which a direction carries no information."""
LIKELY, _DIFFERS = 0.05, 0.001
"""Probability above which differences are ordinary, and below which a model differs, by all or by one of them."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well predicted values agree with measured ones.

    Attributes
    ----------
    chi2 : float
        Sum of squares of independent differences in units of their uncertainty.
    degrees_of_freedom : int
    p : float
        Probability of a larger one if the model is right and the uncertainties are.
    largest : float
        Largest difference of a row in units of its own uncertainty.
    """

    chi2: float
    degrees_of_freedom: int
    p: float
    largest: float


def agreement(differences: ArrayLike, covariance: ArrayLike) -> Agreement:
    """Compare measured with predicted values.

    Parameters
    ----------
    differences : array (row,)
        Measured minus predicted, in any unit per row.
    covariance : array (row, row)
        Of the differences, with what the rows share off the diagonal.

    Returns
    -------
    Agreement

    Raises
    ------
    InputError
        The covariance has another size, is not finite, or has a variance that is not positive.

    Examples
    --------
    >>> found = agreement([0.3, -0.2], [[0.04, 0.0], [0.0, 0.01]])
    >>> round(found.chi2, 2), found.degrees_of_freedom
    (6.25, 2)
    """
    d = np.atleast_1d(np.asarray(differences, float))
    C = np.atleast_2d(np.asarray(covariance, float))
    variances = np.diagonal(C)
    if C.shape != (len(d), len(d)) or not np.isfinite(C).all() or not np.isfinite(d).all():
        message = f"{len(d)} differences want a finite covariance of that size, found {C.shape}"
        raise InputError(message)
    if not (variances > 0.0).all():
        message = "a difference without uncertainty cannot be judged; state the uncertainty"
        raise InputError(message)
    scale = np.sqrt(variances)
    z = d / scale
    values, vectors = np.linalg.eigh(C / np.outer(scale, scale))
    kept = values > _SINGULAR * values.max()
    chi2 = float(np.sum((vectors[:, kept].T @ z) ** 2 / values[kept]))
    count = int(kept.sum())
    return Agreement(chi2, count, float(special.chdtrc(count, chi2)), float(np.abs(z).max()))


def model_verdict(found: Agreement | None, could_notice: bool) -> ModelVerdict:
    """Say in one word whether the model agrees.

    Parameters
    ----------
    found : Agreement or None
        None where there is no model.
    could_notice : bool
        Whether the comparison could have shown an error that matters (see :func:`detectable`).
    """
    if found is None:
        return "none"
    # one row among many is the largest by chance (Bonferroni); many that agree shall not hide it
    alone = float(special.erfc(found.largest / sqrt(2.0))) * found.degrees_of_freedom
    if min(found.p, alone) < _DIFFERS:
        return "differs"
    return "agrees" if found.p > LIKELY and could_notice else "undecided"

"""Do measurement and model agree? Differences against their whole covariance.

For differences d with covariance C, chi square = d' C^-1 d has as many degrees of freedom as C has
independent directions (JCGM 102; generalised least squares). What two rows share - one calibration,
one modulus - stands off the diagonal, so that it is neither counted twice nor lost. A variance that is
allowed only because slopes are no better known is in C, but nothing is expected to scatter by it: with C0
for the rest, chi square is trace(C^-1 C0) on the average, and that many are its degrees of freedom.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special  # scipy.stats takes longer to load than a judgement to read

from labpipe.arrays import Floats
from labpipe.errors import InputError

ModelVerdict = Literal["agrees", "differs", "undecided", "none"]

_SINGULAR = 1e-9
"""Part of the largest variance (of correlations) below which a direction carries no information."""
LIKELY, DIFFERS = 0.05, 0.001
"""Probability above which differences are ordinary, and below which a model differs, by all or by one of them."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well predicted values agree with measured ones.

    Attributes
    ----------
    chi2 : float
        Sum of squares of independent differences in units of their uncertainty.
    degrees_of_freedom : float
        No whole number where a slack takes a part of one.
    p : float
        Probability of a larger one if the model is right and the uncertainties are.
    largest : float
        Largest difference of a row in units of its own uncertainty.
    """

    chi2: float
    degrees_of_freedom: float
    p: float
    largest: float


class Directions(NamedTuple):
    """Independent directions of differences, and how many of them are expected to scatter.

    ``root`` (direction, row) turns differences into numbers whose variance is one at most.
    """

    root: Floats
    degrees_of_freedom: float


def directions(covariance: Floats, slack: ArrayLike | None = None) -> Directions:
    """Find the independent directions of a covariance (row, row); `slack` as for :func:`agreement`."""
    scale = np.sqrt(np.diagonal(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > _SINGULAR * values.max()
    root = (vectors[:, kept] / np.sqrt(values[kept])).T / scale
    allowed = 0.0 if slack is None else float(np.sum(root**2 @ np.asarray(slack, float)))
    return Directions(root, max(float(kept.sum()) - allowed, 1.0))


def agreement(differences: ArrayLike, covariance: ArrayLike, slack: ArrayLike | None = None) -> Agreement:
    """Compare measured with predicted values.

    Parameters
    ----------
    differences : array (row,)
        Measured minus predicted, in any unit per row.
    covariance : array (row, row)
        Of the differences, with what the rows share off the diagonal.
    slack : array (row,), optional
        Part of its diagonal that is allowed to a row, and not expected of it. Default: none.

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
    (6.25, 2.0)
    """
    d = np.atleast_1d(np.asarray(differences, float))
    C = np.atleast_2d(np.asarray(covariance, float))
    variances = np.diagonal(C)
    if C.shape != (len(d), len(d)) or not np.isfinite(C).all() or not np.isfinite(d).all():
        raise InputError(f"{len(d)} differences want a finite covariance of that size, found {C.shape}")
    if not (variances > 0.0).all():
        raise InputError("a difference without uncertainty cannot be judged; state the uncertainty")
    root, count = directions(C, slack)
    chi2 = float(np.sum((root @ d) ** 2))
    return Agreement(chi2, count, float(special.chdtrc(count, chi2)), float(np.abs(d / np.sqrt(variances)).max()))


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
    if min(found.p, alone) < DIFFERS:
        return "differs"
    return "agrees" if found.p > LIKELY and could_notice else "undecided"

"""Do measurement and model agree? Differences against their whole covariance.

For differences d with covariance C, chi square = d' C^-1 d has as many degrees of freedom as C has independent
directions (JCGM 102). Calibrations and moduli that rows share are its elements off the diagonal, so that they count
once. Nothing is expected to scatter by slack, a variance that only allows for uncertain slopes: with C0 for the rest,
chi square is trace(C^-1 C0) on the average.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import special  # scipy.stats takes longer to load than a judgement to read

from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError

ModelVerdict = Literal["agrees", "differs", "undecided", "none"]

LIKELY, DIFFERS = 0.05, 0.001
"""Probability above which differences are ordinary, and below which a model differs, by all or by one of them."""
_OPEN = 0.05  # part of a shared uncertainty by which its effects may differ in shape from their sensitivities
_BATCHES, _TREND = 10, 2  # of a stretch, and their degree: flights and relaxations that differ do so along arcs


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of predicted values with measured ones.

    ``chi2`` is the sum of squares of independent differences in units of their uncertainty, with
    ``degrees_of_freedom`` (no whole number where a slack takes a part of one) and ``p``, the probability of a larger
    one if model and uncertainties are right; ``largest`` is the largest difference in units of its own uncertainty.
    """

    chi2: float
    degrees_of_freedom: float
    p: float
    largest: float


def _directions(covariance: Floats, slack: ArrayLike | None = None, singular: float = 1e-9) -> tuple[Floats, float]:
    """Return rows that turn differences into independent numbers of variance one, and how many of them scatter."""
    scale = np.sqrt(np.diagonal(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > singular * values.max()  # other directions carry no information
    root = (vectors[:, kept] / np.sqrt(values[kept])).T / scale
    allowed = 0.0 if slack is None else float(np.sum(root**2 @ np.asarray(slack, float)))
    return root, max(float(kept.sum()) - allowed, 1.0)


def agreement(differences: ArrayLike, covariance: ArrayLike, slack: ArrayLike | None = None) -> Agreement:
    """Compare measured with predicted values.

    Parameters
    ----------
    differences, covariance : array (row,), array (row, row)
        Measured minus predicted, in any unit per row; uncertainties that rows share are off the diagonal.
    slack : array (row,), optional
        Part of the diagonal that is allowed to a row, and not expected of it. Default: none.

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
    root, count = _directions(C, slack)
    chi2 = float(np.sum((root @ d) ** 2))
    return Agreement(chi2, count, float(special.chdtrc(count, chi2)), float(np.abs(d / np.sqrt(variances)).max()))


def model_verdict(found: Agreement | None, could_notice: bool, curves: Sequence[float] = ()) -> ModelVerdict:
    """Say in one word whether the model agrees; None where there is no model.

    ``could_notice``: whether the comparison could have shown an error that matters (see :func:`detectable`). ``curves``
    are probabilities of whole curves, which are compared one by one.
    """
    if found is None:
        return "none"
    # one row among many is the largest by chance (Bonferroni); many that agree shall not hide it
    alone = float(special.erfc(found.largest / sqrt(2.0))) * found.degrees_of_freedom
    if min(found.p, alone, *(p * len(curves) for p in curves)) < DIFFERS:
        return "differs"
    return "agrees" if found.p > LIKELY and could_notice else "undecided"


def detectable(sensitivities: ArrayLike, covariance: ArrayLike, slack: ArrayLike | None = None) -> np.ndarray:
    """Return the smallest error of each input that the comparison would have shown, with 95 % probability.

    An error e of an input shifts the differences by s e and makes chi square noncentral with lambda = e^2 s' C^-1 s;
    it is shown when chi square exceeds its 95 % limit. Other inputs are held at their uncertainty, which is in C.

    Parameters
    ----------
    sensitivities : array (row, input)
        Derivatives of the differences (measured minus predicted) to each input.
    covariance, slack
        As for :func:`agreement`.

    Returns
    -------
    array (input,)
        In the unit of each input; infinite where the comparison does not see it.
    """
    root, count = _directions(np.asarray(covariance, float), slack)
    strength = np.linalg.norm(root @ np.asarray(sensitivities, float), axis=0)
    noncentrality = special.chndtrinc(special.chdtri(count, LIKELY), count, LIKELY)
    return np.divide(np.sqrt(noncentrality), strength, out=np.full(len(strength), np.inf), where=strength > 0.0)


def fitted_errors(differences: ArrayLike, sensitivities: ArrayLike, covariance: ArrayLike) -> tuple[Floats, Floats]:
    """Return the error of each input alone that explains most of the differences.

    Generalised least squares gives e = s' C⁻¹ d / s' C⁻¹ s, which takes (s' C⁻¹ d)² / s' C⁻¹ s away from chi square
    (Aitken, https://doi.org/10.1017/S0370164600014346). Returned are, by input, by how much it is stated too large, in
    its unit, and the share of chi square that this explains; 0 for an input without effect.
    """
    root, _ = _directions(np.asarray(covariance, float))
    seen, effects = root @ np.asarray(differences, float), root @ np.asarray(sensitivities, float)
    weight = np.sum(effects**2, axis=0)
    errors = np.divide(effects.T @ seen, weight, out=np.zeros_like(weight), where=weight > 0.0)
    return errors, errors**2 * weight / max(float(seen @ seen), np.finfo(float).tiny)


def along_curve(difference: ArrayLike, own: ArrayLike, effects: ArrayLike) -> Agreement | None:
    """Compare a curve with its model; None where no stretch is known with an uncertainty.

    ``difference`` and ``own`` (stretch,) are means of measured minus model and their standard uncertainties by noise,
    see :func:`stretches`; ``effects`` (effect, stretch) are the changes of the means by one standard uncertainty of
    each input and calibration. Sensitivities are good to some per cent: 5 % of the effects on a stretch, or of a
    difference that is larger, is slack (see :func:`agreement`). InputError where sizes differ.
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

    ``values`` (sample,) are measured minus model, ``places`` the samples of each stretch, in order; NaN where there are
    too few. Means of ten batches scatter about their parabola as noise does whose correlation is shorter than a batch;
    few batches are allowed for by Student's distribution. A bend along a stretch is no noise.
    """
    x, found = np.asarray(values, float), list[tuple[float, float]]()
    for stretch in (x[place] for place in places):
        count = min(_BATCHES, stretch.size)
        if count <= _TREND + 3:  # Student's distribution has a variance from three degrees of freedom on
            found.append((np.nan, np.nan))
            continue
        batches = np.array([part.mean() for part in np.array_split(stretch, count)])
        bent = np.linalg.qr(np.vander(np.arange(count) - 0.5 * (count - 1), _TREND + 1))[0]
        left = batches - bent @ (bent.T @ batches)
        freedom = count - bent.shape[1]
        wider = freedom / (freedom - 2.0)  # variance of Student's distribution over that of a normal one
        scatter = float(left @ left) / freedom
        rounding = (np.finfo(float).eps * float(np.abs(stretch).max())) ** 2
        u = 0.0 if scatter <= 100.0 * rounding else float(np.sqrt(wider * scatter / count))
        found.append((float(stretch.mean()), u))
    means, u_means = np.array(found, float).reshape(-1, 2).T
    return means, u_means


def stretch_means(curves: Iterable[Floats], places: Sequence[Integers]) -> Floats:
    """Return the means (curve, stretch) of several curves (sample,) over the samples of each stretch."""
    return np.array([[one[place].mean() for place in places] for one in curves])

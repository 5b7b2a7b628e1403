"""Which input, stated wrongly, would explain a difference between measurement and model."""

from collections.abc import Sequence
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from labpipe.judging._agreement import directions

_ALIKE = 0.995
"""Cosine between the effects of two inputs beyond which the comparison cannot tell them apart."""
SLIPS = {
    of: tuple(k ** (1 - 2 * i) for k in factors for i in range(2))
    for of, factors in {
        "value": (2.0, 10.0, 100.0, 1e3, 25.4, 2 * np.pi),
        "size": (2.0, 10.0, 100.0, 1e3, 25.4),
        "decimal": (2.0, 10.0),
        "length": (10.0, 100.0, 1e3, 1e4, 1e6, 25.4, 1e3 / 25.4),
        "gain": (2.0,),
        "interval": (2.0, 2.5, 4.0, 5.0, 10.0, 100.0, 1e3),
        "mass": (10.0, 100.0, 1e3, 9.81, 2.2046),
        "view": (36.0,),
    }.items()
}
"""Factors, and their inverses, by which people state something wrongly, the one table of all kinds.

A value: diameter for radius, decimals, units, a period for an angle, which no size is. A length: decimals, units,
mil. A mass: its weight, decimals, units, pounds. An interval or a rate: the next settings of a controller. A view:
another lens.
"""
_BENT, _STRAY = 0.1, 0.01
"""By which an effect may leave its power law over such a factor: relative to itself, and to the largest of all rows.
What a small change hardly moves, a large one may."""
_OFF = 0.2  # relative, by which the factor that fits best may have another logarithm than the usual one
_LEFT = 0.1
"""Part of chi square that a slip may leave and still be told."""
_CLOSE = 6.0
"""Twice the logarithm of a likelihood ratio within which two slips cannot be told apart."""
_SMALLER = 1.5  # times the logarithm of a slip that explains as much, beyond which a larger one is not told beside it
_VAGUE = 0.3
"""Relative uncertainty of the logarithm of a factor beyond which a slip cannot be told from others."""


class Suspect(NamedTuple):
    """An input, and the error of it that explains most.

    Attributes
    ----------
    inputs : tuple of int
        The input, and those whose errors would look the same, the likeliest first.
    error : float
        By which the first of them is stated too large, in its unit.
    share : float
        Share of chi square that this error alone takes away.
    """

    inputs: tuple[int, ...]
    error: float
    share: float


def suspects(differences: ArrayLike, sensitivities: ArrayLike, covariance: ArrayLike) -> list[Suspect]:
    """Rank inputs by how much of chi square an error of each alone explains.

    An error e of an input moves the differences by s e; generalised least squares gives
    e = s' C⁻¹ d / s' C⁻¹ s, which takes (s' C⁻¹ d)² / s' C⁻¹ s away from chi square (Aitken,
    https://doi.org/10.1017/S0370164600014346).

    Parameters
    ----------
    differences : array (row,)
        Measured minus predicted.
    sensitivities : array (row, input)
        Derivatives of the differences to each input.
    covariance : array (row, row)
        Of the differences.

    Returns
    -------
    list of Suspect
        The input that explains most first; one without effect is left out.

    Examples
    --------
    >>> (first, second) = suspects([2.0, 2.0], [[1.0, 1.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]])
    >>> first.inputs, round(first.error, 1), round(first.share, 1), second.inputs
    ((0,), 2.0, 1.0, (1,))
    """
    d, S = np.asarray(differences, float), np.asarray(sensitivities, float)
    root, _ = directions(np.atleast_2d(np.asarray(covariance, float)))
    seen, effects = root @ d, root @ S
    chi2, strength = float(seen @ seen), np.linalg.norm(effects, axis=0)
    able = np.flatnonzero(strength > 0.0)
    if not chi2 or not able.size:
        return []
    along = effects[:, able] / strength[able]
    share = (along.T @ seen) ** 2 / chi2
    found: list[Suspect] = []
    taken: set[int] = set()
    for place in np.argsort(-share, kind="stable"):
        if place in taken:
            continue
        cosines = np.abs(along.T @ along[:, place])
        alike = [i for i in np.argsort(-cosines, kind="stable") if cosines[i] > _ALIKE and i not in taken]
        alike = [place, *(i for i in alike if i != place)]
        taken.update(alike)
        error = float(along[:, place] @ seen / strength[able[place]])
        found.append(Suspect(tuple(int(able[i]) for i in alike), error, float(share[place])))
    return found


class Slip(NamedTuple):
    """An input that was stated a usual factor too large, and what share of chi square that explains."""

    input: int
    factor: float
    share: float


def slips(
    measured: ArrayLike,
    predicted: ArrayLike,
    powers: ArrayLike,
    covariance: ArrayLike,
    factors: Sequence[Sequence[float]],
) -> list[Slip]:
    """Look for an input that was stated wrongly by a usual factor, however far that is.

    Contacts follow power laws (Hertz: a duration goes with m^0.4 R^-0.2), so that over a factor of
    ten the logarithms still go straight where the values no longer do.

    Parameters
    ----------
    measured, predicted : array (row,)
        Positive.
    powers : array (row, input)
        Derivatives of the logarithm of measured over predicted to that of each input.
    covariance : array (row, row)
        Of that logarithm.
    factors : sequence of sequence of float
        Those to look for in each input, such as ``SLIPS["value"]``.

    Returns
    -------
    list of Slip
        The likeliest of each input, the likeliest first, and those that are nearly as likely; of slips that explain
        as much the smaller ones. Empty where none brings both together.

    Examples
    --------
    >>> powers, usual = [[0.2, 1.0], [0.4, 0.1]], [SLIPS["value"]] * 2
    >>> found = slips([1.15, 1.32], [1.0, 1.0], powers, np.diag([1e-4, 1e-4]), usual)
    >>> [(slip.input, slip.factor) for slip in found]
    [(0, 2.0)]
    """
    seen, A = np.log(np.asarray(measured, float) / np.asarray(predicted, float)), np.asarray(powers, float)
    C = np.atleast_2d(np.asarray(covariance, float))
    before = float(seen @ np.linalg.pinv(C, hermitian=True) @ seen)
    found: list[tuple[float, Slip]] = []
    for i in np.flatnonzero(np.abs(A).max(axis=0, initial=0.0) > 0.0).tolist():
        for k in factors[i]:
            shift = A[:, i] * log(k)
            wider = C + np.diag((_BENT * shift) ** 2 + (_STRAY * np.max(np.abs(shift))) ** 2)
            weight = np.linalg.pinv(wider, hermitian=True)
            known = float(shift @ weight @ shift)
            left = float((seen - shift) @ weight @ (seen - shift))
            # what is bent so far that it would fit anything must still fit best at this factor
            is_best = abs(float(shift @ weight @ seen) - known) < _OFF * known
            if is_best and known > _VAGUE**-2 and left < _LEFT * before:
                # a far slip is vaguer: likelihood, not what is left, tells it from a near one
                found.append((left + float(np.linalg.slogdet(wider)[1]), Slip(i, k, 1 - left / before)))
    found.sort(key=lambda each: round(each[0]))
    close: dict[int, Slip] = {}
    for score, slip in found:
        if score < found[0][0] + _CLOSE:
            close.setdefault(slip.input, slip)
    least = min((abs(log(slip.factor)) for slip in close.values()), default=0.0)
    return [slip for slip in close.values() if abs(log(slip.factor)) < _SMALLER * least]

"""Which input, stated wrongly, would explain a difference between measurement and model."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

_ALIKE = 0.995
"""Cosine between the effects of two inputs beyond which the comparison cannot tell them apart."""
_NO_INFORMATION = 1e-9


class Suspect(NamedTuple):
    """An input, and the error of it that explains most.

    Attributes
    ----------
    inputs : tuple of int
        The input, and those whose errors would look the same, the likeliest first.
    error : float
        By which the first of them is stated too large, in its unit.
    share : float
        Of chi square, what this error alone takes away.
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
        What explains most first; an input without effect is left out.

    Examples
    --------
    >>> (first, second) = suspects([2.0, 2.0], [[1.0, 1.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]])
    >>> first.inputs, round(first.error, 1), round(first.share, 1), second.inputs
    ((0,), 2.0, 1.0, (1,))
    """
    d, S = np.asarray(differences, float), np.asarray(sensitivities, float)
    C = np.atleast_2d(np.asarray(covariance, float))
    scale = np.sqrt(np.diagonal(C))
    values, vectors = np.linalg.eigh(C / np.outer(scale, scale))
    kept = values > _NO_INFORMATION * values.max()
    root = vectors[:, kept].T / np.sqrt(values[kept])[:, None]
    seen, effects = root @ (d / scale), root @ (S / scale[:, None])
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

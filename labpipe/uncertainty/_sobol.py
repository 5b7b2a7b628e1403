"""Sobol indices: share of each input in the variance, without assuming linearity.

Of one input: the part of the variance that would go if it were known exactly.

References
----------
A. Saltelli et al., Comput. Phys. Commun. 181 (2010) 259, doi:10.1016/j.cpc.2009.09.018.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, sqrt
from typing import Any

from labpipe.arrays import Floats
from labpipe.uncertainty._linear import Input, Model, linear_budget

_SEED = 9  # fixed: the same answer every time
_POINTS = 1024  # a power of two, as the sequence wants
_BARELY = 0.01  # of the variance: with less to spare an input would have to be known exactly


@dataclass(frozen=True, slots=True)
class Indices:
    """Shares of the variance: of the input alone, and with all its interactions."""

    first: float
    total: float


def sobol(model: Model, inputs: Mapping[str, Input]) -> dict[str, Indices]:
    """Return the Sobol indices of every uncertain input.

    Parameters
    ----------
    model, inputs
        As for :func:`linear_budget`; inputs are normal.
    """
    import numpy as np
    from scipy.stats import norm, sobol_indices

    uncertain = [name for name, given in inputs.items() if given.u > 0.0]
    best = {name: given.value for name, given in inputs.items()}
    centre = float(model(**best))
    scale = linear_budget(model, inputs).u or 1.0

    def spread(columns: Floats) -> Floats:
        # around its best value and in its own uncertainty: differences of large numbers are noise
        rows = columns.T.tolist()
        made = [model(**best | dict(zip(uncertain, row, strict=True))) for row in rows]
        return (np.array(made) - centre) / scale

    if len(uncertain) < 2:  # scipy's estimator wants two
        return {name: Indices(1.0, 1.0) for name in uncertain}
    dists: list[Any] = [norm(inputs[name].value, inputs[name].u) for name in uncertain]
    found = sobol_indices(func=spread, n=_POINTS, dists=dists, rng=np.random.default_rng(_SEED))
    first, total = np.ravel(found.first_order), np.ravel(found.total_order)
    return {name: Indices(float(a), float(b)) for name, a, b in zip(uncertain, first, total, strict=True)}


def inputs_to_halve(shares: Mapping[str, float]) -> tuple[tuple[str, ...], float]:
    """Say which inputs must be better known to halve an uncertainty, and by how much.

    Parameters
    ----------
    shares : mapping of str to float
        Of the variance.

    Returns
    -------
    tuple of str, float
        The fewest inputs, the largest first, and the factor by which all of them together must
        be better known; infinite where only their exact knowledge would just do.

    Examples
    --------
    >>> names, factor = inputs_to_halve({"inclination": 0.9, "noise": 0.1})
    >>> names, round(factor, 2)
    (('inclination',), 2.45)
    """
    order = sorted(shares, key=lambda name: -shares[name])
    taken: list[str] = []
    sum_ = 0.0
    for name in order:
        taken.append(name)
        sum_ += shares[name]
        left = sum_ - 0.75  # a quarter of the variance may stay
        if left > _BARELY:
            return tuple(taken), sqrt(sum_ / left)
    return tuple(taken), inf

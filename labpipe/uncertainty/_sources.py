"""Budgets with known sensitivities: contribution and share of each source."""

from collections.abc import Sequence
from math import sqrt
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from labpipe.arrays import Floats
from labpipe.units import Quantity

_BY_CHANCE = 0.05
"""Of repeats with nothing but the stated error, the share whose scatter is taken for more."""


class Source(NamedTuple):
    """One line of a budget.

    Attributes
    ----------
    source : str
        Its name.
    value, u : float
        The input and its standard uncertainty, in ``unit``.
    unit : str
        SI; ``u`` of a temperature in degC is in K.
    sensitivity : float
        Change of the result per change of the input.
    kind : str
        ``random`` (differs from sample to sample) or ``systematic`` (the same for all); empty
        where it is not known.
    """

    source: str
    value: float
    u: float
    unit: str
    sensitivity: float
    kind: str = ""

    @classmethod
    def of(cls, source: str, given: Quantity, sensitivity: float) -> "Source":
        """Return the line of a quantity that was stated: a systematic source."""
        return cls(source, given.value, given.u, given.si, sensitivity, "systematic")

    @property
    def contribution(self) -> float:
        """Standard uncertainty of the result that comes from this source."""
        return abs(self.sensitivity) * self.u


class Row(TypedDict):
    """A line with its contribution and its share of the variance: plain JSON types."""

    source: str
    value: float
    u: float
    unit: str
    sensitivity: float
    kind: str
    contribution: float
    share: float


def combined_uncertainty(sources: Sequence[Source]) -> float:
    """Return the root of the sum of squares.

    Examples
    --------
    >>> a = Source("a", 0, 3.0, "m", 1, "random")
    >>> combined_uncertainty([a, Source("b", 0, 2.0, "m", 2, "random")])
    5.0
    """
    return float(sum(source.contribution**2 for source in sources) ** 0.5)


def excess_uncertainty(total: float, *parts: float) -> float:
    """Return the part of a standard uncertainty beyond some of its parts, at least 0.

    Examples
    --------
    >>> excess_uncertainty(5.0, 3.0)
    4.0
    """
    return sqrt(max(total**2 - sum(part**2 for part in parts), 0.0))


def scatter_beyond(scatter: ArrayLike, stated: ArrayLike, n: ArrayLike) -> Floats:
    """Return the scatter of repeats beyond the uncertainty that each of them states, where that is more than chance.

    The larger of both would be too much: of two repeats with nothing but the stated error, the mean of
    the larger variance is 1.5 times the stated one. Scatter counts from its 95 % limit on.

    Parameters
    ----------
    scatter, stated : array-like
        Standard deviation over the repeats, and standard uncertainty of one of them.
    n : array-like of int
        Number of repeats.

    Examples
    --------
    >>> [round(float(scatter_beyond(scatter, 3.0, 2)), 2) for scatter in (5.0, 7.0)]
    [0.0, 6.32]
    """
    s, u, free = np.asarray(scatter, float), np.asarray(stated, float), np.asarray(n) - 1
    is_more = (free > 0) & (s**2 * free > u**2 * special.chdtri(np.maximum(free, 1), _BY_CHANCE))
    return np.asarray(np.where(is_more, np.sqrt(np.maximum(s**2 - u**2, 0.0)), 0.0))


def budget_rows(sources: Sequence[Source]) -> list[Row]:
    """Return the rows of a budget, largest first, with the share of each in the variance."""
    total = combined_uncertainty(sources) ** 2
    rows: list[Any] = [
        each._asdict() | {"contribution": each.contribution, "share": each.contribution**2 / total if total else 0.0}
        for each in sources
    ]
    return sorted(rows, key=lambda row: -row["contribution"])

"""Uncertainty budgets: which source contributes how much, as a table."""

from collections.abc import Sequence
from typing import Any, NamedTuple


class Source(NamedTuple):
    """One line of a budget.

    Attributes
    ----------
    source : str
        What it is.
    value, u : float
        The input and its standard uncertainty, in ``unit``.
    unit : str
        SI.
    sensitivity : float
        Change of the result per change of the input.
    kind : str
        ``random`` (differs from sample to sample) or ``systematic`` (the same for all).
    """

    source: str
    value: float
    u: float
    unit: str
    sensitivity: float
    kind: str

    @property
    def contribution(self) -> float:
        """Standard uncertainty of the result that comes from this source."""
        return abs(self.sensitivity) * self.u


def combined(sources: Sequence[Source]) -> float:
    """Return the root of the sum of squares.

    Examples
    --------
    >>> combined([Source("a", 0, 3.0, "m", 1, "random"), Source("b", 0, 2.0, "m", 2, "random")])
    5.0
    """
    return float(sum(source.contribution**2 for source in sources) ** 0.5)


def table(sources: Sequence[Source]) -> list[dict[str, Any]]:
    """Make the rows of a budget, largest first, with the share of each in the variance.

    Returns
    -------
    list of dict
        Plain JSON types.
    """
    total = combined(sources) ** 2
    rows = [
        source._asdict()
        | {
            "contribution": source.contribution,
            "share": source.contribution**2 / total if total else 0.0,
        }
        for source in sources
    ]
    return sorted(rows, key=lambda row: -row["contribution"])

"""Scalar uncertainty budgets: what each input contributes to a result, and its share.

Two ways to one table: :class:`Source` where the sensitivity is known, :func:`budget` where a
formula is, whose derivatives come from the package ``uncertainties``. Arrays carry their
uncertainty as a variable of their own (``u_<name>``); this is for the few scalars behind them.

References
----------
JCGM 100:2008 (GUM), 5.1 (propagation), 5.2 (correlation), G.4 (degrees of freedom).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, sqrt
from typing import Any, NamedTuple, TypedDict

from labpipe.errors import InputError

_SHARE_TOLERANCE = 1e-9


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


class Input(NamedTuple):
    """One input of a budget.

    Attributes
    ----------
    value, u : float
        Value and standard uncertainty, in ``unit``.
    unit : str
        SI.
    degrees_of_freedom : float
        Of ``u``; infinite when it is not from a few repeats.
    """

    value: float
    u: float
    unit: str = "1"
    degrees_of_freedom: float = inf


class Row(TypedDict):
    """One line of the table: plain JSON types."""

    source: str
    value: float
    u: float
    unit: str
    sensitivity: float
    contribution: float
    share: float


@dataclass(frozen=True, slots=True)
class Budget:
    """A result with its combined standard uncertainty and where it comes from.

    ``rows`` are sorted by contribution; shares of the variance sum to 1. The row of a correlation
    has the product of the two sensitivities and may have a negative share.
    """

    value: float
    u: float
    degrees_of_freedom: float
    rows: tuple[Row, ...]

    def expanded(self, level: float = 0.95) -> float:
        """Half width of the interval that holds the true value with this probability."""
        from scipy.stats import norm, t

        quantile = 0.5 + 0.5 * level
        if isfinite(self.degrees_of_freedom):
            return float(t.ppf(quantile, self.degrees_of_freedom)) * self.u
        return float(norm.ppf(quantile)) * self.u


def budget(
    model: Callable[..., Any],
    inputs: Mapping[str, Input],
    correlations: Mapping[tuple[str, str], float] | None = None,
) -> Budget:
    """Propagate standard uncertainties through a formula.

    Parameters
    ----------
    model : callable
        Takes every input by its name and returns a number; uses arithmetic, and
        ``uncertainties.umath`` for functions such as ``cos``.
    inputs : mapping of str to Input
    correlations : mapping of (str, str) to float, optional
        Correlation coefficients between pairs of inputs, -1 to 1; 0 where not named.

    Returns
    -------
    Budget

    Raises
    ------
    InputError
        An uncertainty is negative or not finite, or a correlation is impossible.

    Examples
    --------
    Displacement from a laser that looks along a line inclined by 12 degrees:

    >>> from uncertainties.umath import cos
    >>> found = budget(
    ...     lambda reading, inclination: reading / cos(inclination),
    ...     {"reading": Input(1.5e-3, 1e-6, "m"), "inclination": Input(0.2094, 0.0035, "rad")},
    ... )
    >>> round(found.value * 1e3, 4), round(found.u * 1e6, 2)
    (1.5335, 1.53)
    >>> [(row["source"], round(row["share"], 2)) for row in found.rows]
    [('inclination', 0.55), ('reading', 0.45)]
    """
    from uncertainties import ufloat

    for name, given in inputs.items():
        if not (isfinite(given.value) and isfinite(given.u) and given.u >= 0.0):
            message = f"{name}: expected a finite value and u >= 0, found {given.value} ± {given.u}"
            raise InputError(message)
    # Only the derivatives are used; a spread of zero would make the package warn.
    variables = {name: ufloat(given.value, 1.0) for name, given in inputs.items()}
    result = model(**variables)
    derivatives = getattr(result, "derivatives", {})
    slope = {name: float(derivatives.get(variable, 0.0)) for name, variable in variables.items()}
    variance = {name: (slope[name] * inputs[name].u) ** 2 for name in inputs}
    crossed = _crossed(inputs, slope, correlations or {})
    total = sum(variance.values()) + sum(part for *_, part in crossed)
    if total < -_SHARE_TOLERANCE * sum(variance.values()):
        message = "the correlations contradict each other: they give a negative variance"
        raise InputError(message)
    total = max(total, 0.0)
    rows = [
        _row(name, given.value, given.u, given.unit, slope[name], variance[name], total)
        for name, given in inputs.items()
    ]
    rows += [
        _row(f"correlation of {a} and {b}", r, 0.0, "1", slope[a] * slope[b], part, total)
        for a, b, r, part in crossed
    ]
    rows.sort(key=lambda row: -row["contribution"])
    value = float(getattr(result, "nominal_value", result))
    return Budget(value, sqrt(total), _effective(inputs, variance, total), tuple(rows))


def combine(rows: Sequence[Row]) -> float:
    """Return the combined standard uncertainty of a table's rows (root of the sum of squares).

    Correlation rows count with the sign of their share.

    Examples
    --------
    >>> combine(budget(lambda a, b: a - b, {"a": Input(5, 3), "b": Input(1, 4)}).rows)
    5.0
    """
    total = sum((1.0 if row["share"] >= 0 else -1.0) * row["contribution"] ** 2 for row in rows)
    return sqrt(max(total, 0.0))


def _row(
    source: str, value: float, u: float, unit: str, sensitivity: float, part: float, total: float
) -> Row:
    return {
        "source": source,
        "value": float(value),
        "u": float(u),
        "unit": unit,
        "sensitivity": sensitivity,
        "contribution": sqrt(abs(part)),
        "share": part / total if total else 0.0,
    }


def _crossed(
    inputs: Mapping[str, Input],
    slope: Mapping[str, float],
    correlations: Mapping[tuple[str, str], float],
) -> list[tuple[str, str, float, float]]:
    """Pairs with their correlation and the variance that it adds."""
    crossed = []
    for (a, b), r in correlations.items():
        if a not in inputs or b not in inputs or a == b or not abs(r) <= 1.0:
            known = ", ".join(inputs)
            message = f"correlation of {a} and {b} is {r}: expected -1 to 1 between two of {known}"
            raise InputError(message)
        crossed.append((a, b, float(r), 2 * r * slope[a] * slope[b] * inputs[a].u * inputs[b].u))
    return crossed


def _effective(inputs: Mapping[str, Input], variance: Mapping[str, float], total: float) -> float:
    """Welch-Satterthwaite; infinite when every input's is."""
    parts = sum(variance[name] ** 2 / given.degrees_of_freedom for name, given in inputs.items())
    return total**2 / parts if parts else inf

"""Propagation of uncertainty through any function: linear, by Monte Carlo, and by Sobol indices.

The linear way gives a budget, Monte Carlo checks it: where the ends of the two coverage intervals
agree within the last digit that is stated, the linear budget stands (GUM Supplement 1, 8). Sobol
indices say the same of single inputs without linearity: how much of the variance would be left
if one were known exactly.

References
----------
JCGM 101:2008 (GUM Supplement 1), 6.4 (assignment of distributions) and 8 (validation);
A. Saltelli et al., Comput. Phys. Commun. 181 (2010) 259, doi:10.1016/j.cpc.2009.09.018.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, log10, sqrt
from typing import TYPE_CHECKING, Any

from labpipe.errors import InputError
from labpipe.uncertainty import Budget, Input, Row

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Model = Callable[..., float]

_SEED = 9  # fixed: the same answer every time
_DRAWS = 4000
_SOBOL_POINTS = 1024  # a power of two, as the sequence wants
_DIGITS = 2  # with which an uncertainty is stated


def repeated(values: Sequence[float]) -> Input:
    """Return the mean of repeats with its type A uncertainty and degrees of freedom.

    Parameters
    ----------
    values : sequence of float
        At least two.

    Raises
    ------
    InputError
        There are fewer than two values, or one is not finite.

    Examples
    --------
    >>> found = repeated([1.0, 2.0, 3.0])
    >>> found.value, round(found.u, 4), found.degrees_of_freedom
    (2.0, 0.5774, 2)
    """
    n = len(values)
    if n < 2 or not all(isfinite(v) for v in values):
        message = f"{n} repeats: expected at least two finite values for a standard deviation"
        raise InputError(message)
    mean = sum(values) / n
    variance = sum((v - mean) ** 2 for v in values) / (n - 1)
    return Input(mean, sqrt(variance / n), degrees_of_freedom=n - 1)


def linear(model: Model, inputs: Mapping[str, Input]) -> Budget:
    """Propagate through a function of floats, with derivatives over one standard uncertainty.

    Parameters
    ----------
    model : callable
        Takes every input by its name and returns a number.
    inputs : mapping of str to Input

    Returns
    -------
    Budget

    Examples
    --------
    >>> made = linear(lambda a, b: a * b, {"a": Input(2.0, 0.1), "b": Input(5.0, 0.0)})
    >>> made.value, round(made.u, 3)
    (10.0, 0.5)
    """
    best = {name: given.value for name, given in inputs.items()}
    value = float(model(**best))
    slopes = {
        name: (
            model(**best | {name: given.value + given.u})
            - model(**best | {name: given.value - given.u})
        )
        / (2.0 * given.u)
        if given.u > 0.0
        else 0.0
        for name, given in inputs.items()
    }
    parts = {name: (slopes[name] * inputs[name].u) ** 2 for name in inputs}
    total = sum(parts.values())
    rows: list[Row] = [
        {
            "source": name, "value": given.value, "u": given.u, "unit": given.unit,
            "sensitivity": slopes[name], "contribution": sqrt(parts[name]),
            "share": parts[name] / total if total else 0.0,
        }
        for name, given in inputs.items()
    ]  # fmt: skip
    rows.sort(key=lambda row: -row["contribution"])
    weights = sum(parts[n] ** 2 / given.degrees_of_freedom for n, given in inputs.items())
    return Budget(value, sqrt(total), total**2 / weights if weights else inf, tuple(rows))


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """What draws of the inputs make of the result: its mean, spread, and central interval."""

    value: float
    u: float
    low: float
    high: float
    draws: int = _DRAWS


def monte_carlo(
    model: Model, inputs: Mapping[str, Input], *, level: float = 0.95, draws: int = _DRAWS
) -> MonteCarlo:
    """Propagate distributions: normal, or Student's where degrees of freedom are finite.

    Parameters
    ----------
    model, inputs
        As for :func:`linear`.
    level : float
        Of the interval.
    draws : int
        How many; the same ones every time.
    """
    import numpy as np

    generator = np.random.default_rng(_SEED)
    columns = {}
    for name, given in inputs.items():
        freedom = given.degrees_of_freedom
        shape = (
            generator.standard_t(freedom, draws)
            if isfinite(freedom)
            else generator.standard_normal(draws)
        )
        columns[name] = (given.value + given.u * shape).tolist()
    made = np.array([
        model(**dict(zip(columns, row, strict=True)))
        for row in zip(*columns.values(), strict=True)
    ])  # fmt: skip
    low, high = np.quantile(made, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return MonteCarlo(float(made.mean()), float(made.std(ddof=1)), float(low), float(high), draws)


def agrees(budget: Budget, drawn: MonteCarlo, *, level: float = 0.95) -> bool:
    """Tell whether the linear interval stands: both ends within half the last stated digit.

    The draws' own scatter is allowed for: an end of theirs is known to 4 % of u only, and to less
    where repeats are few.
    """
    if budget.u == 0.0:
        return drawn.u == 0.0
    digit = 10.0 ** (floor(log10(budget.u)) - _DIGITS + 1)
    scatter = _end_scatter(budget.degrees_of_freedom, level, drawn.draws)
    tolerance = max(0.5 * digit, 3.0 * scatter * budget.u)
    return apart(budget, drawn, level=level) <= tolerance


def apart(budget: Budget, drawn: MonteCarlo, *, level: float = 0.95) -> float:
    """Return by how much the ends of the linear and of the drawn interval differ at most."""
    half = budget.expanded(level)
    return max(abs(budget.value - half - drawn.low), abs(budget.value + half - drawn.high))


def _end_scatter(freedom: float, level: float, draws: int) -> float:
    """Return the standard deviation of the end of a drawn interval, in units of u."""
    from scipy.stats import norm, t

    law = t(freedom) if isfinite(freedom) else norm()
    tail = 0.5 - 0.5 * level
    return float(sqrt(tail * (1.0 - tail) / draws) / law.pdf(law.ppf(tail)))


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
        As for :func:`linear`; inputs are normal.
    """
    import numpy as np
    from scipy.stats import norm, sobol_indices

    uncertain = [name for name, given in inputs.items() if given.u > 0.0]
    best = {name: given.value for name, given in inputs.items()}
    centre = float(model(**best))
    scale = linear(model, inputs).u or 1.0

    def spread(columns: "Array") -> "Array":
        # around its best value and in its own uncertainty: differences of large numbers are noise
        rows = columns.T.tolist()
        made = [model(**best | dict(zip(uncertain, row, strict=True))) for row in rows]
        return (np.array(made) - centre) / scale

    if len(uncertain) < 2:  # scipy's estimator wants two
        return {name: Indices(1.0, 1.0) for name in uncertain}
    dists: list[Any] = [norm(inputs[name].value, inputs[name].u) for name in uncertain]
    found = sobol_indices(func=spread, n=_SOBOL_POINTS, dists=dists,
                          rng=np.random.default_rng(_SEED))  # fmt: skip
    first, total = np.ravel(found.first_order), np.ravel(found.total_order)
    return {
        name: Indices(float(a), float(b))
        for name, a, b in zip(uncertain, first, total, strict=True)
    }


def to_halve(shares: Mapping[str, float]) -> tuple[tuple[str, ...], float]:
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
    >>> names, factor = to_halve({"inclination": 0.9, "noise": 0.1})
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


_BARELY = 0.01  # of the variance: with less to spare an input would have to be known exactly

"""Monte Carlo propagation of uncertainty, as a check of the linear one.

Where the ends of the two coverage intervals agree within the last digit that is stated, the linear
budget holds.

References
----------
JCGM 101:2008 (GUM Supplement 1), 6.4 (assignment of distributions) and 8 (validation).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, isfinite, log10, sqrt

from labpipe.uncertainty._linear import Budget, Input, Model

_SEED = 9  # fixed: the same answer every time
_DRAWS = 4000
_LEVEL = 0.95  # of the intervals
_DIGITS = 2  # with which an uncertainty is stated


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """Mean, spread and central interval of the result over draws of the inputs."""

    value: float
    u: float
    low: float
    high: float
    draws: int = _DRAWS


def monte_carlo(model: Model, inputs: Mapping[str, Input], *, draws: int = _DRAWS) -> MonteCarlo:
    """Propagate distributions: normal, or Student's where degrees of freedom are finite.

    Parameters
    ----------
    model, inputs
        As for :func:`linear_budget`.
    draws : int
        How many; the same ones every time.
    """
    import numpy as np

    generator = np.random.default_rng(_SEED)
    columns = {}
    for name, given in inputs.items():
        freedom = given.degrees_of_freedom
        shape = generator.standard_t(freedom, draws) if isfinite(freedom) else generator.standard_normal(draws)
        columns[name] = (given.value + given.u * shape).tolist()
    made = np.array([model(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)])
    low, high = np.quantile(made, [0.5 - 0.5 * _LEVEL, 0.5 + 0.5 * _LEVEL])
    return MonteCarlo(float(made.mean()), float(made.std(ddof=1)), float(low), float(high), draws)


def intervals_agree(budget: Budget, drawn: MonteCarlo) -> bool:
    """Return whether the linear interval holds: both ends within half the last stated digit.

    The draws' own scatter is allowed for: an end of theirs is known to 4 % of u only, and to less
    where repeats are few.
    """
    from scipy.stats import norm, t

    if budget.u == 0.0:
        return drawn.u == 0.0
    digit = 10.0 ** (floor(log10(budget.u)) - _DIGITS + 1)
    law = t(budget.degrees_of_freedom) if isfinite(budget.degrees_of_freedom) else norm()
    tail = 0.5 - 0.5 * _LEVEL
    scatter = float(sqrt(tail * (1.0 - tail) / drawn.draws) / law.pdf(law.ppf(tail)))  # of a drawn end, in units of u
    return interval_difference(budget, drawn) <= max(0.5 * digit, 3.0 * scatter * budget.u)


def interval_difference(budget: Budget, drawn: MonteCarlo) -> float:
    """Return the largest difference of the ends of the linear and of the drawn interval."""
    half = budget.expanded(_LEVEL)
    return max(abs(budget.value - half - drawn.low), abs(budget.value + half - drawn.high))

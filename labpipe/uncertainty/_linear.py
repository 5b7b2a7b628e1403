"""Linear propagation of uncertainty: through a formula, and through derivatives and a covariance.

References
----------
JCGM 100:2008 (GUM), 5.1 and 5.2 (propagation without and with correlation), G.4 (degrees of
freedom).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from labpipe.errors import InputError
from labpipe.uncertainty._sources import Row, Source, budget_rows, combined_uncertainty

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from labpipe.arrays import Floats

    Covariance = NDArray[np.floating[Any]]

Model = Callable[..., float]
"""A formula: takes every input by its name and returns a number."""


class Input(NamedTuple):
    """One input of a formula.

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


@dataclass(frozen=True, slots=True)
class Budget:
    """A result with its combined standard uncertainty and where it comes from.

    ``rows`` are sorted by contribution; shares of the variance sum to 1.
    """

    value: float
    u: float
    degrees_of_freedom: float
    rows: tuple[Row, ...]

    def expanded(self, level: float = 0.95) -> float:
        """Half width of the interval that holds the true value with this probability."""
        from scipy.special import ndtri, stdtrit

        quantile = 0.5 + 0.5 * level
        if isfinite(self.degrees_of_freedom):
            return float(stdtrit(self.degrees_of_freedom, quantile)) * self.u
        return float(ndtri(quantile)) * self.u


def linear_budget(model: Model, inputs: Mapping[str, Input]) -> Budget:
    """Propagate through a formula, with derivatives over one standard uncertainty.

    Parameters
    ----------
    model : callable
        Takes every input by its name and returns a number.
    inputs : mapping of str to Input
        Independent of each other: a part that two of them share is an input of its own.

    Returns
    -------
    Budget

    Raises
    ------
    InputError
        An uncertainty is negative.

    Examples
    --------
    Displacement from a laser that looks along a line inclined by 12 degrees:

    >>> from math import cos
    >>> found = linear_budget(
    ...     lambda reading, inclination: reading / cos(inclination),
    ...     {"reading": Input(1.5e-3, 1e-6, "m"), "inclination": Input(0.2094, 0.0035, "rad")},
    ... )
    >>> round(found.value * 1e3, 4), round(found.u * 1e6, 2)
    (1.5335, 1.53)
    >>> [(row["source"], round(row["share"], 2)) for row in found.rows]
    [('inclination', 0.55), ('reading', 0.45)]
    """
    best = {name: given.value for name, given in inputs.items()}

    def slope(name: str, given: Input) -> float:
        if given.u < 0.0:
            raise InputError(f"{name}: a standard uncertainty cannot be negative, found {given.u}")
        if given.u == 0.0:
            return 0.0
        ends = (model(**best | {name: given.value + way * given.u}) for way in (1.0, -1.0))
        return float(next(ends) - next(ends)) / (2.0 * given.u)

    value = float(model(**best))
    sources = {n: Source(n, g.value, g.u, g.unit, slope(n, g)) for n, g in inputs.items()}
    u = combined_uncertainty(list(sources.values()))
    # Welch-Satterthwaite; infinite when every input's are
    weights = sum(sources[n].contribution ** 4 / g.degrees_of_freedom for n, g in inputs.items())
    return Budget(value, u, u**4 / weights if weights else inf, tuple(budget_rows([*sources.values()])))


def propagated_variance(slopes: "Floats", covariance: "Covariance") -> "Floats":
    """Return the variances of results from their derivatives and the covariance behind them.

    Parameters
    ----------
    slopes : array (..., p)
        Change of every result per change of every parameter.
    covariance : array (p, p)
        Of the parameters.

    Returns
    -------
    array (...)
        Not below zero, where rounding would make it so.

    Examples
    --------
    The part that two readings share cancels in their difference:

    >>> import numpy as np
    >>> float(propagated_variance(np.array([1.0, -1.0]), np.array([[5.0, 4.0], [4.0, 5.0]])))
    2.0
    """
    return ((slopes @ covariance) * slopes).sum(axis=-1).clip(min=0.0)


def propagated_u(slopes: "Floats", covariance: "Covariance") -> "Floats":
    """Return the standard uncertainties (...) of results; see :func:`propagated_variance`."""
    return propagated_variance(slopes, covariance) ** 0.5


def propagated_covariance(slopes: "Floats", covariance: "Covariance") -> "Floats":
    """Return the covariance (n, n) of results from their derivatives (n, p) and that of inputs."""
    return slopes @ covariance @ slopes.T

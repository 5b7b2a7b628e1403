"""One variable of a Dataset with its SI unit and its long name, in one call."""

from collections.abc import Sequence
from typing import Any


def described(units: str, long_name: str, **more: Any) -> dict[str, Any]:
    """Return the attributes of a variable: its SI unit, what it is in words, and more.

    Examples
    --------
    >>> described("m", "contact radius")
    {'units': 'm', 'long_name': 'contact radius'}
    """
    return {"units": units, "long_name": long_name, **more}


def variable(
    dims: str | Sequence[str], values: Any, units: str, long_name: str, **more: Any
) -> tuple[str | Sequence[str], Any, dict[str, Any]]:
    """Return a variable as xarray takes it: dimensions, values, attributes.

    Parameters
    ----------
    dims : str or sequence of str
        Dimensions of `values`; ``()`` for one number.
    values : array or number
        In SI.
    units, long_name : str
        See :func:`described`.
    **more
        Further attributes.
    """
    return dims, values, described(units, long_name, **more)

"""One variable of a Dataset with its SI unit and its long name, in one call."""

from collections.abc import Mapping, Sequence
from typing import Any

Variable = tuple[str | Sequence[str], Any, dict[str, Any]]
"""As xarray takes it: dimensions, values, attributes."""


def described(units: str, long_name: str, **more: Any) -> dict[str, Any]:
    """Return the attributes of a variable: its SI unit, its long name, and more.

    Examples
    --------
    >>> described("m", "contact radius")
    {'units': 'm', 'long_name': 'contact radius'}
    """
    return {"units": units, "long_name": long_name, **more}


def variable(dims: str | Sequence[str], values: Any, units: str, long_name: str, **more: Any) -> Variable:
    """Return a variable as xarray takes it: dimensions (``()`` for one number), values in SI, attributes.

    ``units``, ``long_name`` and further attributes are those of :func:`described`.
    """
    return dims, values, described(units, long_name, **more)


def with_u(
    name: str, dims: str | Sequence[str], values: Any, u: Any, units: str, long_name: str, part: str = ""
) -> dict[str, Variable]:
    """Return a variable by its name, and its standard uncertainty.

    ``part`` says of which part that is, such as ``"from first touch"``.

    Examples
    --------
    >>> sorted(with_u("force", (), 1.0, 0.1, "N", "largest force"))
    ['force', 'u_force']
    """
    return {
        name: variable(dims, values, units, long_name),
        f"u_{name}": variable(dims, u, units, f"standard uncertainty{part and f' {part}'}: {long_name}"),
    }


def from_rows(
    dim: str, rows: Sequence[Mapping[str, Any]], columns: Mapping[str, tuple[str, str]]
) -> dict[str, Variable]:
    """Return the variables of a table that was gathered row by row, over the dimension ``dim``.

    Rows are values by name, ``u_NAME`` the standard uncertainty of NAME; columns have a unit and a long name, and an
    uncertainty that the rows hold comes with them.
    """
    made: dict[str, Variable] = {}
    for name, (units, text) in columns.items():
        values = [row[name] for row in rows]
        if rows and f"u_{name}" in rows[0]:
            made |= with_u(name, dim, values, [row[f"u_{name}"] for row in rows], units, text)
        else:
            made[name] = variable(dim, values, units, text)
    return made

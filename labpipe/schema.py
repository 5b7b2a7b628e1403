"""Schemas of Datasets (variables, dimensions, units) and their check.

The workflow checks a result against the schema that its stage names, so a mistake is caught where it is made.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from labpipe.errors import InputError

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable: its dimensions and its SI unit."""

    dims: tuple[str, ...]
    units: str


@dataclass(frozen=True, slots=True)
class Schema:
    """Variables and coordinates by name; further ones are allowed when they carry ``units``."""

    name: str
    variables: dict[str, Variable] = field(default_factory=dict)


def check(dataset: "xr.Dataset", schema: Schema) -> "xr.Dataset":
    """Return the Dataset unchanged when it fits, or say everything that does not.

    Raises InputError: A variable is missing, has other dimensions, or another unit; or a variable carries no ``units``
    or ``long_name``; or an uncertainty ``u_x`` comes without its ``x``.
    """
    problems = []
    for name, expected in schema.variables.items():
        if name not in dataset.variables:
            problems.append(f'variable "{name}" is missing')
            continue
        found = dataset[name]
        if tuple(map(str, found.dims)) != expected.dims:
            problems.append(f'"{name}" has dimensions {found.dims}, expected {expected.dims}')
        if found.attrs.get("units", "") != expected.units:
            problems.append(f'"{name}" is in "{found.attrs.get("units", "")}", expected "{expected.units}"')
    for name in map(str, dataset.data_vars):
        attrs = dataset[name].attrs
        is_number = dataset[name].dtype.kind in "fiu"
        problems += [f'"{name}" carries no {key}' for key in ("units", "long_name") if is_number and key not in attrs]
        if name.startswith("u_") and name[2:] not in dataset.variables:
            problems.append(f'"{name}" stands without "{name[2:]}"')
    if problems:
        raise InputError(f"{schema.name}: " + "; ".join(problems))
    return dataset

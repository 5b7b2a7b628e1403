"""Uncertain inputs of a simulation or comparison, stored with it: names, values, standard uncertainties and units."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from labpipe.units import Quantity
from labpipe.variables import variable

INPUTS = ("input_value", "input_u", "input_unit")
"""Variables over ``uncertain``, the names of the inputs."""


def table_of(given: Mapping[str, Quantity]) -> xr.Dataset:
    """Return inputs by their names as the variables :data:`INPUTS`, in SI."""
    value, u, unit = ([getattr(q, name) for q in given.values()] for name in ("value", "u", "si"))
    columns = {
        "input_value": variable("uncertain", value, "1", "value of an input of the model, SI"),
        "input_u": variable("uncertain", u, "1", "standard uncertainty of an input of the model, SI"),
        "input_unit": ("uncertain", np.array(unit, dtype=str)),
    }
    return xr.Dataset(columns, {"uncertain": np.array(list(given), dtype=str)})


def inputs_of(made: xr.Dataset | None) -> dict[str, Quantity]:
    """Return the inputs that were stored with a result; empty where nothing was simulated."""
    if made is None or "uncertain" not in made.coords:
        return {}
    columns = (made[name].values.tolist() for name in ("uncertain", *INPUTS))
    return {str(name): Quantity(value, u, str(unit)) for name, value, u, unit in zip(*columns, strict=True)}


def slopes_of(compared: xr.Dataset, name: str, i: int) -> dict[str, float]:
    """Return the changes of a value, the ``i``-th of the slopes that a comparison holds, with its inputs."""
    return dict(zip(compared["uncertain"].values.tolist(), compared[name].values[:, i].tolist(), strict=True))

"""What is uncertain of a material, as inputs that the rows of a comparison share."""

import json
from collections.abc import Sequence
from typing import Any

import xarray as xr

from labpipe.uncertainty import Source, budget_rows
from labpipe.units import Quantity

_ATTRIBUTE = "of_material"


def kept_in(sources: Sequence[Source]) -> dict[str, str]:
    """Return the attribute by which a model remembers sources whose sensitivities are relative to its answer."""
    return {_ATTRIBUTE: json.dumps(budget_rows(sources))}


def material_inputs(model: xr.Dataset | None) -> dict[str, Quantity]:
    """Return temperature, Poisson's ratio and the rest by their names."""
    return {row["source"]: Quantity(row["value"], row["u"], row["unit"]) for row in _rows(model)}


def material_slopes(model: xr.Dataset, expected: float) -> dict[str, float]:
    """Return the derivatives of measured minus expected to each of these inputs."""
    return {row["source"]: -expected * row["sensitivity"] for row in _rows(model)}


def _rows(model: xr.Dataset | None) -> list[dict[str, Any]]:
    return [] if model is None else list(json.loads(model.attrs.get(_ATTRIBUTE, "[]")))

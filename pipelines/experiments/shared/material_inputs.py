"""Uncertain properties of a material, as inputs that the rows of a comparison share."""

import json
from collections.abc import Sequence
from typing import Any

import xarray as xr

from labpipe.uncertainty import Source, budget_rows
from labpipe.units import Quantity

_ATTRIBUTE = "of_material"


def kept_in(sources: Sequence[Sequence[Source]]) -> dict[str, str]:
    """Return the attribute by which a model remembers, of each answer, sources with sensitivities relative to it."""
    return {_ATTRIBUTE: json.dumps([budget_rows(each) for each in sources])}


def material_inputs(model: xr.Dataset | None) -> dict[str, Quantity]:
    """Return temperature, Poisson's ratio and the rest by their names."""
    return {row["source"]: Quantity(row["value"], row["u"], row["unit"]) for row in _rows(model)}


def material_slopes(model: xr.Dataset, expected: float, answer: int = 0) -> dict[str, float]:
    """Return the derivatives of measured minus expected, of one of the answers, to each of these inputs."""
    return {row["source"]: -expected * row["sensitivity"] for row in _rows(model, answer)}


def _rows(model: xr.Dataset | None, answer: int = 0) -> list[dict[str, Any]]:
    found = [] if model is None else json.loads(model.attrs.get(_ATTRIBUTE, "[]"))
    return list(found[answer]) if found else []

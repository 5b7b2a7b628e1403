"""Budgets of a relaxation: relaxed reduced modulus."""

import json
from collections.abc import Iterator, Sequence

import xarray as xr

from pipelines.experiments.shared.budget_quantity import TESTS, Quantity, model_quantity


def quantities(curves: Sequence[xr.Dataset]) -> Iterator[Quantity]:
    """Yield the relaxed reduced modulus of the first tests; nothing that was not found."""
    for number, curve in enumerate(curves[:TESTS], 1):
        if "reduced_modulus" in curve:
            rows = json.loads(curve.attrs["budgets"])[0]
            modulus = float(curve["reduced_modulus"][0])
            yield model_quantity(f"relaxed reduced modulus, test {number}", modulus, "Pa", rows)

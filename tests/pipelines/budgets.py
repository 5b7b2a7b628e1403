"""Budgets of a processed experiment."""

from pathlib import Path

from pipelines.experiments import KINDS
from pipelines.experiments.shared.budget_quantity import Quantity
from pipelines.session import derive, opened


def quantities(folder: Path, name: str) -> dict[str, Quantity]:
    """Return the quantities of a processed experiment by their names."""
    results = opened(folder)
    experiment = results.experiments[name]
    return {q.name: q for q in derive(results, experiment, KINDS[experiment.kind].budget)}

"""Main reported quantities of every kind of experiment as formulas of their uncertain inputs.

A formula can be propagated linearly, by Monte Carlo and by Sobol indices
(:mod:`labpipe.uncertainty`). One module holds what belongs together; what all share stands in
:mod:`pipelines.experiments.budgets.quantity`.
"""

from pipelines.experiments.budgets.drops import ball_drop
from pipelines.experiments.budgets.films import contact_area, dic_validation
from pipelines.experiments.budgets.indentations import harmonic, relaxation
from pipelines.experiments.budgets.loading import static_loading
from pipelines.experiments.budgets.plates import plate_vibration
from pipelines.experiments.budgets.quantity import ASKED, MEASURED, TESTS, Quantity
from pipelines.experiments.budgets.rheometer import dma

__all__ = [
    "ASKED", "MEASURED", "TESTS", "Quantity", "ball_drop", "contact_area", "dic_validation", "dma",
    "harmonic", "plate_vibration", "relaxation", "static_loading",
]  # fmt: skip

"""Main reported quantities of every kind of experiment as formulas of their uncertain inputs.

A formula can be propagated linearly, by Monte Carlo and by Sobol indices
(:mod:`labpipe.propagation`). One module holds what belongs together; what all share stands in
:mod:`pipelines.experiments.shared.budget_quantity`.
"""

from pipelines.experiments.ball_drop.budget import ball_drop
from pipelines.experiments.contact_area.budget import contact_area, dic_validation
from pipelines.experiments.dma.budget import dma
from pipelines.experiments.plate_vibration.budget import plate_vibration
from pipelines.experiments.relaxation.budget import harmonic, relaxation
from pipelines.experiments.shared.budget_quantity import ASKED, MEASURED, TESTS, Quantity
from pipelines.experiments.static_loading.budget import static_loading

__all__ = [
    "ASKED", "MEASURED", "TESTS", "Quantity", "ball_drop", "contact_area", "dic_validation", "dma",
    "harmonic", "plate_vibration", "relaxation", "static_loading",
]  # fmt: skip

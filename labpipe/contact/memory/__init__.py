"""The fading memory of linear viscoelastic springs, and the histories that load them."""

from labpipe.contact.memory._creep import (
    Condensed,
    Creep,
    CreepMaterial,
    StepWeights,
    advance,
    condense,
    history,
    late_share,
    step_weights,
)
from labpipe.contact.memory._histories import checked_history, checked_load

__all__ = [
    "Condensed",
    "Creep",
    "CreepMaterial",
    "StepWeights",
    "advance",
    "checked_history",
    "checked_load",
    "condense",
    "history",
    "late_share",
    "step_weights",
]

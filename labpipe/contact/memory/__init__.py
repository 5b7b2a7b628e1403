"""The fading memory of linear viscoelastic springs, and the histories that load them."""

from labpipe.contact.memory._creep import (
    Condensed as Condensed,
    Creep as Creep,
    CreepMaterial as CreepMaterial,
    StepWeights as StepWeights,
    advance as advance,
    condense as condense,
    history as history,
    late_share as late_share,
    step_weights as step_weights,
)
from labpipe.contact.memory._histories import checked_history as checked_history, checked_load as checked_load

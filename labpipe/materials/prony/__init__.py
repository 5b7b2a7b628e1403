"""The linear viscoelastic solid as a Prony series, and the conversion of its two forms."""

from labpipe.materials.prony._interconversion import (
    Relaxation as Relaxation,
    Retardation as Retardation,
    creep_from_relaxation as creep_from_relaxation,
    relaxation_from_creep as relaxation_from_creep,
)
from labpipe.materials.prony._prony import (
    Prony as Prony,
    maxwell as maxwell,
    standard_linear_solid as standard_linear_solid,
)

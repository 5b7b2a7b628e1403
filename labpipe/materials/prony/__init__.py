"""The linear viscoelastic solid as a Prony series, and the conversion of its two forms."""

from labpipe.materials.prony._interconversion import (
    Retardation as Retardation,
    relaxation_from_creep as relaxation_from_creep,
)
from labpipe.materials.prony._prony import Prony as Prony

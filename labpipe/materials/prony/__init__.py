"""The linear viscoelastic solid as a Prony series, and the conversion of its two forms."""

from labpipe.materials.prony._interconversion import (
    Relaxation,
    Retardation,
    creep_from_relaxation,
    relaxation_from_creep,
)
from labpipe.materials.prony._models import generalised_maxwell, kelvin_voigt, maxwell, standard_linear_solid
from labpipe.materials.prony._prony import Prony

__all__ = [
    "Prony",
    "Relaxation",
    "Retardation",
    "creep_from_relaxation",
    "generalised_maxwell",
    "kelvin_voigt",
    "maxwell",
    "relaxation_from_creep",
    "standard_linear_solid",
]

"""Linear viscoelastic materials: Prony series, interconversion, master curves, library."""

from labpipe.materials.amplitude import Kraus
from labpipe.materials.kramers_kronig import KramersKronig, kramers_kronig
from labpipe.materials.library import Material, describe, load, load_file, read_material
from labpipe.materials.master_curve import master_curve
from labpipe.materials.master_curve_result import MasterCurve
from labpipe.materials.models import (
    generalised_maxwell,
    kelvin_voigt,
    maxwell,
    standard_linear_solid,
)
from labpipe.materials.prony import Prony
from labpipe.materials.reduction import fewest_terms
from labpipe.materials.shift_law import ShiftLaw, arrhenius, shift_at, wlf
from labpipe.materials.thermal_properties import Thermal, thermal

__all__ = [
    "KramersKronig",
    "Kraus",
    "MasterCurve",
    "Material",
    "Prony",
    "ShiftLaw",
    "Thermal",
    "arrhenius",
    "describe",
    "fewest_terms",
    "generalised_maxwell",
    "kelvin_voigt",
    "kramers_kronig",
    "load",
    "load_file",
    "master_curve",
    "maxwell",
    "read_material",
    "shift_at",
    "standard_linear_solid",
    "thermal",
    "wlf",
]

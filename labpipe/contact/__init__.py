"""Viscoelastic contact: indentation and impact."""

from labpipe.contact.beyond import (
    AdhesionEstimate,
    Heating,
    adhesion_in_impact,
    adhesive_indentation,
    adhesive_pull_off,
    amplitude_sweep,
    dmt,
    flash_temperature,
    jkr,
    jkr_at_force,
    maugis,
    pull_off,
    self_heating,
    tabor,
)
from labpipe.contact.impact import Plate, Shortcuts, compile_drop, drop, impacts
from labpipe.contact.line import (
    dissipated_power,
    dissipated_work,
    dissipation_map,
    dynamic_stiffness,
    indent,
    indent_load,
    tapping_amplitude,
)
from labpipe.contact.lumped import collision
from labpipe.contact.sphere import load_sphere, press_sphere

__all__ = [
    "AdhesionEstimate",
    "Heating",
    "Plate",
    "Shortcuts",
    "adhesion_in_impact",
    "adhesive_indentation",
    "adhesive_pull_off",
    "amplitude_sweep",
    "collision",
    "compile_drop",
    "dissipated_power",
    "dissipated_work",
    "dissipation_map",
    "dmt",
    "drop",
    "dynamic_stiffness",
    "flash_temperature",
    "impacts",
    "indent",
    "indent_load",
    "jkr",
    "jkr_at_force",
    "load_sphere",
    "maugis",
    "press_sphere",
    "pull_off",
    "self_heating",
    "tabor",
    "tapping_amplitude",
]

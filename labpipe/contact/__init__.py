"""Viscoelastic contact: indentation and impact."""

from labpipe.contact.adhesion import dmt, jkr, jkr_at_force, maugis, pull_off, tabor
from labpipe.contact.adhesion_estimate import AdhesionEstimate, adhesion_in_impact
from labpipe.contact.adhesive_mdr import adhesive_indentation, adhesive_pull_off
from labpipe.contact.amplitude import amplitude_sweep
from labpipe.contact.collision import collision
from labpipe.contact.dissipation import (
    dissipated_work,
    dissipation_map,
    dynamic_stiffness,
    tapping_amplitude,
)
from labpipe.contact.drop_setup import Shortcuts
from labpipe.contact.heating import Heating, flash_temperature, self_heating
from labpipe.contact.impact import drop
from labpipe.contact.indentation import indent, indent_load
from labpipe.contact.plate import Plate
from labpipe.contact.static_loading import load_sphere, press_sphere

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
    "dissipated_work",
    "dissipation_map",
    "dmt",
    "drop",
    "dynamic_stiffness",
    "flash_temperature",
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

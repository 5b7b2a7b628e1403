"""Viscoelastic contact: indentation and impact."""

from labpipe.contact.collision import collision
from labpipe.contact.dissipation import (
    dissipated_work,
    dissipation_map,
    dynamic_stiffness,
    tapping_amplitude,
)
from labpipe.contact.impact import drop
from labpipe.contact.indentation import indent, indent_load
from labpipe.contact.plate import Plate
from labpipe.contact.static_loading import load_sphere, press_sphere

__all__ = [
    "Plate",
    "collision",
    "dissipated_work",
    "dissipation_map",
    "drop",
    "dynamic_stiffness",
    "indent",
    "indent_load",
    "load_sphere",
    "press_sphere",
    "tapping_amplitude",
]

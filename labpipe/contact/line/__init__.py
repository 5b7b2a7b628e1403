"""Periodic line contact (chapter 2): indentation, closed forms, dissipation."""

from labpipe.contact.line import dissipation, westergaard
from labpipe.contact.line._conjugate_gradients import GeneralContact
from labpipe.contact.line._indent import indent, indent_load
from labpipe.contact.line._kernels import line_kernel
from labpipe.contact.line._thesis_scheme import indent_thesis_scheme
from labpipe.contact.line.dissipation import (
    dimensionless_frequency,
    dimensionless_length,
    dissipated_power,
    dissipated_work,
    dissipation_map,
    dynamic_stiffness,
    equilibrium,
    tapping_amplitude,
)

__all__ = [
    "GeneralContact",
    "dimensionless_frequency",
    "dimensionless_length",
    "dissipated_power",
    "dissipated_work",
    "dissipation",
    "dissipation_map",
    "dynamic_stiffness",
    "equilibrium",
    "indent",
    "indent_load",
    "indent_thesis_scheme",
    "line_kernel",
    "tapping_amplitude",
    "westergaard",
]

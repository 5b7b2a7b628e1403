"""The texts of the guide: where they are, and in which order they are read."""

from pathlib import Path

from labpipe import files

GUIDES = Path(files.__file__).parent / "documentation"
PICTURES = GUIDES / "pictures"
"""Drawn while the site is built, and kept for those who have the package alone."""

_FIRST = ("tutorial", "page", "experimenter", "analyst", "rheology", "films", "fringes", "gallery")
_METHODS = ("beyond", "validation", "agreement", "budgets", "identification", "reliability", "scale")
_REFERENCE = ("settings", "commands", "python")
_OTHERS = ("developer", "architecture", "coverage")
PARTS = {
    "First steps": _FIRST,
    "Methods and their errors": _METHODS,
    "Reference": _REFERENCE,
    "For developers": _OTHERS,
}

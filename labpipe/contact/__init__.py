"""Viscoelastic contact: indentation and impact."""

from labpipe.contact.impact import drop
from labpipe.contact.indentation import indent, indent_load
from labpipe.contact.plate import Plate

__all__ = ["Plate", "drop", "indent", "indent_load"]

"""Viscoelastic contact: indentation and impact."""

from labpipe.contact.impact import drop
from labpipe.contact.plate import Plate

__all__ = ["Plate", "drop"]

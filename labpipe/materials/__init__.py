"""Linear viscoelastic materials: Prony series, interconversion, master curves, library."""

from labpipe.materials.prony import Prony

__all__ = ["Prony"]

"""Experiments, sessions, the thesis's figures, the virtual rig, and the command line."""

from labpipe.installation import BUILD

__all__ = ["BUILD"]

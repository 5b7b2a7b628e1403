"""The experiments, the session, the thesis figures, the virtual rig, the command line."""

from labpipe import BUILD

__all__ = ["BUILD"]

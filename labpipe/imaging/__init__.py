"""Films: digital image correlation and the contact radius from interference fringes."""

from labpipe.imaging.dic import track

__all__ = ["track"]

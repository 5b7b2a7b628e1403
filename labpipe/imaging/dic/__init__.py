"""Digital image correlation: displacement of points of a film to a few thousandths of a pixel."""

from labpipe.imaging.dic._track import track

__all__ = ["track"]

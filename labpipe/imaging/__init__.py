"""Films: digital image correlation and the contact radius from interference fringes."""

from labpipe.imaging.contact_radius import contact_radius
from labpipe.imaging.dic import track
from labpipe.imaging.fringes import hertz_gap
from labpipe.imaging.gating import frames_in_windows

__all__ = ["contact_radius", "frames_in_windows", "hertz_gap", "track"]

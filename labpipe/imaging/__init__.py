"""Films: digital image correlation and the contact radius from interference fringes."""

from labpipe.imaging.dic import track
from labpipe.imaging.films import frames_in_windows, last_moving_frame
from labpipe.imaging.fringes import contact_radius, hertz_gap

__all__ = ["contact_radius", "frames_in_windows", "hertz_gap", "last_moving_frame", "track"]

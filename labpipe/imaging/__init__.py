"""Films: digital image correlation and the contact radius from interference fringes."""

from labpipe.imaging.dic import track
from labpipe.imaging.fringes import USUAL_WORK, adhesive_edge, contact_radius

__all__ = ["USUAL_WORK", "adhesive_edge", "contact_radius", "track"]

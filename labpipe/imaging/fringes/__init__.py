"""The contact radius from a film of interference fringes, or from the edge of the spot."""

from labpipe.imaging.fringes._adhesive_edge import USUAL_WORK, adhesive_edge
from labpipe.imaging.fringes._circle import fit_circle
from labpipe.imaging.fringes._contact_radius import contact_radius
from labpipe.imaging.fringes._interference import hertz_gap

__all__ = ["USUAL_WORK", "adhesive_edge", "contact_radius", "fit_circle", "hertz_gap"]

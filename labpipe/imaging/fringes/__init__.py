"""The contact radius from a film of interference fringes, or from the edge of the spot."""

from labpipe.imaging.fringes._adhesive_edge import USUAL_WORK, adhesive_edge, edge_shift
from labpipe.imaging.fringes._contact_radius import contact_radius
from labpipe.imaging.fringes._edge import fit_circle

__all__ = ["USUAL_WORK", "adhesive_edge", "contact_radius", "edge_shift", "fit_circle"]

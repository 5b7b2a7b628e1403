"""What all frames of a film have in common: optics, how they are fitted, grey levels."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from labpipe.imaging.fringes._interference import Optics
from labpipe.imaging.fringes._radial_scan import Templates, make_templates
from labpipe.imaging.fringes._ring_fit import FitSettings
from labpipe.imaging.fringes._ring_parameters import Parameter

#: A contact is at least this share of a Newton spot; smaller ones are not distinguished from
#: touching.
_LEAST_RADIUS = 0.52


@dataclass(frozen=True)
class View:
    """What all frames of a film have in common.

    Attributes
    ----------
    optics : Optics
        The interference.
    settings : FitSettings
        How frames are fitted.
    shape : (int, int)
        Rows and columns.
    black, white : float
        Grey level of darkness, below which pixels are clipped, and from which they are saturated.
    ellipse : (float, float)
        Stretch and shear of circles.
    harmonics : (float, float, float)
        See :data:`HARMONICS`.
    alternatives : tuple of tuples of Parameter
        What else may be freed where the usual fit fails.
    """

    optics: Optics
    settings: FitSettings
    shape: tuple[int, int]
    black: float
    white: float
    ellipse: tuple[float, float] = (0.0, 0.0)
    harmonics: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alternatives: tuple[tuple[Parameter, ...], ...] = ()

    def served_by(self, free: Iterable[Parameter]) -> "View":
        """Return the view in which nothing else is tried than what was free in a fit that served the film."""
        extra = tuple(p for p in free if p not in self.settings.free)
        return replace(self, alternatives=(extra,) if extra else ())

    @property
    def levels(self) -> tuple[float, float]:
        """Return the grey levels at which pixels are clipped; numbers that are no counts are not."""
        return self.black if math.isfinite(self.white) else -math.inf, self.white

    @property
    def newton_spot(self) -> float:
        """Radius (px) at half brightness of the central spot of a sphere that just touches."""
        return math.sqrt(math.pi / self.optics.phase_scale)

    @property
    def least_radius(self) -> float:
        """Radius (px) below which a contact is not told from a sphere that just touches."""
        return _LEAST_RADIUS * self.newton_spot

    @property
    def templates(self) -> Templates | None:
        """Contacts to compare profiles with."""
        settings = self.settings
        return make_templates(self.shape, self.optics, settings.fringes, settings.least_spacing)

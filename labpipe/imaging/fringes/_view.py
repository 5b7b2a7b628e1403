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
#: Residual beyond the noise, as a share of the modulation, from which a fit is not believed:
#: measured 0.03 for R 2 % wrong, 0.04 for light of low coherence; 0.1 and more for fits of
#: something else. In a film whose optics are known, 0.05 at least and twice what the frames left that tell them.
_MOST_MISFIT, _KNOWN_MISFIT = 0.1, 0.05


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
    most_misfit : float [1]
        Misfit from which a fit is not believed.
    """

    optics: Optics
    settings: FitSettings
    shape: tuple[int, int]
    black: float
    white: float
    ellipse: tuple[float, float] = (0.0, 0.0)
    harmonics: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alternatives: tuple[tuple[Parameter, ...], ...] = ()
    most_misfit: float = _MOST_MISFIT

    def known_to(self, misfit: float) -> "View":
        """Return the view of a film whose frames left such a misfit at most when its optics were found."""
        return replace(self, most_misfit=min(max(_KNOWN_MISFIT, 2.0 * misfit), _MOST_MISFIT))

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

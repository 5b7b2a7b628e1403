"""State of the optics of a film, which all its frames share: as stated at first, as calibrated later."""

from dataclasses import dataclass

from labpipe.imaging.fringes._ring_fit import FitSettings, Parameter
from labpipe.imaging.fringes._ring_model import Optics
from labpipe.imaging.fringes._templates import Templates, make_templates


@dataclass(frozen=True)
class View:
    """Optics, settings and shape of the frames of a film.

    Attributes
    ----------
    optics : Optics
        The interference.
    settings : FitSettings
        How frames are fitted.
    shape : (int, int)
        Rows and columns.
    black, white : float
        Grey level of darkness, and from which pixels are saturated.
    ellipse : (float, float)
        Stretch and shear of circles.
    alternatives : tuple of tuples of Parameter
        What else may be freed where the usual fit fails.
    """

    optics: Optics
    settings: FitSettings
    shape: tuple[int, int]
    black: float
    white: float
    ellipse: tuple[float, float] = (0.0, 0.0)
    alternatives: tuple[tuple[Parameter, ...], ...] = ()

    @property
    def templates(self) -> Templates | None:
        """Contacts to compare profiles with; None where the pixels resolve no fringes."""
        return make_templates(self.shape, self.optics, self.settings.fringes, self.settings.least_spacing)

    @property
    def least_radius(self) -> float:
        """Radius (px) below which a contact cannot be distinguished from a touch: 0.8 of the Newton spot."""
        return 0.8 * self.optics.newton_spot

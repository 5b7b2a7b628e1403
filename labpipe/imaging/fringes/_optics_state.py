"""State of the optics of a film, which all its frames share: as stated at first, as calibrated later."""

from dataclasses import dataclass

from labpipe.imaging.fringes._ring_fit import FitSettings
from labpipe.imaging.fringes._ring_model import Optics
from labpipe.imaging.fringes._templates import Templates, make_templates


@dataclass(frozen=True)
class View:
    """Optics, settings of the fits, and shape (row, column) of the frames of a film.

    ``black``, ``white``: grey level of darkness, and from which pixels are saturated. ``ellipse``: stretch and shear of
    circles.
    """

    optics: Optics
    settings: FitSettings
    shape: tuple[int, int]
    black: float
    white: float
    ellipse: tuple[float, float] = (0.0, 0.0)

    @property
    def templates(self) -> Templates | None:
        """Contacts to compare profiles with; None where the pixels resolve no fringes."""
        return make_templates(self.shape, self.optics, self.settings.fringes, self.settings.least_spacing)

    @property
    def least_radius(self) -> float:
        """Radius (px) below which a contact cannot be distinguished from a touch: 0.8 of the Newton spot."""
        return 0.8 * self.optics.newton_spot

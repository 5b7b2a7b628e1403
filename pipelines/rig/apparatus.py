"""The thesis's apparatus in numbers, as it prints them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sphere:
    """The sphere of 3/4 inch, all that falls with it, and the heights that it falls from; SI."""

    radius: float = 9.525e-3
    mass: float = 0.505
    heights: tuple[float, ...] = (1.5e-3, 5e-3, 7e-3, 10e-3)
    gravity: float = 9.81


@dataclass(frozen=True, slots=True)
class Punch:
    """The periodic punch; m. ``depth`` is the length of one tip."""

    radius: float = 2e-3
    period: float = 8e-3
    depth: float = 6e-3
    tips: int = 3

    @property
    def length(self) -> float:
        """Length of all tips together."""
        return self.tips * self.depth


@dataclass(frozen=True, slots=True)
class Views:
    """The scales of the cameras (table D.1): px that the holder's 30 mm and a millimetre under the disc span."""

    holder: float = 386.0
    under: float = 461.0

    @property
    def front_pixel(self) -> float:
        """Length of a pixel of the front view in m."""
        return 30e-3 / self.holder

    @property
    def under_pixel(self) -> float:
        """Length of a pixel under the disc in m."""
        return 1e-3 / self.under


SPHERE, PUNCH, VIEWS = Sphere(), Punch(), Views()

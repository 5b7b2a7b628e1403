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
    """The periodic punch and its protocol; SI. ``depth`` is the length of one tip.

    It is pressed in at ``speed`` and rests for ``hold``; ``tau_0`` is the time of eq. (2.38) by which frequencies are
    scaled, ``forces`` the depth, the peak and the plateau of each relaxation of section 2.3.2.
    """

    radius: float = 2e-3
    period: float = 8e-3
    depth: float = 6e-3
    tips: int = 3
    speed: float = 1e-3
    hold: float = 600.0
    tau_0: float = 1.56e-10
    forces: tuple[tuple[float, float, float], ...] = ((0.1e-3, 23.1, 12.2), (0.2e-3, 44.7, 31.0), (0.3e-3, 80.6, 55.5))

    @property
    def length(self) -> float:
        """Length of all tips together."""
        return self.tips * self.depth


@dataclass(frozen=True, slots=True)
class Views:
    """The scales of the cameras (table D.1): px that the holder's 30 mm and a millimetre under the disc span, m/px."""

    holder: float = 386.0
    under: float = 461.0
    front_pixel: float = 30e-3 / 386.0
    under_pixel: float = 1e-3 / 461.0


SPHERE, PUNCH, VIEWS = Sphere(), Punch(), Views()

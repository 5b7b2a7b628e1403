"""Contacts found in the frames of a film."""

from dataclasses import dataclass, field

from labpipe.arrays import Flags
from labpipe.imaging.fringes._calibration import Calibration
from labpipe.imaging.fringes._edge import Edge
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import RingFit


@dataclass(frozen=True)
class Blank:
    """A frame without usable fringes: round spots in it, and its brightness (grey levels) when it is even."""

    edges: tuple[Edge, ...] = ()
    level: float | None = None


@dataclass
class FilmResult:
    """Contacts of a film, by frame, with the optics they were fitted with.

    ``resting`` (frame,): frames that look like the contacts before and after and were not read. ``fits`` of fringes,
    and ``edges`` where there are none. ``filled``: the contact reaches beyond the frame on all sides. ``undecided``:
    bound of the radius (px) where the sphere touches or hovers, which counts as no contact. ``blanks``: spots in frames
    without fringes. ``motion``: u of the radius (px) from its acceleration within the exposure. ``has_fringes``: False
    when the wavelength is unknown or pixels are too coarse. ``note`` on pixels that were interpolated.
    """

    view: View
    resting: Flags
    fits: dict[int, RingFit] = field(default_factory=dict)
    edges: dict[int, Edge] = field(default_factory=dict)
    filled: set[int] = field(default_factory=set)
    undecided: dict[int, float] = field(default_factory=dict)
    blanks: dict[int, Blank] = field(default_factory=dict)
    motion: dict[int, float] = field(default_factory=dict)
    calibration: Calibration = field(default_factory=Calibration)
    has_fringes: bool = True
    damaged: set[int] = field(default_factory=set)
    note: str = ""
    work: dict[str, int] = field(default_factory=dict)

    def circle(self, index: int) -> tuple[float, float, float] | None:
        """Centre and radius (px) of the contact in a frame, if there is one."""
        if index in self.fits:
            return (*self.fits[index].centre, self.fits[index].radius)
        edge = self.edges.get(index)
        return None if edge is None else (edge.x, edge.y, edge.half_radius)

"""Frames without usable fringes: the edge of a contact, or a contact that fills the view."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from labpipe.arrays import Flags
from labpipe.imaging.films import FilmReader, StuckPixels
from labpipe.imaging.fringes._edge import Edge
from labpipe.imaging.fringes._looks import Looks, has_pattern
from labpipe.imaging.fringes._radial_scan import edge_width
from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._spots import Spot, reduce_frame
from labpipe.imaging.fringes._touch import told_radius
from labpipe.imaging.fringes._trials import Calibration
from labpipe.imaging.fringes._view import View

#: A spot without fringes next to a contact has an edge softer than this share of the radius at
#: most; one alone must be as sharp as this many widths of the first bright ring (Hertz's gap
#: makes it 0.4; were it softer for motion, a contact would be beside it), and what a lens makes of a
#: step: standard deviations between a quarter and three quarters of a bell.
_SOFT_BESIDE, _SOFT_ALONE, _SOFT_BY_BLUR = 0.4, 0.75, 1.35
#: Distance of its centre from that of the contact beside it, as a share of the radius.
_SAME_CENTRE = 0.3
#: Least radius, in Newton spots, of a spot without fringes: touching alone shows a smaller one.
LEAST_SPOT = 1.5
#: An even frame is inside the contact when it is as bright to this share of the modulation.
_SAME_LIGHT = 0.2
#: Rounds in which an edge confirms those in the frames beside it.
_ROUNDS = 4


@dataclass(frozen=True)
class Blank:
    """A frame without usable fringes.

    Attributes
    ----------
    edges : tuple of Edge
        Round spots in it.
    level : float or None [grey levels]
        Its brightness when it is even.
    by_sphere : float or None [1]
        Share of the squares that a sphere leaves which touches or hovers, where that is what it shows.
    """

    edges: tuple[Edge, ...] = ()
    level: float | None = None
    by_sphere: float | None = None


@dataclass
class FilmResult:
    """What was found in a film.

    Attributes
    ----------
    view : View
        Optics as used.
    fits, edges : dict
        By frame: fits of the fringes, and edges where there are none.
    filled : set
        Frames in which the contact reaches beyond the frame on all sides.
    blanks : dict
        By frame: what else was seen where no fringes were.
    resting : bool array (frame,)
        Frames that look like the contacts before and after and were not read.
    calibration : Calibration
        The optics as calibrated from the film.
    log_scale : float
        Logarithm of the phase scale used relative to that of R, wavelength and pixel size.
    has_fringes : bool
        False when the wavelength is unknown, pixels are too coarse, or fringes fade as in white light.
    is_phase_given : bool
        Whether the caller knows if contacts are dark or bright.
    work : dict
        Counts.
    damaged : set
        Frames that could not be used.
    combed : set
        Those of them whose odd and even rows show two instants.
    repeats_rows : bool
        Every second row of the film repeats its neighbour or is the mean of both.
    stuck : StuckPixels
        Pixels that do not follow the scene.
    reflecting : int
        Pixels that a reflection clips which stands still.
    lost_rows : dict of int
        By frame, rows that repeat the row before and are interpolated.
    patterned : int
        Frames filled by a pattern which no contact, nor a sphere, explains, where no fringes explain any.
    scales : dict of (float, float)
        By frame, for the largest frames of each contact, the logarithm of the phase scale by that frame
        alone over that of the film, and its standard uncertainty.
    """

    view: View
    resting: Flags
    fits: dict[int, RingFit] = field(default_factory=dict)
    edges: dict[int, Edge] = field(default_factory=dict)
    filled: set[int] = field(default_factory=set)
    blanks: dict[int, Blank] = field(default_factory=dict)
    calibration: Calibration = field(default_factory=Calibration)
    log_scale: float = 0.0
    has_fringes: bool = True
    is_phase_given: bool = False
    work: dict[str, int] = field(default_factory=dict)
    damaged: set[int] = field(default_factory=set)
    combed: set[int] = field(default_factory=set)
    repeats_rows: bool = False
    stuck: StuckPixels = field(default_factory=StuckPixels)
    reflecting: int = 0
    lost_rows: dict[int, int] = field(default_factory=dict)
    patterned: int = 0
    scales: dict[int, tuple[float, float]] = field(default_factory=dict)

    @property
    def least_radius(self) -> float:
        """Radius (px) below which a contact is not told from a touch, in the light and noise of this film."""
        if not self.has_fringes:
            return LEAST_SPOT * self.view.newton_spot
        shares = [blank.by_sphere for blank in self.blanks.values() if blank.by_sphere is not None]
        told = told_radius(float(np.median(shares))) if shares else 0.0
        return max(self.view.least_radius, told * self.view.newton_spot)

    def leave_out(self, frames: Iterable[int]) -> None:
        """Count frames as damaged, whatever was found in them."""
        for index in frames:
            self.damaged.add(index)
            for found in (self.fits, self.edges, self.blanks):
                found.pop(index, None)


def look_without_fringes(looks: Looks, view: View) -> Blank:
    """Find the round spots of a frame, or its brightness when it is even.

    Parameters
    ----------
    looks : Looks
        The frame.
    view : View
        Optics; its phase tells whether contacts are dark or bright.
    """
    if not looks.have_structure:
        return Blank(level=float(np.median(reduce_frame(looks.frame)[0])))
    by_sphere = looks.left_by_sphere(view.optics)
    if by_sphere is not None:
        return Blank(by_sphere=by_sphere)
    return Blank(_edges_of(looks.spots, looks, view) or _edges_of(looks.centres, looks, view))


def _edges_of(spots: Iterable[Spot], looks: Looks, view: View) -> tuple[Edge, ...]:
    """Edges of the spots that are larger than that of a sphere which just touches."""
    edges = looks.edges((spot for spot in spots if spot.radius >= view.newton_spot), view.black)
    return tuple(edge for edge in edges if edge.half_radius >= LEAST_SPOT * view.newton_spot)


def choose_edges(result: FilmResult) -> None:
    """Keep the edges that are contacts: sharp ones, and soft ones beside known contacts."""
    is_dark = _is_dark(result)
    for _ in range(_ROUNDS):
        found = {
            index: edge
            for index, blank in result.blanks.items()
            if index not in result.fits and index not in result.edges
            for edge in blank.edges[::-1]
            if (edge.inside < edge.outside) == is_dark and _is_contact(edge, index, result)
        }
        if not found:
            return
        result.edges |= found


def _is_dark(result: FilmResult) -> bool:
    """Tell whether contacts are dark: as the fits show, or else as most sharp edges do."""
    is_dark = math.cos(result.view.optics.phase) < 0.0
    if result.fits:
        modulations = [fit.parameters[Parameter.MODULATION] for fit in result.fits.values()]
        return is_dark == (float(np.median(modulations)) > 0.0)
    if result.is_phase_given:
        return is_dark
    signs = [
        1 if edge.inside < edge.outside else -1
        for blank in result.blanks.values()
        for edge in blank.edges
        if _is_sharp(edge, result.view)
    ]
    return sum(signs) >= 0


def _is_sharp(edge: Edge, view: View) -> bool:
    """Tell whether a spot's edge is as sharp as a contact's, seen through the lens of the film."""
    sharp = max(_SOFT_ALONE * edge_width(edge.half_radius, view.optics), 2.0)
    return edge.softness <= math.hypot(sharp, _SOFT_BY_BLUR * view.optics.blur)


def _is_contact(edge: Edge, index: int, result: FilmResult) -> bool:
    """Decide whether a round spot without fringes is a contact."""
    if _is_sharp(edge, result.view):
        return True
    for other in (index - 1, index + 1):
        centre = _centre(result, other)
        if centre is not None:
            away = math.hypot(edge.x - centre[0], edge.y - centre[1])
            is_near = away < _SAME_CENTRE * edge.half_radius
            return is_near and edge.softness <= _SOFT_BESIDE * edge.half_radius
    return False


def _centre(result: FilmResult, index: int) -> tuple[float, float] | None:
    """Centre of the contact in a frame, if there is one."""
    if index in result.fits:
        p = result.fits[index].parameters
        return float(p[Parameter.X]), float(p[Parameter.Y])
    if index in result.edges:
        return result.edges[index].x, result.edges[index].y
    return None


def find_filled(result: FilmResult) -> None:
    """Find the frames that a contact covers wholly, from the contacts before and after.

    Such a frame is even and as bright as the contact, and follows on (or is followed by) a
    contact.
    """
    if not result.fits:
        return
    level, depth = _light_of_contacts(result.fits, result.view)
    for step in (1, -1):
        for index in sorted(result.blanks, reverse=step < 0):
            brightness = result.blanks[index].level
            beside = index - step
            is_beside = beside in result.filled or _centre(result, beside) is not None
            if brightness is None or not is_beside or index in result.fits:
                continue
            if abs(brightness - level) < _SAME_LIGHT * depth:
                result.filled.add(index)


def count_patterned(reader: FilmReader, result: FilmResult) -> None:
    """Count the frames whose pattern may hide a contact, in a film in which fringes explain none."""
    if result.has_fringes and not (result.fits or result.filled):
        told = (index for index, blank in result.blanks.items() if blank == Blank() and index not in result.edges)
        result.patterned = sum(has_pattern(Looks(reader.whole(index))) for index in told)


def _light_of_contacts(fits: dict[int, RingFit], view: View) -> tuple[float, float]:
    """Brightness in the contacts, and the modulation of the fringes."""
    light = [fit.parameters[Parameter.GAIN] for fit in fits.values()]
    modulation = float(np.median([fit.parameters[Parameter.MODULATION] for fit in fits.values()]))
    inside = float(np.median(light)) + modulation * math.cos(view.optics.phase)
    return inside, abs(modulation)

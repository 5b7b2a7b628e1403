"""Dark (or bright) discs without usable fringes, which are contacts only where they grow and shrink as one."""

import math

import numpy as np

from labpipe.imaging.fringes._edge import Edge, find_edge
from labpipe.imaging.fringes._film_result import Blank, FilmResult
from labpipe.imaging.fringes._frame_features import FrameFeatures
from labpipe.imaging.fringes._hough_centre import reduce_frame
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import Parameter
from labpipe.imaging.fringes._ring_model import edge_width

#: Share of its largest radius by which a disc must grow or shrink to be a contact: blur and noise change the edge of
#: one that stays as it is by a hundredth.
_GROWTH = 0.1
#: Distance of the centre of a disc from that of the contact in the frame before or after, as a share of the radius.
_SAME_CENTRE = 0.3


def look_without_fringes(features: FrameFeatures, view: View) -> Blank:
    """Find the round spots of a frame, or its brightness when it is even."""
    frame = features.frame
    if not features.has_structure:
        return Blank(level=float(np.median(reduce_frame(frame)[0])))
    # a sphere that touches without load shows a spot of its own
    least = view.optics.newton_spot
    found = (find_edge(frame, s.x, s.y, s.radius, view.black) for s in features.centres if s.radius >= least)
    return Blank(tuple(edge for edge in found if edge is not None and edge.half_radius >= 1.5 * least))


def choose_edges(result: FilmResult, *, any_disc: bool) -> None:
    """Keep the edges of contacts: discs in frames next to known contacts, and discs that grow or shrink.

    Every sharp disc counts with ``any_disc``. Discs must be dark or bright as the contacts of the film are,
    or as its phase says.
    """
    is_dark = math.cos(result.view.optics.phase) < 0.0
    if result.fits:
        is_dark = is_dark == (np.median([fit.value(Parameter.MODULATION) for fit in result.fits.values()]) > 0.0)
    sharp = {
        index: edge
        for index, blank in result.blanks.items()
        if index not in result.fits
        for edge in blank.edges[::-1]
        # as sharp as that of a contact at rest, for which Hertz's gap makes it 0.4
        if (edge.inside < edge.outside) == is_dark
        and edge.softness <= max(0.75 * edge_width(edge.half_radius, result.view.optics), 2.0)
    }
    if any_disc:
        result.edges |= sharp
    elif not result.fits:
        for run in runs_of(sorted(sharp)):
            x, y, radii = np.array([(sharp[i].x, sharp[i].y, sharp[i].half_radius) for i in run]).T
            is_steady = bool((np.hypot(x - np.median(x), y - np.median(y)) < _SAME_CENTRE * radii).all())
            if len(run) > 1 and is_steady and np.ptp(radii) > _GROWTH * radii.max():
                result.edges |= {index: sharp[index] for index in run}
    for _ in range(4):  # an edge confirms those in the frames before and after it
        found = {
            index: edge
            for index, blank in result.blanks.items()
            if index not in result.fits and index not in result.edges
            for edge in blank.edges[::-1]
            if (edge.inside < edge.outside) == is_dark and _continues(edge, index, result)
        }
        if not found:
            return
        result.edges |= found


def runs_of(frames: list[int]) -> list[list[int]]:
    """Group frames that follow each other."""
    if not frames:
        return []
    cuts = np.flatnonzero(np.diff(frames) > 1) + 1
    return [run.tolist() for run in np.split(np.array(frames), cuts)]


def _continues(edge: Edge, index: int, result: FilmResult) -> bool:
    """Tell whether a spot lies where the contact of the frame before or after does, and is about as large."""
    for other in (index - 1, index + 1):
        circle = result.circle(other)
        if circle is not None:
            away = math.hypot(edge.x - circle[0], edge.y - circle[1])
            is_soft = edge.softness > 0.4 * edge.half_radius
            return away < _SAME_CENTRE * edge.half_radius and not is_soft and 0.2 < edge.half_radius / circle[2] < 5.0
    return False


def find_filled(result: FilmResult) -> None:
    """Find the frames that a contact covers wholly: even, as bright as the contact, next to one in time."""
    if not result.fits:
        return
    light = float(np.median([fit.value(Parameter.GAIN) for fit in result.fits.values()]))
    modulation = float(np.median([fit.value(Parameter.MODULATION) for fit in result.fits.values()]))
    level = light + modulation * math.cos(result.view.optics.phase)
    for step in (1, -1):
        for index in sorted(result.blanks, reverse=step < 0):
            brightness, before = result.blanks[index].level, index - step
            is_next = before in result.filled or result.circle(before) is not None
            is_free = is_next and index not in result.fits
            if brightness is not None and is_free and abs(brightness - level) < 0.2 * abs(modulation):
                result.filled.add(index)

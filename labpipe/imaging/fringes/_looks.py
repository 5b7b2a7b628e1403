"""What one frame shows, looked for once: the search for a contact and the look at a blank frame ask alike."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes._centre_votes import find_centres
from labpipe.imaging.fringes._edge import Edge, find_edge
from labpipe.imaging.fringes._interference import Optics
from labpipe.imaging.fringes._radial_scan import radial_profile
from labpipe.imaging.fringes._spots import Spot, find_spots, reduce_frame
from labpipe.imaging.fringes._touch import left_by_only_sphere

#: Spots about which the rings of a sphere are looked for.
_MOST_SPOTS = 4
#: Least ratio of the structure in a reduced frame to its noise.
_LEAST_STRUCTURE = 8.0
#: A pattern lies between these scales (px); blocks of this side show one that scatter by so many times what noise
#: leaves there, and it fills a frame from this share of them on. It is one of rings where these hold such a share.
_FINE, _COARSE, _CELL, _BEYOND_NOISE, _FILLED, _BY_RINGS = 1.5, 6.0, 16, 4.0, 0.25, 0.25
#: Noise is taken from blocks of this side (px), of about so many pixels, at this percentile.
_BLOCK, _NOISE_PIXELS, _QUIET = 12, 80_000, 3.0


@dataclass(frozen=True)
class Looks:
    """A frame (row, column) of grey levels that does not change, and what it shows."""

    frame: NDArray[np.generic]
    _edges: dict[tuple[Spot, float], Edge | None] = field(default_factory=dict)
    _spheres: dict[Optics, float | None] = field(default_factory=dict)

    @cached_property
    def have_structure(self) -> bool:
        """Whether there is more in it than noise."""
        return has_structure(self.frame)

    @cached_property
    def spots(self) -> Sequence[Spot]:
        """Circles through the outlines of dark and bright spots."""
        return find_spots(self.frame)

    @cached_property
    def centres(self) -> Sequence[Spot]:
        """Centres of rings."""
        return list(find_centres(self.frame))

    def edge(self, spot: Spot, black: float) -> Edge | None:
        """Return the edge of a spot; ``black`` is the grey level of darkness."""
        if (spot, black) not in self._edges:
            self._edges[spot, black] = find_edge(self.frame, spot.x, spot.y, spot.radius, black)
        return self._edges[spot, black]

    def edges(self, spots: Iterable[Spot], black: float) -> Iterator[Edge]:
        """Yield the edges of those spots that have one."""
        return (edge for edge in (self.edge(spot, black) for spot in spots) if edge is not None)

    def left_by_sphere(self, optics: Optics) -> float | None:
        """Share of the squares that a sphere leaves which touches or hovers; None where the rings are not its."""
        if optics not in self._spheres:
            spots = self.spots[:_MOST_SPOTS]
            shares = (left_by_only_sphere(self.frame, spot.x, spot.y, optics) for spot in spots)
            self._spheres[optics] = next((share for share in shares if share is not None), None)
        return self._spheres[optics]

    def show_only_sphere(self, optics: Optics) -> bool:
        """Tell whether the rings are those of a sphere that touches or hovers, so that there is no contact."""
        return self.left_by_sphere(optics) is not None


def has_pattern(looks: Looks) -> bool:
    """Tell whether fringes, or another pattern as fine, fill a frame: a gradient, a shadow, dust and rings do not."""
    grey = looks.frame.astype(np.float32)
    fine, coarse = (cv2.GaussianBlur(grey, (0, 0), scale) for scale in (_FINE, _COARSE))
    band = fine - coarse
    rows, columns = (size // _CELL for size in grey.shape)
    if not rows or not columns:
        return False
    blocks = band[: rows * _CELL, : columns * _CELL].reshape(rows, _CELL, columns, _CELL)
    # white noise under a bell leaves 1/(2 √π σ) of it
    noise = max(_quiet_noise(looks.frame), 0.3) / (2.0 * math.sqrt(math.pi) * _FINE)
    if float(np.mean(blocks.std(axis=(1, 3)) > _BEYOND_NOISE * noise)) < _FILLED:
        return False
    reach = math.ceil(math.hypot(*grey.shape))
    profiles = (
        radial_profile(band, spot.x, spot.y, 1.0, reach) for spot in (*looks.spots[:_MOST_SPOTS], *looks.centres)
    )
    return all(
        float((counts * mean**2).sum() / counts.sum()) < _BY_RINGS * float(band.var()) for mean, counts in profiles
    )


def has_structure(frame: NDArray[np.generic]) -> bool:
    """Tell whether there is more in a frame than noise."""
    small, factor = reduce_frame(frame)
    noise = _quiet_noise(frame)
    smooth = cv2.GaussianBlur(small, (3, 3), 0.8)
    low, high = np.percentile(smooth, (0.1, 99.9))
    return float(high - low) > _LEAST_STRUCTURE * max(noise, 0.3) / (2.0 * factor)


def _quiet_noise(frame: NDArray[np.generic]) -> float:
    """Noise of a pixel (grey levels) where the frame is quietest, so that fringes do not count."""
    side = min(_BLOCK, *frame.shape)
    rows, columns = (size // side * side for size in frame.shape)
    bands = frame[:rows, :columns].reshape(-1, side, columns)
    bands = bands[:: max(1, bands.size // _NOISE_PIXELS)]
    steps = np.abs(np.diff(bands.astype(np.float32), axis=1))
    blocks = steps.reshape(len(bands), side - 1, -1, side).swapaxes(1, 2).reshape(-1, side**2 - side)
    return float(np.percentile(np.median(blocks, axis=1), _QUIET)) / 0.954

"""Lengths in a picture or a frame: two clicks, refined to the feature under each, with uncertainty.

Across each end, profiles along the line between the clicks are taken next to each other. Each
is fitted by an edge (an error function) or a graduation (a Gaussian line), whichever leaves less; a
straight line through the places found gives the place on the line of the clicks, its scatter the
standard uncertainty, and its slope by how much the line was drawn askew.
"""

from __future__ import annotations

import io
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe.errors import InputError
from pipelines.app._pictures import PHOTOGRAPHS, photograph

if TYPE_CHECKING:
    from numpy.typing import NDArray

_LEAST_SIGNAL = 5.0
"""Step or line over the noise that is left, below which nothing is found."""


@dataclass(frozen=True, slots=True)
class Picture:
    """Grey levels (row, column) of a picture or frame, and of how many frames."""

    grey: NDArray[np.float64]
    frames: int

    def png(self) -> bytes:
        """Return it as an 8-bit PNG."""
        from PIL import Image

        stream = io.BytesIO()
        Image.fromarray(np.clip(np.round(self.grey), 0, 255).astype(np.uint8)).save(stream, "png", compress_level=1)
        return stream.getvalue()


def picture(path: Path, index: int = 0) -> Picture:
    """Read a picture, or one frame of a film, as grey levels from 0 (black) to 255 (white).

    Raises
    ------
    LabpipeError
        It is neither, the frame is not there, or is damaged.
    """
    if path.is_file() and path.suffix.lower() in PHOTOGRAPHS:
        return Picture(np.asarray(photograph(path).convert("L"), dtype=np.float64), 1)
    import instruments

    with warnings.catch_warnings(action="ignore"):  # told where the film is inspected or processed
        film: Any = instruments.read(path)
    if not hasattr(film, "levels"):
        raise InputError(f"{path.name} holds readings, no pictures")
    if not 0 <= index < len(film) or not film.valid[index]:
        raise InputError(f"{path.name} has no frame {index} that can be read")
    black, white = film.levels
    grey = (np.asarray(film[index], dtype=np.float64) - black) * (255.0 / max(white - black, 1e-9))
    return Picture(grey, len(film))


@dataclass(frozen=True, slots=True)
class Length:
    """A length between two places of a picture.

    ``points`` are these, x to the right and y down [px], the centre of the first pixel at (0, 0). ``value`` and ``u``
    are in px; ``found`` is the feature at either end, ``"edge"`` or ``"graduation"``.
    """

    points: tuple[tuple[float, float], tuple[float, float]]
    value: float
    u: float
    found: tuple[str, str]


def length(
    grey: NDArray[np.float64], first: tuple[float, float], second: tuple[float, float], reach: int = 12
) -> Length:
    """Refine two clicks (x, y) [px] on grey levels (row, column) to the edges or graduations under them.

    Along the line ``reach`` px on either side of a click are looked at, across it half as many.

    The length is measured across the graduations: a line drawn askew by an angle ε is longer by 1/cos ε, which their
    slope tells. An InputError says that clicks are too near to each other or to the border, or that nothing is found
    under one.
    """
    start, stop = np.asarray(first, float), np.asarray(second, float)
    distance = float(np.hypot(*(stop - start)))
    if not distance >= 4 * reach:
        raise InputError(f"the two places are {distance:.0f} px apart; choose them at least {4 * reach} px apart")
    along = (stop - start) / distance
    ends = [_refined(grey, place, along, reach) for place in (start, stop)]
    places = [place + end.shift * along for place, end in zip((start, stop), ends, strict=True)]
    askew = math.atan((ends[0].slope + ends[1].slope) / 2)
    value = float(np.hypot(*(places[1] - places[0]))) * math.cos(askew)
    (x1, y1), (x2, y2) = (tuple(map(float, place)) for place in places)
    return Length(((x1, y1), (x2, y2)), value, math.hypot(ends[0].u, ends[1].u), (ends[0].kind, ends[1].kind))


@dataclass(frozen=True, slots=True)
class _End:
    shift: float
    slope: float
    u: float
    kind: str


def _refined(grey: NDArray[np.float64], place: NDArray[np.float64], along: NDArray[np.float64], reach: int) -> _End:
    """Find the feature near a place, along a direction."""
    from scipy.ndimage import map_coordinates

    across = np.array([-along[1], along[0]])
    x, rows = np.arange(-reach, reach + 1.0), np.arange(-(reach // 2), reach // 2 + 1.0)
    at = place + x[None, :, None] * along + rows[:, None, None] * across
    inside = (at >= 0) & (at <= np.array(grey.shape[::-1]) - 1.0)
    if not inside.all():
        raise InputError(f"({place[0]:.0f}, {place[1]:.0f}) is too near to the border of the picture")
    # cubic splines, which shift no edge, of the surroundings alone
    low = np.maximum(np.floor(at.min(axis=(0, 1))).astype(int) - 8, 0)
    high = np.minimum(np.ceil(at.max(axis=(0, 1))).astype(int) + 9, np.array(grey.shape[::-1]))
    places = np.moveaxis(at - low, -1, 0)[::-1]
    profiles = map_coordinates(grey[low[1] : high[1], low[0] : high[0]], places, order=3)
    # first guesses: the steepest place, and the most prominent one, near the click
    mean, window = profiles.mean(axis=0), np.exp(-0.5 * (x / (0.5 * reach)) ** 2)
    steep, apart = np.gradient(mean), mean - np.median(mean)
    edge, line = (int(np.argmax(np.abs(seen) * window)) for seen in (steep, apart))
    start = {
        "edge": np.array([float(np.ptp(mean)) / 2 * np.sign(steep[edge]), x[edge], 1.5, float(mean.mean())]),
        "graduation": np.array([apart[line], x[line], 1.5, float(np.median(mean))]),
    }
    fits = {kind: _fitted(x, mean, kind, start[kind]) for kind in start}
    kind = min(fits, key=lambda name: fits[name][1])
    model, noise = fits[kind]
    each = np.array([_fitted(x, profile, kind, model)[0] for profile in profiles])
    near = 3.0 * abs(model[2]) + 2.0
    kept = (np.abs(each[:, 1] - model[1]) < near) & (np.sign(each[:, 0]) == np.sign(model[0]))
    if abs(model[0]) < _LEAST_SIGNAL * noise or kept.sum() <= rows.size // 3 or abs(model[1]) > reach - 1:
        raise InputError(f"nothing is found at ({place[0]:.0f}, {place[1]:.0f}): click on an edge or a graduation")
    shifts = each[kept, 1]
    slope, middle = np.polyfit(rows[kept], shifts, 1)
    rest = shifts - (slope * rows[kept] + middle)
    # Interpolation between pixels makes neighbouring profiles alike where the line is oblique.
    oblique = 1.0 + abs(along[0] * along[1])
    u = oblique * float(np.sqrt(np.sum(rest**2) / (kept.sum() - 2) / kept.sum()))
    return _End(float(middle), float(slope), u, kind)


def _fitted(
    x: NDArray[np.float64], profile: NDArray[np.float64], kind: str, start: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Fit a profile; return height, place, width and base, and the noise that is left.

    Only the neighbourhood of the first guess counts: graduations stand side by side.
    """
    from scipy.optimize import least_squares
    from scipy.special import erf

    near = np.abs(x - start[1]) <= max(5.0, 4.0 * abs(start[2]))
    x, profile = x[near], profile[near]

    def shape(p: NDArray[np.float64]) -> NDArray[np.float64]:
        t = (x - p[1]) / (abs(p[2]) + 1e-3)
        return np.asarray(erf(t / math.sqrt(2)) if kind == "edge" else np.exp(-0.5 * t**2))

    done = least_squares(lambda p: p[3] + p[0] * shape(p) - profile, start, max_nfev=60)
    return done.x, float(np.sqrt(np.sum(done.fun**2) / max(len(x) - 4, 1)))

"""Compare the radial profile of a frame with Hertz contacts of all radii."""

import math
from bisect import bisect_left
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from labpipe.arrays import Floats, Integers
from labpipe.imaging.fringes._interference import Optics, distance_at_phase, phase_slope, ring_limits

#: Rings per half fringe next to the contact: enough to follow it, few enough to be quick.
_RINGS_PER_EDGE = 6.0
#: Samples of the model in a ring.
_SAMPLES = 2
#: Rings are not narrower than this (px).
_LEAST_WIDTH = 0.5
#: Fringes count as resolved when the phase changes by this within those that are used (rad).
_LEAST_PHASE = 0.9 * math.pi
#: Radii of the templates are so many rings apart, a third of the first bright ring, but not farther
#: than this share of the finest fringe.
_RINGS_PER_RADIUS, _SHARE_OF_FRINGE = 2, 0.4
#: Rows read for a profile: every so many that about this many pixels are summed.
_PROFILE_PIXELS = 150_000
#: Travels of the radius in the exposure that are tried, in widths of the first bright ring.
_TRAVELS = (0.0, 1.5, 4.0)
#: Share of the rings of a template that must lie in the frame.
_LEAST_SEEN = 0.75
#: The contact of the other brightness is a match too from this share of the better score.
_NEARLY = 0.8
#: Share of the squares below which the nearest edge of some is sought exactly, and how: among these around it in place
#: and softness, in steps that are halved so many times.
_NEAR_EDGE, _AROUND, _ZOOMS = (
    0.1,
    np.stack(np.meshgrid((-1.0, -0.5, 0.0, 0.5, 1.0), (-1.0, 0.0, 1.0)), -1).reshape(-1, 2),
    6,
)
#: Variance below which a window counts as even.
_TINY = 1e-6


@dataclass(frozen=True)
class Templates:
    """Interference terms of contacts of many radii, each over a window of rings.

    Attributes
    ----------
    width : float [px]
        Width of a ring.
    bins : int
        Rings of a profile.
    radii : array (template,) [px]
    first, length : integer arrays (template,)
        First ring of the window, and number of rings in it.
    travels : array (travel,) [px]
        Change of the radius in the exposure.
    values : float32 array (travel, template, ring)
        Anything beyond the length.
    """

    width: float
    bins: int
    radii: Floats
    first: Integers
    length: Integers
    travels: Floats
    values: NDArray[np.float32]


@dataclass(frozen=True)
class Match:
    """A contact that a profile resembles.

    Attributes
    ----------
    radius, travel : float [px]
    score : float [1]
        Share of the profile's variance, a linear trend taken off, that the fringes explain.
    gain, modulation : float [grey levels]
        Mean light, and the amplitude of the interference (negative: a bright contact).
    """

    radius: float
    travel: float
    score: float
    gain: float
    modulation: float


def has_resolved_fringes(radius: float, optics: Optics, least_spacing: float) -> bool:
    """Tell whether the pixels resolve the first fringe around a contact."""
    steepest = 2.0 * math.pi / least_spacing
    outer = distance_at_phase(_LEAST_PHASE, radius, optics)
    return phase_slope(outer, radius, optics) <= steepest


def edge_width(radius: float, optics: Optics) -> float:
    """Distance (px) from the edge of a contact to the first ring of opposite brightness."""
    return distance_at_phase(math.pi, radius, optics) - radius


@lru_cache(maxsize=2)
def make_templates(shape: tuple[int, int], optics: Optics, fringes: float, least_spacing: float) -> Templates | None:
    """Tabulate the contacts that may be seen in a frame, or None when no fringes are resolved.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of a frame.
    optics : Optics
        The interference.
    fringes, least_spacing : float
        As in :class:`.FitSettings`.
    """
    from labpipe.imaging.fringes._table_kernel import fill_templates, smear_templates

    reach = math.hypot(*shape)
    edge = edge_width(0.5 * reach, optics)
    width = max(_LEAST_WIDTH, 0.5 * math.floor(2.0 * edge / _RINGS_PER_EDGE))
    middle = ring_limits(0.5 * reach, optics, fringes, least_spacing)[1]
    finest = 2.0 * math.pi / phase_slope(middle, 0.5 * reach, optics)
    step = _RINGS_PER_RADIUS if _RINGS_PER_RADIUS * width <= _SHARE_OF_FRINGE * finest else 1
    radii = width * np.arange(math.ceil(2.0 / width), reach / width, step)
    # fringes around larger contacts are finer
    radii = radii[: bisect_left(radii, True, key=lambda a: not has_resolved_fringes(a, optics, least_spacing))]
    if not len(radii):
        return None
    inner, outer = np.array([ring_limits(a, optics, fringes, least_spacing) for a in radii.tolist()]).T
    first = np.floor(inner / width).astype(np.int64)
    length = np.floor(outer / width).astype(np.int64) - first
    travels = edge * np.array(_TRAVELS)
    passed = length + math.ceil(0.5 * travels[-1] / width) + 1
    sharp = fill_templates(radii, first, passed, width, optics.phase_scale, optics.phase, _SAMPLES)
    inside = math.cos(optics.phase)
    smeared = (smear_templates(sharp, radii, first, length, travel, inside) for travel in travels[1:].tolist())
    values = np.stack([sharp, *smeared])[:, :, : length.max()]
    return Templates(width, int((first + length).max()), radii, first, length, travels, values)


def radial_profile(
    frame: NDArray[np.generic], x: float, y: float, width: float, bins: int, oblique: tuple[float, float] = (0.0, 0.0)
) -> tuple[Floats, Floats]:
    """Mean grey level and number of pixels in rings around a point.

    Parameters
    ----------
    frame : array (row, column)
        Grey levels.
    x, y : float [px]
        The point; it may lie outside the frame.
    width : float [px]
        Width of a ring.
    bins : int
        Number of rings.
    oblique : (float, float), optional
        Stretch and shear that make circles of the rings, where they are ellipses.
    """
    from labpipe.imaging.fringes._table_kernel import radial_sums

    step = max(1, math.floor(math.sqrt(frame.size / _PROFILE_PIXELS)))
    rows = np.ascontiguousarray(frame[::step], np.float32)
    sums, counts = radial_sums(rows, x, y, float(step), width, bins, *oblique)
    return sums / np.maximum(counts, 1.0), counts


def best_matches(profile: Floats, counts: Floats, templates: Templates) -> list[Match]:
    """Dark and bright contact that explain most of a profile, the better one first.

    Parameters
    ----------
    profile, counts : arrays (ring,)
        From :func:`radial_profile`.
    templates : Templates
        Contacts to compare with.
    """
    from labpipe.imaging.fringes._table_kernel import compare_templates

    laid = templates.values, templates.first, templates.length
    share, modulation, gain = compare_templates(profile, counts, *laid, _LEAST_SEEN)
    matches = []
    for polarity in (1.0, -1.0):
        signed = np.where(polarity * modulation > 0.0, share, 0.0)
        travel, row = place = np.unravel_index(int(signed.argmax()), share.shape)
        size, motion = float(templates.radii[row]), float(templates.travels[travel])
        matches.append(Match(size, motion, float(signed[place]), float(gain[place]), float(modulation[place])))
    matches.sort(key=lambda match: -match.score)
    return [match for match in matches if match.score >= _NEARLY * matches[0].score]


def template_of(match: Match, templates: Templates) -> tuple[Floats, int]:
    """Interference term of a match, and the ring it starts with."""
    row = int(np.argmin(np.abs(templates.radii - match.radius)))
    travel = int(np.argmin(np.abs(templates.travels - match.travel)))
    values = templates.values[travel, row, : templates.length[row]]
    return values.astype(np.float64), int(templates.first[row])


class Window:
    """Part of a profile, its mean and trend taken off, to be explained by one term or two.

    Parameters
    ----------
    profile, counts : arrays (ring,)
        From :func:`radial_profile`.
    first, length : int
        The rings.
    """

    def __init__(self, profile: Floats, counts: Floats, first: int, length: int) -> None:
        ring = slice(first, first + length)
        self._root = np.sqrt(counts[ring])
        step = np.arange(len(self._root), dtype=float)
        base, _ = np.linalg.qr(np.stack([self._root, self._root * step], axis=1))
        self._base = base
        self._grey = self._off(profile[ring] * self._root)
        self.squares = float(self._grey @ self._grey)
        self.is_seen = bool((counts[ring] > 0.0).all()) and len(step) > 4

    def _off(self, values: Floats) -> Floats:
        return values - values @ self._base @ self._base.T

    def left_by(self, terms: Floats) -> Floats:
        """Sum of squares that each of several terms (term, ring) leaves."""
        columns = self._off(np.atleast_2d(terms)[:, : len(self._root)] * self._root)
        norm = np.maximum((columns**2).sum(axis=1), _TINY)
        return self.squares - (columns @ self._grey) ** 2 / norm

    def left_by_all(self, terms: Floats) -> float:
        """Sum of squares that several terms (term, ring) leave together."""
        columns = self._off(terms[:, : len(self._root)] * self._root)
        base, _ = np.linalg.qr(columns.T)
        return self.squares - float(((self._grey @ base) ** 2).sum())


def is_edge(window: Window, term: Floats, factor: float) -> bool:
    """Tell whether a plain edge, sharp or soft, explains a profile as well as fringes do.

    Parameters
    ----------
    window : Window
        The profile.
    term : array (ring,)
        Interference term over the window.
    factor : float
        Multiple of the squares left by the fringes that the edge may leave.
    """
    return left_by_edge(window, len(term)) < factor * float(window.left_by(term)[0])


def left_by_edge(window: Window, rings: int, *, is_exact: bool = False) -> float:
    """Sum of squares that the likeliest plain edge leaves, sharp or soft; the least of all where ``is_exact``."""
    step = np.arange(rings, dtype=float)
    softness = 2.0 ** np.arange(-1.0, math.log2(max(rings, 4)))
    places = step[2:-2:2]
    edges = np.tanh((step - places[:, None, None]) / softness[:, None]).reshape(-1, rings)
    left = window.left_by(edges)
    if not is_exact or left.min() > _NEAR_EDGE * window.squares:
        return float(left.min())
    place, soft = np.unravel_index(int(left.argmin()), (len(places), len(softness)))
    found = [float(left.min())]
    for shape in (np.tanh, erf):
        at, steps = np.array([places[place], math.log(softness[soft])]), np.array([1.0, 0.5 * math.log(2.0)])
        for _ in range(_ZOOMS):
            near = at + steps * _AROUND
            left = window.left_by(shape((step - near[:, :1]) / np.exp(near[:, 1:])))
            at, steps = near[left.argmin()], 0.5 * steps
        found.append(float(left.min()))
    return min(found)


def is_sphere(window: Window, term: Floats, distance: Floats, optics: Optics, factor: float) -> bool:
    """Tell whether a sphere that touches or hovers explains a profile nearly as well as a contact.

    Parameters
    ----------
    window : Window
        The profile.
    term : array (ring,)
        Interference term of the contact over the window.
    distance : array (ring,) [px]
        Distances of the rings from the centre.
    optics : Optics
        The interference.
    factor : float
        Multiple of the squares left by the contact that the sphere may leave.
    """
    return left_by_sphere(window, distance, optics, optics.blur) < factor * float(window.left_by(term)[0])


def faded(phase: Floats, spread: tuple[float, float]) -> Floats:
    """Visibility at a phase of the gap, of rays of a cone that lag by up to a share of it and of a band of colours.

    ``spread`` is that share and the relative standard deviation of the wavenumbers.
    """
    cone, band = spread
    return np.sinc(0.5 * cone * phase / math.pi) * np.exp(-0.5 * (band * phase) ** 2)


def left_by_sphere(
    window: Window,
    distance: Floats,
    optics: Optics,
    blur: float,
    spread: tuple[float, float] = (0.0, 0.0),
    *,
    has_harmonics: bool = False,
) -> float:
    """Sum of squares that a sphere at any distance leaves, seen with a blur (px), and with a harmonic or without.

    ``spread`` is that of :func:`faded`.
    """
    visibility = faded(0.5 * optics.phase_scale * distance**2, spread)
    waves = []
    for slope in optics.phase_scale * (1.0 - 0.5 * spread[0]) * np.arange(1.0, 2.0 + has_harmonics):
        # A Gaussian blur of a phase that is square in the distance, in closed form.
        softened = 1.0 / (1.0 - 1j * slope * blur**2)
        waves.append(visibility * softened * np.exp(0.5j * slope * (distance**2 + 1.0 / 6.0) * softened))
    return window.left_by_all(np.concatenate([np.real(waves), np.imag(waves)]))

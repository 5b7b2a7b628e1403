"""Compare the radial profile of a frame with Hertz contacts of all radii."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes import (
    Optics,
    distance_at_phase,
    exposure_nodes,
    phase_slope,
    ring_limits,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Rings per half fringe next to the contact: enough to follow it, few enough to be quick.
_RINGS_PER_EDGE = 6.0
#: Samples of the model in a ring.
_SAMPLES = 2
#: Rings are not narrower than this (px).
_LEAST_WIDTH = 0.5
#: Fringes count as resolved when the phase changes by this within those that are used (rad).
_LEAST_PHASE = 0.9 * math.pi
#: Rows read for a profile: every so many that about this many pixels are summed.
_PROFILE_PIXELS = 150_000
#: Travels of the radius in the exposure that are tried, in widths of the first bright ring.
_TRAVELS = (0.0, 1.5, 4.0)
#: Share of the rings of a template that must lie in the frame.
_LEAST_SEEN = 0.75
#: A plain edge must leave this many times the squares that fringes leave.
_FRINGES_BETTER = 2.0
#: The contact of the other brightness is a match too from this share of the better score.
_NEARLY = 0.8
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
        Zero beyond the length.
    phase_scale : float [1/px²]
        As in :class:`labpipe.imaging.fringes.Optics`.
    """

    width: float
    bins: int
    radii: Floats
    first: Integers
    length: Integers
    travels: Floats
    values: NDArray[np.float32]
    phase_scale: float


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
def make_templates(
    shape: tuple[int, int], optics: Optics, fringes: float, least_spacing: float
) -> Templates | None:
    """Tabulate the contacts that may be seen in a frame, or None when no fringes are resolved.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of a frame.
    optics : Optics
        The interference.
    fringes, least_spacing : float
        As in :class:`labpipe.imaging.radius_fit.FitSettings`.
    """
    from labpipe.imaging.fringe_kernel import fill_templates

    reach = math.hypot(*shape)
    edge = edge_width(0.5 * reach, optics)
    width = max(_LEAST_WIDTH, 0.5 * math.floor(2.0 * edge / _RINGS_PER_EDGE))
    radii = np.array([
        a
        for a in width * np.arange(math.ceil(2.0 / width), reach / width)
        if has_resolved_fringes(a, optics, least_spacing)
    ])  # fmt: skip
    if not len(radii):
        return None
    limits = np.array([ring_limits(a, optics, fringes, least_spacing) for a in radii])
    inner, outer = limits.T
    first = np.floor(inner / width).astype(np.int64)
    length = np.floor(outer / width).astype(np.int64) - first
    travels = edge * np.array(_TRAVELS)
    spacing = 2.0 * math.pi / phase_slope(float(outer[-1]), float(radii[-1]), optics)
    values = np.stack([
        fill_templates(
            radii, first, length, width, travel, *exposure_nodes(travel, spacing),
            optics.phase_scale, optics.phase, _SAMPLES,
        )
        for travel in travels
    ])  # fmt: skip
    return Templates(
        width,
        int((first + length).max()),
        radii,
        first,
        length,
        travels,
        values,
        optics.phase_scale,
    )


def radial_profile(
    frame: NDArray[np.generic], x: float, y: float, width: float, bins: int
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
    """
    from labpipe.imaging.fringe_kernel import radial_sums

    step = max(1, math.floor(math.sqrt(frame.size / _PROFILE_PIXELS)))
    rows = np.ascontiguousarray(frame[::step], np.float32)
    sums, counts = radial_sums(rows, x, y, float(step), width, bins)
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
    ring = templates.first[:, None] + np.arange(templates.values.shape[2])
    is_used = np.arange(ring.shape[1]) < templates.length[:, None]
    weight = np.where(is_used, counts[np.minimum(ring, len(profile) - 1)], 0.0)
    rows = np.flatnonzero((weight > 0.0).sum(axis=1) >= _LEAST_SEEN * templates.length)
    if not len(rows):
        return []
    weight = weight[rows]
    grey = profile[np.minimum(ring[rows], len(profile) - 1)]
    values = templates.values[:, rows]
    step = np.arange(ring.shape[1], dtype=float)
    total = weight.sum(axis=1)
    step_off = step - ((weight @ step) / total)[:, None]
    grey_mean = (weight * grey).sum(axis=1) / total
    step_square = np.maximum((weight * step_off**2).sum(axis=1), _TINY * total)
    grey_off = grey - grey_mean[:, None]
    slope = (weight * step_off * grey_off).sum(axis=1) / step_square
    grey_off -= slope[:, None] * step_off
    grey_square = np.maximum((weight * grey_off**2).sum(axis=1), _TINY * total)
    term_mean = np.einsum("tij,ij->ti", values, weight) / total
    by_grey = np.einsum("tij,ij->ti", values, weight * grey_off)
    by_step = np.einsum("tij,ij->ti", values, weight * step_off)
    term_square = np.einsum("tij,ij->ti", values**2, weight)
    term_square -= total * term_mean**2 + by_step**2 / step_square
    term_square = np.maximum(term_square, _TINY * total)
    score = by_grey**2 / (term_square * grey_square)
    modulation = by_grey / term_square
    matches = []
    for polarity in (1.0, -1.0):
        signed = np.where(polarity * by_grey > 0.0, score, 0.0)
        travel, row = np.unravel_index(int(signed.argmax()), score.shape)
        amplitude = float(modulation[travel, row])
        matches.append(
            Match(
                float(templates.radii[rows[row]]),
                float(templates.travels[travel]),
                float(signed[travel, row]),
                float(grey_mean[row] - amplitude * term_mean[travel, row]),
                amplitude,
            )
        )
    matches.sort(key=lambda match: -match.score)
    return [match for match in matches if match.score >= _NEARLY * matches[0].score]


def sphere_score(profile: Floats, counts: Floats, match: Match, templates: Templates) -> float:
    """Share of the profile's variance that a sphere above the flat explains, at any height.

    The window, and the trend taken off, are those of the match.
    """
    row = int(np.argmin(np.abs(templates.radii - match.radius)))
    first = int(templates.first[row])
    ring = slice(first, first + int(templates.length[row]))
    grey, root = profile[ring], np.sqrt(counts[ring])
    r = (np.arange(first, first + len(grey)) + 0.5) * templates.width
    phase = 0.5 * templates.phase_scale * r**2
    columns = np.stack([np.ones_like(r), r, np.cos(phase), np.sin(phase)], axis=1) * root[:, None]
    left = [
        float(
            (
                (columns[:, :n] @ np.linalg.lstsq(columns[:, :n], grey * root)[0] - grey * root)
                ** 2
            ).sum()
        )
        for n in (2, 4)
    ]
    return 1.0 - left[1] / left[0] if left[0] > 0.0 else 0.0


def is_edge(profile: Floats, counts: Floats, template: Floats, first: int) -> bool:
    """Tell whether a plain edge, sharp or soft, explains a profile as well as fringes do.

    Parameters
    ----------
    profile, counts : arrays (ring,)
        From :func:`radial_profile`.
    template : array (ring,)
        Interference term that was fitted, from ring ``first`` on.
    first : int
        First ring of the window.
    """
    ring = slice(first, first + len(template))
    root = np.sqrt(counts[ring])
    grey, template = profile[ring], template[: len(root)]
    step = np.arange(len(grey), dtype=float)

    def left(term: Floats) -> float:
        columns = np.stack([np.ones_like(step), step, term], axis=1) * root[:, None]
        error = columns @ np.linalg.lstsq(columns, grey * root)[0] - grey * root
        return float((error**2).sum())

    places = step[2:-2:2]
    softness = 2.0 ** np.arange(-1.0, math.log2(max(len(step), 4)))
    edges = [left(np.tanh((step - place) / soft)) for place in places for soft in softness]
    return min(edges, default=math.inf) < _FRINGES_BETTER * left(template)

"""Comparison of the radial profile of a frame with Hertz contacts of all radii."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.imaging.fringes._ring_model import (
    Optics,
    edge_width,
    exposure_nodes,
    has_resolved_fringes,
    phase_of_gap,
    ring_limits,
)

#: Travels of the radius in the exposure that are tried, in widths of the first bright ring.
_TRAVELS = (0.0, 1.5, 4.0)


@dataclass(frozen=True)
class Templates:
    """Interference terms of contacts of many radii, each over a window of rings.

    ``width`` [px] of a ring; ``bins``: rings of a profile; ``radii`` (template,) [px]; ``first`` ring of the window and
    ``length``, number of rings in it (template,); ``travels`` (travel,) [px]: change of the radius in the
    exposure; ``values`` (travel, template, ring), zero beyond the length.
    """

    width: float
    bins: int
    radii: Floats
    first: Integers
    length: Integers
    travels: Floats
    values: Floats32


@dataclass(frozen=True)
class Match:
    """A contact that a profile resembles.

    ``radius``, ``travel`` [px]; ``score``: share of the variance, a linear trend taken off, that the fringes explain;
    ``gain``, ``modulation`` [grey levels]: light, and amplitude of the interference (negative: a bright contact);
    ``term`` (ring,): interference term from the ring ``first`` on.
    """

    radius: float
    travel: float
    score: float
    gain: float
    modulation: float
    term: Floats
    first: int


@lru_cache(maxsize=2)
def make_templates(shape: tuple[int, int], optics: Optics, fringes: float, least_spacing: float) -> Templates | None:
    """Tabulate the contacts that may be seen in a frame (row, column), or None when no fringes are resolved."""
    from labpipe.imaging.fringes._kernels import fill_templates

    reach = math.hypot(*shape)
    edge = edge_width(0.5 * reach, optics)
    width = max(0.5, 0.5 * math.floor(edge / 3.0))  # six rings up to the first bright one
    # Two rings from template to template are a third of the first bright ring.
    radii = np.array(
        [
            a
            for a in width * np.arange(math.ceil(2.0 / width), reach / width, 2)
            if has_resolved_fringes(a, optics, least_spacing)
        ]
    )
    if not len(radii):
        return None
    inner, outer = np.array([ring_limits(a, optics, fringes, least_spacing) for a in radii]).T
    first = np.floor(inner / width).astype(np.int64)
    length = np.floor(outer / width).astype(np.int64) - first
    travels = edge * np.array(_TRAVELS)
    spacing = 2.0 * math.pi / phase_of_gap(float(outer[-1]), float(radii[-1]), optics)[1]
    values = []
    for travel in travels:
        nodes, weights = exposure_nodes(float(travel), spacing)
        rest = float(travel), nodes, weights, optics.phase_scale, optics.phase
        values.append(fill_templates(radii, first, length, width, *rest))
    return Templates(width, int((first + length).max()), radii, first, length, travels, np.stack(values))


def best_matches(profile: Floats, counts: Floats, templates: Templates) -> list[Match]:
    """Dark and bright contact that explain most of a profile of ``templates.bins`` rings, the better one first.

    Three quarters of the rings of a template must lie in the frame. The contact of the other brightness is a match
    too when it explains nearly as much.
    """
    from labpipe.imaging.fringes._kernels import compare_templates

    windows = templates.first, templates.length
    score, modulation, light = compare_templates(profile, counts, templates.values, *windows, 0.75)
    matches = []
    for polarity in (1.0, -1.0):
        signed = np.where(polarity * modulation > 0.0, score, 0.0)
        travel, row = map(int, np.unravel_index(int(signed.argmax()), score.shape))
        term = templates.values[travel, row, : templates.length[row]].astype(np.float64)
        best = float(signed[travel, row]), float(light[travel, row]), float(modulation[travel, row])
        place = float(templates.radii[row]), float(templates.travels[travel])
        matches.append(Match(*place, *best, term, int(templates.first[row])))
    matches.sort(key=lambda match: -match.score)
    return [match for match in matches if match.score >= 0.8 * matches[0].score]

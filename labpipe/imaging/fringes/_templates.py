"""Comparison of the radial profile of a frame with Hertz contacts of all radii, of a known gap phase or of any."""

import math
from dataclasses import dataclass, replace
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
#: Logarithms of factors of the phase scale, in steps of a sixth of a fringe among three, and blurs in widths of the
#: first bright ring, that are tried where the stated optics explain nothing.
_LOG_SCALES, _BLURS = np.linspace(-0.7, 0.7, 29), (0.0, 0.3, 0.6)


@dataclass(frozen=True)
class Variant:
    """Properties of the contacts of a set of templates: change of the radius in the exposure and blur in px."""

    travel: float = 0.0
    log_scale: float = 0.0
    blur: float = 0.0


@dataclass(frozen=True)
class Templates:
    """Interference terms of contacts of many radii, each over a window of rings.

    ``width`` [px] of a ring; ``bins``: rings of a profile; ``radii`` (template,) [px]; ``first`` ring of the window and
    ``length``, number of rings in it (template,); ``values`` (variant, 2, template, ring): cosine and sine of the phase
    of the gap, zero beyond the length.
    """

    width: float
    bins: int
    radii: Floats
    first: Integers
    length: Integers
    variants: tuple[Variant, ...]
    values: Floats32


@dataclass(frozen=True)
class Match:
    """A contact that a profile resembles.

    ``radius`` [px]; ``variant`` and ``phase`` [rad] of its fringes; ``score``: share of the variance, a linear trend
    taken off, that they explain; ``gain``, ``modulation`` [grey levels]: light, and amplitude of the interference
    (negative: a bright contact); ``term`` (ring,): interference term from the ring ``first`` on.
    """

    radius: float
    variant: Variant
    phase: float
    score: float
    gain: float
    modulation: float
    term: Floats
    first: int


@lru_cache(maxsize=2)
def make_templates(shape: tuple[int, int], optics: Optics, fringes: float, least_spacing: float) -> Templates | None:
    """Tabulate the contacts that may be seen in a frame (row, column), or None when no fringes are resolved."""
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
    variants = tuple(Variant(travel=edge * travel) for travel in _TRAVELS)
    values = np.zeros((0, 2, len(radii), length.max()), np.float32)
    bare = Templates(width, int((first + length).max()), radii, first, length, (), values)
    return _filled(bare, variants, optics)


def any_matches(profile: Floats, counts: Floats, usual: Templates, optics: Optics, size: float) -> list[Match]:
    """Contacts about as large as a spot (px) whose fringes, of any phase and of many scales and blurs, match best.

    Sharp fringes are matched by themselves too: blurred ones of a wrong scale may explain an ellipse better.
    """
    near = (usual.radii >= 0.5 * size) & (usual.radii <= 1.2 * size)
    if not near.any():
        return []
    few = replace(usual, radii=usual.radii[near], first=usual.first[near], length=usual.length[near])
    edge, blurs = edge_width(size, optics), len(_BLURS)
    variants = tuple(Variant(0.0, float(scale), blur * edge) for scale in _LOG_SCALES for blur in _BLURS)
    every = _filled(few, variants, optics)
    sharp = replace(every, variants=variants[::blurs], values=every.values[::blurs])
    return [match for each in (every, sharp) for match in best_matches(profile, counts, each, None)]


def _filled(bare: Templates, variants: tuple[Variant, ...], optics: Optics) -> Templates:
    from labpipe.imaging.fringes._kernels import fill_templates

    outer = float(bare.first[-1] + bare.length[-1]) * bare.width
    spacing = 2.0 * math.pi / phase_of_gap(outer, float(bare.radii[-1]), optics)[1]
    windows, values = (bare.radii, bare.first, bare.length, bare.width), []
    for one in variants:
        motion = one.travel, *exposure_nodes(one.travel, spacing)
        blur = math.hypot(one.blur, optics.blur)
        values.append(fill_templates(windows, motion, blur, optics.phase_scale * math.exp(one.log_scale)))
    return replace(bare, variants=variants, values=np.stack(values))


def best_matches(profile: Floats, counts: Floats, templates: Templates, phase: float | None) -> list[Match]:
    """Contacts that explain most of a profile of ``templates.bins`` rings, the best one first.

    With a ``phase`` they are the best dark and the best bright contact of it, the other one where it explains nearly as
    much; without, three of any phase whose scales differ by more than a tenth, another scale than the stated one only
    where it leaves half as much. Three quarters of the rings of a template must lie in the frame.
    """
    from labpipe.imaging.fringes._kernels import compare_templates

    sums = compare_templates(profile, counts, templates.values, templates.first, templates.length, 0.75)
    yy, yc, ys, cc, cs, ss, light, mean_c, mean_s = np.moveaxis(sums, -1, 0)
    tiny = 1e-6 * max(float(counts.sum()), 1.0)
    log_scales = np.array([variant.log_scale for variant in templates.variants])[:, None]
    if phase is None:
        determinant = np.maximum(cc * ss - cs**2, tiny**2)
        in_c, in_s = (ss * yc - cs * ys) / determinant, (cc * ys - cs * yc) / determinant
    else:
        cosine, sine = math.cos(phase), math.sin(phase)
        own = cosine**2 * cc - 2.0 * cosine * sine * cs + sine**2 * ss
        amplitude = (cosine * yc - sine * ys) / np.maximum(own, tiny)
        in_c, in_s = cosine * amplitude, -sine * amplitude
    score = (in_c * yc + in_s * ys) / np.maximum(yy, tiny)
    if phase is None:
        ranks = [np.where(yy > 0.0, 1.0 - (1.0 - score) * np.where(log_scales == 0.0, 1.0, 2.0), 0.0)] * 3
    else:
        ranks = [np.where(amplitude > 0.0, score, 0.0), np.where(amplitude < 0.0, score, 0.0)]
    matches: list[Match] = []
    for rank in ranks:
        apart = [np.abs(log_scales - match.variant.log_scale) > 0.1 for match in matches if phase is None]
        shown = np.where(np.all(apart, axis=0), rank, 0.0) if apart else rank
        variant, row = map(int, np.unravel_index(int(shown.argmax()), score.shape))
        c, s = float(in_c[variant, row]), float(in_s[variant, row])
        found = math.atan2(-s, c) if phase is None else phase
        waves = templates.values[variant, :, row, : templates.length[row]].astype(np.float64)
        term = math.cos(found) * waves[0] - math.sin(found) * waves[1]
        light_there = float(light[variant, row] - c * mean_c[variant, row] - s * mean_s[variant, row])
        fringes = templates.variants[variant], found, float(score[variant, row]) * (shown[variant, row] > 0.0)
        modulation = c * math.cos(found) - s * math.sin(found)
        place = float(templates.radii[row]), *fringes, light_there, modulation
        matches.append(Match(*place, term, int(templates.first[row])))
    matches.sort(key=lambda match: -match.score)
    return [match for match in matches if match.score >= 0.8 * matches[0].score]

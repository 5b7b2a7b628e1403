"""Phase and scale of the fringes about a point, by comparing its profile with circles of every radius."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._interference import distance_at_phase, scaled_gap
from labpipe.imaging.fringes._radial_scan import radial_profile
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._view import View

#: Logarithms of the factor of the phase scale that are tried: 1/2 to 2 in steps that keep three
#: fringes within a sixth of a fringe. The stated one comes first where all explain as much.
LOG_SCALES = np.linspace(-0.7, 0.7, 29)
#: Fringes compared, at the stated scale, and rings in them.
_FRINGES, _RINGS = 3.0, 48
#: Radii tried, as shares of the radius of a spot: its edge may be any of the first rings.
_SMALLEST, _LARGEST, _RADII = 0.5, 1.15, 60
#: Share of a profile's variance that must be explained, and guesses that are made of it.
_LEAST_SCORE, _MOST_GUESSES = 0.6, 3
#: Share of the rings that must be seen.
_LEAST_SEEN = 0.75
#: A scale other than the stated one must leave less than this share of what that leaves.
_SCALE_SHARE = 0.5


@dataclass(frozen=True)
class Guess:
    """A contact that a profile resembles: radius (px), scale, phase, light."""

    score: float
    radius: float
    log_scale: float
    phase: float
    gain: float
    modulation: float

    def start(self, base: Floats) -> Floats:
        """Return parameters to start a fit from, all but radius, phase and light as in others."""
        start = base.copy()
        start[[Parameter.RADIUS, Parameter.PHASE]] = self.radius, self.phase
        start[[Parameter.GAIN, Parameter.MODULATION]] = self.gain, self.modulation
        return start


def guesses(
    frame: NDArray[np.generic], view: View, x: float, y: float, size: float, log_scales: Floats = LOG_SCALES
) -> Iterator[Guess]:
    """Contacts that explain the profile about a point, the likeliest first."""
    optics = view.optics
    reach = distance_at_phase(2.0 * math.pi * _FRINGES, _LARGEST * size, optics) + 2.0
    profile, counts = radial_profile(frame, x, y, 1.0, math.ceil(reach) + 1)
    found = _best_scales(profile, counts, np.linspace(_SMALLEST, _LARGEST, _RADII) * size, view, log_scales)
    found.sort(key=lambda guess: -guess.score)
    chosen: list[Guess] = []
    for guess in found:
        if all(abs(guess.log_scale - other.log_scale) > 0.1 for other in chosen):
            chosen.append(guess)
    yield from chosen[:_MOST_GUESSES]


def _best_scales(profile: Floats, counts: Floats, radii: Floats, view: View, log_scales: Floats) -> list[Guess]:
    """Scale and phase that explain most of the rings around each of some radii, where they explain enough."""
    optics = view.optics
    outer = np.array([distance_at_phase(2.0 * math.pi * _FRINGES, radius, optics) for radius in radii.tolist()])
    places = np.linspace(np.maximum(2.0 * radii - outer, 0.0), outer, _RINGS, axis=1)
    rings = np.minimum(places.astype(np.int64), len(profile) - 1)
    is_seen = (counts[rings] > 0.0).sum(axis=1) >= _LEAST_SEEN * _RINGS
    if not is_seen.any():
        return []
    radii, places, rings = radii[is_seen], places[is_seen], rings[is_seen]
    weight = np.sqrt(counts[rings])
    # The middle of a ring of whole pixels lies half a pixel outside its first distance.
    gap = optics.phase_scale * scaled_gap(rings + 0.5, radii[:, None])
    argument = gap[:, None] * np.exp(log_scales)[:, None]
    base, _ = np.linalg.qr(np.stack([weight, weight * places], axis=2))
    grey = (profile[rings] * weight)[:, :, None]
    left = grey - base @ (base.transpose(0, 2, 1) @ grey)
    waves = np.stack([np.cos(argument), np.sin(argument)], axis=2)
    terms = (waves * weight[:, None, None]).reshape(len(radii), -1, _RINGS)
    terms -= terms @ base @ base.transpose(0, 2, 1)
    right = (terms @ left).reshape(*argument.shape[:2], 2)
    terms = terms.reshape(*argument.shape[:2], 2, _RINGS)
    normal = terms @ terms.transpose(0, 1, 3, 2) + 1e-9 * np.eye(2) * _RINGS
    amplitude = np.linalg.solve(normal, right[..., None])[..., 0]
    total = (left**2).sum(axis=(1, 2))
    score = (amplitude * right).sum(axis=2) / np.maximum(total, 1e-300)[:, None]
    stated = len(log_scales) // 2
    best = score.argmax(axis=1)
    each = np.arange(len(radii))
    best = np.where(1.0 - score[each, best] > _SCALE_SHARE * (1.0 - score[:, stated]), stated, best)
    found: list[Guess] = []
    for k in np.flatnonzero((total > 0.0) & (score[each, best] >= _LEAST_SCORE)).tolist():
        at = int(best[k])
        cosine, sine = amplitude[k, at].tolist()
        model = amplitude[k, at] @ waves[k, at]
        gain = float(np.average(profile[rings[k]] - model, weights=weight[k] ** 2))
        phase, modulation = math.atan2(-sine, cosine), math.hypot(cosine, sine)
        found.append(Guess(float(score[k, at]), float(radii[k]), float(log_scales[at]), phase, gain, modulation))
    return found

"""Tests that distinguish a contact from a plain edge, and from a sphere that touches without load or hovers.

In coherent light a hovering and a touching sphere differ by the phase of the gap only: the rings of a sphere without
load are cos(phase_scale r²/2 + any phase). A small contact must explain its rings better than that, and must grow out
of nothing and return to it together with the frames around it.
"""

import math

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.fringes._ring_model import Optics


class Window:
    """Some rings of a radial profile (ring,), mean and trend taken off, to be explained by one term or two."""

    def __init__(self, profile: Floats, counts: Floats, first: int, length: int) -> None:
        ring = slice(first, first + length)
        self._root = np.sqrt(counts[ring])
        step = np.arange(len(self._root), dtype=float)
        base, _ = np.linalg.qr(np.stack([self._root, self._root * step], axis=1))
        self._base = base
        self._grey = self._without_trend(profile[ring] * self._root)
        self.squares = float(self._grey @ self._grey)
        self.is_seen = bool((counts[ring] > 0.0).all()) and len(step) > 4

    def _without_trend(self, values: Floats) -> Floats:
        return np.asarray(values - values @ self._base @ self._base.T)

    def residual(self, terms: Floats) -> Floats:
        """Sum of squares that each of several terms (term, ring) leaves."""
        columns = self._without_trend(np.atleast_2d(terms)[:, : len(self._root)] * self._root)
        norm = np.maximum((columns**2).sum(axis=1), 1e-6)
        return np.asarray(self.squares - (columns @ self._grey) ** 2 / norm)

    def residual_of_both(self, one: Floats, other: Floats) -> float:
        """Sum of squares that two terms (ring,) leave together."""
        columns = self._without_trend(np.stack([one, other])[:, : len(self._root)] * self._root)
        base, _ = np.linalg.qr(columns.T)
        return self.squares - float(((self._grey @ base) ** 2).sum())


def is_edge(window: Window, term: Floats, factor: float) -> bool:
    """Tell whether a plain edge, sharp or soft, leaves less than ``factor`` times the squares that fringes leave."""
    step = np.arange(len(term), dtype=float)
    softness = 2.0 ** np.arange(-1.0, math.log2(max(len(step), 4)))
    places = step[2:-2:2]
    edges = np.tanh((step - places[:, None, None]) / softness[:, None]).reshape(-1, len(step))
    return bool(window.residual(edges).min() < factor * window.residual(term)[0])


def is_sphere(window: Window, term: Floats, distance: Floats, optics: Optics) -> bool:
    """Tell whether a sphere that touches or hovers leaves less than twice the squares that a contact leaves.

    ``term`` (ring,) is the interference term of the contact at the distances (px).
    """
    return _left_by_sphere(window, distance, 0.0, optics) < 2.0 * float(window.residual(term)[0])


def shows_only_sphere(profile: Floats, counts: Floats, width: float, optics: Optics) -> bool:
    """Tell whether a sphere without load explains 98 % of the rings of a profile, so that it is no large contact.

    From the centre out to where rings are closer than four pixels.
    """
    length = min(len(profile), int(0.5 * math.pi / (optics.phase_scale * width)))
    window = Window(profile, counts, 0, length)
    distance = (np.arange(length, dtype=np.float64) + 0.5) * width
    return window.is_seen and _left_by_sphere(window, distance, width, optics) < 0.02 * window.squares


def _left_by_sphere(window: Window, distance: Floats, width: float, optics: Optics) -> float:
    """Sum of squares that the fringes of a sphere without load leave, of any gap.

    A ring averages over its width (px), as a blur does, and light of low coherence fades outwards.
    """
    phase, slope = 0.5 * optics.phase_scale * distance**2, optics.phase_scale * distance
    fade = np.sinc(0.5 * slope * width / math.pi)
    fade *= np.exp(-0.5 * (optics.blur * slope) ** 2 - 0.5 * optics.spread * phase**2)
    return window.residual_of_both(fade * np.cos(phase), fade * np.sin(phase))

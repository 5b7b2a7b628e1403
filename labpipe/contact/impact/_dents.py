"""Dents that contacts left on the surface, between collocated bounces."""

from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.contact.impact._method import interpolation, radial_nodes
from labpipe.contact.memory import Creep

_GAUSS_POINTS = 40


class _Dent(NamedTuple):
    """Displacement (element, node) [m] of the springs out to an edge [m].

    ``shown`` (element,) [J] is the energy of those that no later dent covers.
    """

    edge: float
    values: Floats
    shown: Floats


@dataclass(slots=True)
class Dents:
    """Dents that contacts left on the surface: the latest, and the parts of earlier ones that reach beyond it.

    Without ``has_energy`` no account is kept of the energy that they store.
    """

    creep: Creep
    has_energy: bool = True
    layers: list[_Dent] = field(default_factory=list)

    def add(self, edge: float, values: Floats) -> None:
        """Put the dent of a contact over those before it."""
        self.cover(edge)
        shown = np.zeros(self.creep.rate.size)
        if self.has_energy:
            shown = 0.5 * self.creep.inverse * (values**2 @ (edge * radial_nodes().means[0]))
        self.layers.append(_Dent(edge, values, shown))

    def cover(self, edge: float) -> None:
        """Take away the parts within an edge [m]."""
        while self.layers and self.layers[-1].edge <= edge:
            self.layers.pop()
        if self.layers and self.has_energy:
            layer = self.layers[-1]
            points, weights = _gauss_rule()
            # The dent ends like a power 3/2 at its edge: smooth over the root of the distance.
            root, width = 0.5 * (points + 1.0), layer.edge - edge
            values = _values(layer, layer.edge - width * root**2)
            shown = self.creep.inverse * (values**2 @ (weights * width * root))
            self.layers[-1] = layer._replace(shown=shown)

    def relax(self, dt: float) -> None:
        """Let all recover for a time [s]."""
        left = np.exp(-dt * self.creep.rate)
        self.layers = [_Dent(edge, left[:, None] * values, left**2 * shown) for edge, values, shown in self.layers]

    @property
    def centre(self) -> Floats:
        """Displacements (element,) of the central spring."""
        if not self.layers:
            return np.zeros(self.creep.rate.size)
        return np.ascontiguousarray(self.layers[-1].values[:, -1])

    def at(self, position: Floats) -> Floats:
        """Displacements (element, spring) at distances from the axis (spring,) [m]."""
        found = np.zeros((self.creep.rate.size, position.size))
        for layer in self.layers:  # later ones are smaller and lie on top
            inside = position <= layer.edge
            found[:, inside] = _values(layer, position[inside])
        return found

    def stored(self) -> Floats:
        """Energy (element,) in J of the free springs."""
        return np.asarray(sum((layer.shown for layer in self.layers), np.zeros(self.creep.rate.size)))


@cache
def _gauss_rule() -> tuple[Floats, Floats]:
    """Points (point,) from -1 to 1, and their weights."""
    return np.polynomial.legendre.leggauss(_GAUSS_POINTS)


def _values(layer: _Dent, position: Floats) -> Floats:
    """Displacements (element, spring) within a dent."""
    place = np.sqrt(np.maximum(1.0 - (position / layer.edge) ** 2, 0.0))
    return np.asarray(layer.values @ interpolation(radial_nodes().s, radial_nodes().bary, place).T)

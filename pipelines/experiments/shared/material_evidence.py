"""Data of one experiment for the identification of its material."""

from collections.abc import Callable
from dataclasses import dataclass

from labpipe.arrays import Floats
from labpipe.identification import Evidence, Parameter


@dataclass(frozen=True, eq=False)
class MaterialEvidence:
    """One experiment, ready to become evidence once the relaxation times are chosen.

    Attributes
    ----------
    nu : float
    window : tuple of float [s]
        Shortest and longest time of which it tells.
    unknowns : tuple of Parameter
        What it leaves unknown besides the material.
    build : callable
        Takes relaxation times (term,) and returns the evidence.
    """

    nu: float
    window: tuple[float, float]
    unknowns: tuple[Parameter, ...]
    build: Callable[[Floats], Evidence]


def nuisance(name: str, mean: float, sd: float, unit: str, text: str) -> Parameter:
    """Return an unknown of an experiment."""
    return Parameter(name, mean, sd, unit, text, is_nuisance=True)

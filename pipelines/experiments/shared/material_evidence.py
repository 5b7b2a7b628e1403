"""Data of one experiment for the identification of its material."""

from collections.abc import Callable
from dataclasses import dataclass

from labpipe.arrays import Floats
from labpipe.identification import Evidence, Parameter
from labpipe.units import Quantity


@dataclass(frozen=True, eq=False)
class MaterialEvidence:
    """One experiment, ready to become evidence once the relaxation times are chosen.

    Attributes
    ----------
    nu : float
    window : tuple of float [s]
        Shortest and longest time on which it depends.
    unknowns : tuple of Parameter
        Its unknowns in addition to the material.
    build : callable
        Takes relaxation times (term,) and returns the evidence.
    """

    nu: float
    window: tuple[float, float]
    unknowns: tuple[Parameter, ...]
    build: Callable[[Floats], Evidence]


CONTACT_MODULUS = "Poisson's ratio"
"""Unknown of all contacts with a material, by its effect: E/(1 - nu^2) over that of the stated ratio."""


def of_poissons_ratio(nu: Quantity) -> list[Parameter]:
    """Return the unknown that an uncertain Poisson's ratio is; none where it is stated as exact."""
    relative = 2.0 * nu.value * nu.u / (1.0 - nu.value**2)
    text = "Poisson's ratio, by E/(1 - nu²) of a contact"
    return [nuisance(CONTACT_MODULUS, 1.0, relative, "1", text)] if relative > 0.0 else []


def nuisance(name: str, mean: float, sd: float, unit: str, text: str) -> Parameter:
    """Return an unknown of an experiment."""
    return Parameter(name, mean, sd, unit, text, is_nuisance=True)

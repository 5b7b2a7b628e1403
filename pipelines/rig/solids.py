"""The five solids of the virtual rig: one truth for everything that is recorded of each.

Every relaxation is a fractional element (Havriliak & Negami, Polymer 8 (1967) 161,
doi:10.1016/0032-3861(67)90021-3), which no finite sum of exponentials equals: the analysis fits
such sums, so it cannot be right by construction. Nothing here asks :mod:`labpipe.materials`, and
nothing of the library comes from here.

The relaxation function is the numerical inverse of its Laplace transform, by a fixed Talbot contour.

References
----------
J. Abate & W. Whitt, INFORMS J. Comput. 18 (2006) 408, https://doi.org/10.1287/ijoc.1050.0137.
"""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.constants import R, zero_Celsius

from labpipe.arrays import Floats

if TYPE_CHECKING:
    from labpipe.materials import Prony

_GAS_LN10 = R * np.log(10.0)  # J/(mol K)
_NODES = 24  # of the Talbot contour; 14 digits in double precision at most


@dataclass(frozen=True, slots=True)
class Element:
    """One Havriliak–Negami relaxation: strength [Pa], time [s], exponents.

    With both exponents 1 it is the Maxwell element.
    """

    strength: float
    time: float
    width: float = 1.0
    skew: float = 1.0


@dataclass(frozen=True, slots=True)
class Viscoelastic:
    """A solid at one temperature: relaxations in parallel with a spring of modulus ``relaxed`` [Pa]."""

    elements: tuple[Element, ...]
    relaxed: float
    nu: float

    @property
    def unrelaxed(self) -> float:
        """Instantaneous modulus [Pa]."""
        return self.relaxed + sum(e.strength for e in self.elements)

    def carson(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Return s times the Laplace transform of the relaxation function, at complex s [1/s]."""
        s = np.asarray(s, dtype=complex)
        return np.asarray(self.unrelaxed - self._missing(s))

    def _missing(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the instantaneous modulus minus that at s."""
        missing = np.zeros(s.shape, dtype=complex)
        for e in self.elements:
            missing += e.strength * (1 + (s * e.time) ** e.width) ** -e.skew
        return missing

    def modulus(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the complex tension modulus [Pa] at frequencies in Hz."""
        return self.carson(2j * np.pi * np.asarray(frequency, dtype=float))

    def relaxation(self, time: ArrayLike) -> Floats:
        """Return the relaxation function [Pa] at times above 0."""
        return self.unrelaxed - inverse_laplace(lambda s: self._missing(s) / s, time)

    def derivative(self, time: ArrayLike, order: int) -> Floats:
        """Return t^n/n! times the n-th derivative of the relaxation function [Pa], n above 0."""
        t = np.asarray(time, dtype=float)
        factor = -(t**order) / float(np.prod(np.arange(1, order + 1)))
        return np.asarray(factor * inverse_laplace(lambda s: self._missing(s) * s ** (order - 1), t))

    def mean_relaxation(self, time: ArrayLike) -> Floats:
        """Return the mean of the relaxation function [Pa] from 0 to times above 0."""
        t = np.asarray(time, dtype=float)
        return self.unrelaxed - inverse_laplace(lambda s: self._missing(s) / s**2, t) / t

    def creep(self, time: ArrayLike) -> Floats:
        """Return the creep compliance [1/Pa] at times above 0."""
        return inverse_laplace(lambda s: 1 / (s * self.carson(s)), time)


def inverse_laplace(transform: Any, time: ArrayLike) -> Floats:
    """Invert a Laplace transform at times above 0 [s]."""
    t = np.asarray(time, dtype=float)
    angle = np.arange(1, _NODES) * np.pi / _NODES
    cotangent = 1 / np.tan(angle)
    r = 2 * _NODES / 5
    node = np.concatenate([[r + 0j], r * angle * (cotangent + 1j)])
    slope = 1j * angle * (1 + cotangent**2) - 1j * cotangent
    weight = np.concatenate([[0.5 * np.exp(r) + 0j], (1 + slope) * np.exp(node[1:])])
    s = node / t[..., None]
    return np.asarray(0.4 / t * np.real(weight * transform(s)).sum(axis=-1))


@dataclass(frozen=True, slots=True)
class Solid:
    """A thermorheologically simple solid in tension: its relaxations at ``T_ref`` [degC].

    ``energy`` [J/mol] is the Arrhenius slope below ``kink`` [degC]; above it the WLF constants
    ``C1`` and ``C2`` [K] hold about the kink. All moduli grow by the share ``softening`` [1/K] of
    themselves (negative for a plastic that softens), or with the absolute temperature where
    ``is_entropic``. ``mode`` says how the rheometer loads it.
    """

    elements: tuple[Element, ...]
    relaxed: float
    nu: float
    energy: float = 0.0
    kink: float = np.inf
    C1: float = 0.0
    C2: float = 1.0
    T_ref: float = 20.0
    softening: float = 0.0
    is_entropic: bool = False
    mode: Literal["tension", "torsion"] = "tension"

    def log10_aT(self, temperature: ArrayLike) -> Floats:
        """Return log10 of the horizontal shift at temperatures in °C; zero at the reference."""
        T = np.asarray(temperature, dtype=float)
        return self._from_kink(T) - self._from_kink(np.asarray(self.T_ref))

    def _from_kink(self, T: Floats) -> Floats:
        if not np.isfinite(self.kink):
            return np.asarray(self.energy / _GAS_LN10 / (T + zero_Celsius))
        cold = np.minimum(T, self.kink)
        below = self.energy / _GAS_LN10 * (1 / (cold + zero_Celsius) - 1 / (self.kink + zero_Celsius))
        warm = np.maximum(T - self.kink, 0.0)
        return np.asarray(below - self.C1 * warm / (self.C2 + warm))

    def b_T(self, temperature: ArrayLike) -> Floats:
        """Return the vertical shift at temperatures in °C; one at the reference."""
        T = np.asarray(temperature, dtype=float)
        if self.is_entropic:
            return np.asarray((T + zero_Celsius) / (self.T_ref + zero_Celsius))
        return np.asarray(1.0 + self.softening * (T - self.T_ref))

    def at(self, temperature: float | None = None) -> Viscoelastic:
        """Return the solid at a temperature [degC]; None is the reference."""
        T = self.T_ref if temperature is None else temperature
        slower, stiffer = 10.0 ** float(self.log10_aT(T)), float(self.b_T(T))
        elements = tuple(replace(e, strength=e.strength * stiffer, time=e.time * slower) for e in self.elements)
        return Viscoelastic(elements, self.relaxed * stiffer, self.nu)

    def modulus(self, frequency: ArrayLike, temperature: ArrayLike) -> NDArray[np.complex128]:
        """Return the complex tension modulus [Pa] at frequencies in Hz and temperatures in °C."""
        T = np.asarray(temperature, dtype=float)
        reduced = np.asarray(frequency, dtype=float) * 10.0 ** self.log10_aT(T)
        return np.asarray(self.at().modulus(reduced) * self.b_T(T))


Truth: TypeAlias = "Viscoelastic | Prony"
"""What a recording may be made of: a solid of the rig, or a Prony series where a test asks for one."""


def solid_of(truth: Truth) -> Viscoelastic:
    """Return the solid behind either; a Prony series is a sum of Maxwell elements."""
    if isinstance(truth, Viscoelastic):
        return truth
    series = truth
    elements = tuple(Element(float(E), float(rho)) for E, rho in zip(series.E, series.rho, strict=True))
    return Viscoelastic(elements, float(series.E_relaxed), float(series.nu))


def truth_of_solid(solid: Viscoelastic | Solid) -> dict[str, Any]:
    """Return the spectrum at the temperature of the test, for the truth of a recording."""
    return {"elements": [asdict(element) for element in solid.elements], "relaxed": solid.relaxed, "nu": solid.nu}


_READ = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
SOLIDS = {
    name: Solid(**(given | {"elements": tuple(Element(*values) for values in given["elements"])}))
    for name, given in _READ.items()
}
"""The truth of every synthetic record of these materials; none is a measurement."""

SAPPHIRE = (1 - 0.24**2) / 400e9
"""1/Pa; compliance of the disc under every sphere: truly of 400 GPa, within the 10 GPa by which this is known."""

ROOM = 20.2
"""degC; where all experiments but the rheometer's and the heated ones truly are."""


def specimen_of(material: str, temperature: float | None = None) -> Viscoelastic:
    """Return one of the rig's solids where an experiment is: in the room unless heated [degC]."""
    return SOLIDS[material].at(ROOM if temperature is None else temperature)

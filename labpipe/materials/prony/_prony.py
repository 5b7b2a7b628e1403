"""The linear viscoelastic solid as a Prony series: one object that every other part takes.

Names. Contact mechanics writes E₀ for the long-time modulus, finite-element codes for the
instantaneous one. Neither is used here: ``E_relaxed`` is the long-time (zero-frequency, rubbery)
modulus, ``E_unrelaxed`` the instantaneous (glassy) one. Relaxation times are ``rho``,
retardation times ``tau``.

The thermodynamic conditions of the thesis, (1.8), (1.9), (1.20) and (1.24), reduce for a Prony
series to this: no negative weight, no negative long-time modulus, no negative instantaneous
compliance, positive times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Complexes, Floats
from labpipe.errors import InputError
from labpipe.materials.prony._interconversion import (
    Relaxation,
    Retardation,
    creep_from_relaxation,
    merged,
    relaxation_from_creep,
)
from labpipe.notebook import html_table
from labpipe.units import Quantity

Mode = Literal["tension", "shear", "contact"]


# Rounding of ΣC against 1/E_relaxed: a smaller remainder counts as none.
_ROUNDING = 4.0 * float(np.finfo(float).eps)
# A weight this small against the whole has no effect in double precision at any time, and the
# squares of its offsets would leave the range of the numbers.
_NEGLIGIBLE = 1e-100


@dataclass(frozen=True, eq=False)
class Prony:
    r"""A linear viscoelastic material in tension, with a constant Poisson's ratio.

    .. math::
        E(t) = E_{relaxed} + \sum_j E_j e^{-t/\rho_j}, \qquad
        J(t) = 1/E_{relaxed} - \sum_k C_k e^{-t/\tau_k}.

    Terms are kept in ascending time; zero weights are dropped, equal times added up.

    Parameters
    ----------
    E_relaxed : float [Pa]
        Long-time modulus, not negative; 0 is a viscoelastic liquid.
    E : array (term,) [Pa]
        Weights, none negative. Empty lists give an elastic solid.
    rho : array (term,) [s]
        Relaxation times, positive.
    nu : float
        Poisson's ratio, −1 < ν ≤ 0.5.
    viscosity : float [Pa s]
        Dashpot in parallel; needed only by materials without instantaneous compliance.

    Raises
    ------
    InputError
        The terms are not thermodynamically admissible: E(t) would not be positive, decreasing
        and convex, or work could be gained from a closed cycle.

    Examples
    --------
    >>> solid = Prony(2e9, [2e9], [0.5], nu=0.35)
    >>> solid.E_unrelaxed
    4000000000.0
    >>> C, tau = solid.creep_terms()
    >>> float(tau[0])
    1.0

    Notes
    -----
    Thesis equations (1.41), (1.42), (2.5); admissibility (1.8), (1.9), (1.20), (1.24). Both
    families are exact images of each other, see :mod:`._interconversion`.
    Instances are immutable, compare by value, and travel between processes.
    """

    E_relaxed: float
    E: Floats
    rho: Floats
    nu: float = 0.5
    viscosity: float = 0.0
    _given_creep: Retardation | None = field(default=None, repr=False)

    def __init__(
        self,
        E_relaxed: float,
        E: ArrayLike,
        rho: ArrayLike,
        nu: float = 0.5,
        viscosity: float = 0.0,
        _given_creep: Retardation | None = None,
    ) -> None:
        _not_negative("E_relaxed", E_relaxed, "Pa")
        _not_negative("viscosity", viscosity, "Pa s")
        weight, time = _checked_terms("E", "rho", E, rho, E_relaxed)
        if not -1.0 < nu <= 0.5:
            raise InputError(f"nu = {nu}: Poisson's ratio of an isotropic solid lies in (−1, 0.5]")
        if E_relaxed == 0 and weight.size == 0:
            raise InputError("E_relaxed = 0 and no terms: the material has no stiffness; give a modulus")
        if (creep := _given_creep) is not None:
            creep = replace(creep, weight=_frozen(creep.weight), time=_frozen(creep.time))
        terms = (float(E_relaxed), _frozen(weight), _frozen(time), float(nu), float(viscosity), creep)
        for name, value in zip(("E_relaxed", "E", "rho", "nu", "viscosity", "_given_creep"), terms, strict=True):
            object.__setattr__(self, name, value)

    @classmethod
    def from_creep(cls, E_relaxed: float, C: ArrayLike, tau: ArrayLike, nu: float = 0.5) -> Prony:
        """Build from creep terms; they are kept as given, the relaxation terms are exact.

        Parameters
        ----------
        E_relaxed : float [Pa]
            Long-time modulus, positive.
        C : array (term,) [1/Pa]
            Weights of J(t) = 1/E_relaxed − Σ C exp(−t/τ), none negative, ΣC ≤ 1/E_relaxed.
        tau : array (term,) [s]
            Retardation times, positive.
        nu : float
            Poisson's ratio.

        Raises
        ------
        InputError
            The terms are not admissible.

        Examples
        --------
        >>> solid = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
        >>> round(solid.E_unrelaxed), solid.rho
        (4000000000, array([0.0005]))
        """
        if not (np.isfinite(E_relaxed) and E_relaxed > 0):
            raise InputError(f"E_relaxed = {E_relaxed} Pa: creep terms need a positive long-time modulus")
        weight, time = _checked_terms("C", "tau", C, tau, 1.0 / E_relaxed)
        # 1/E_relaxed − ΣC without cancellation, exactly zero when it is rounding
        rest = float(1 / Fraction(float(E_relaxed)) - sum((Fraction(c) for c in weight), Fraction(0)))
        rest = 0.0 if abs(rest) * E_relaxed <= _ROUNDING else rest
        if rest < 0:
            raise InputError(
                f"ΣC = {float(np.sum(weight)):.6g} 1/Pa exceeds 1/E_relaxed = {1 / E_relaxed:.6g} 1/Pa: "
                "the instantaneous compliance would be negative (not admissible)"
            )
        creep = Retardation(rest, weight, time)
        family = relaxation_from_creep(creep)
        return cls(E_relaxed, family.weight, family.time, nu, family.viscosity, creep)

    @cached_property
    def _creep(self) -> Retardation:
        if self._given_creep is not None:
            return self._given_creep
        family = creep_from_relaxation(Relaxation(self.E_relaxed, self.E, self.rho, self.viscosity))
        return replace(family, weight=_frozen(family.weight), time=_frozen(family.time))

    @property
    def E_unrelaxed(self) -> float:
        """Instantaneous modulus in Pa; infinite when the instantaneous compliance is zero."""
        if self._given_creep is not None:
            unrelaxed = self._given_creep.unrelaxed
            return 1.0 / unrelaxed if unrelaxed > 0 else float("inf")
        return float("inf") if self.viscosity > 0 else self.E_relaxed + float(np.sum(self.E))

    @property
    def is_liquid(self) -> bool:
        """True when the material flows: E_relaxed is zero."""
        return self.E_relaxed == 0

    @property
    def fluidity(self) -> float:
        """Inverse of the zero-rate (elongational) viscosity in 1/(Pa s); 0 for a solid."""
        return self._creep.fluidity

    def creep_terms(self) -> tuple[Floats, Floats]:
        """Return the weights C (1/Pa) and retardation times τ (s), ascending.

        A solid creeps as J(t) = 1/E_relaxed − Σ C exp(−t/τ). A liquid (E_relaxed = 0) creeps as
        J(t) = 1/E_unrelaxed + Σ C (1 − exp(−t/τ)) + fluidity · t.
        """
        return self._creep.weight, self._creep.time

    def factor(self, mode: Mode) -> float:
        """Return the factor on the tensile modulus: shear 1/2(1+ν), contact 1/(1−ν²)."""
        factors = {"tension": 1.0, "shear": 0.5 / (1.0 + self.nu), "contact": 1.0 / (1.0 - self.nu**2)}
        if mode not in factors:
            raise InputError(f'mode "{mode}" is unknown; use one of {", ".join(factors)}')
        return factors[mode]

    def relaxation(self, t: ArrayLike, mode: Mode = "tension") -> Floats:
        """Return the relaxation modulus E(t) in Pa at the times t ≥ 0 (s), same shape.

        A dashpot in parallel adds an impulse at t = 0 only: infinite there, nothing later.
        """
        time = _positive("t", t, "s")
        terms = _sum_over_terms(self.E, self.rho, time, lambda x: np.exp(-x))
        value = self.E_relaxed + terms
        if self.viscosity > 0:
            value = np.where(time == 0, np.inf, value)
        return self.factor(mode) * value

    def creep(self, t: ArrayLike, mode: Mode = "tension") -> Floats:
        """Return the creep compliance J(t) in 1/Pa at the times t ≥ 0 (s), same shape."""
        time = _positive("t", t, "s")
        family = self._creep
        terms = _sum_over_terms(family.weight, family.time, time, lambda x: -np.expm1(-x))
        # A solid does not flow in an endless time either: no zero times infinity.
        flow = family.fluidity * time if family.fluidity > 0 else 0.0
        return (family.unrelaxed + terms + flow) / self.factor(mode)

    def complex_modulus(self, omega: ArrayLike, mode: Mode = "tension") -> Complexes:
        """Return E*(ω) = E′ + iE″ in Pa at the angular frequencies ω ≥ 0 (rad/s), same shape.

        Notes
        -----
        Thesis equation (1.42). Instruments report f in Hz: ω = 2πf.
        """
        frequency = _positive("omega", omega, "rad/s")
        with np.errstate(divide="ignore", over="ignore"):
            x = frequency[..., None] * self.rho
            share = 1.0 / (1.0 + np.minimum(x, 1.0 / x) ** 2)
            storage, loss = np.where(x > 1.0, share, x * x * share) @ self.E, (1.0 / (x + 1.0 / x)) @ self.E
        factor = self.factor(mode)
        # Joined by parts: complex arithmetic would turn an infinite part into NaN.
        value = np.empty(frequency.shape, dtype=complex)
        value.real = factor * (self.E_relaxed + storage)
        value.imag = factor * (loss + (self.viscosity * frequency if self.viscosity > 0 else 0.0))
        return value[()]

    def loss_factor(self, omega: ArrayLike) -> Floats:
        """Return tan δ = E″/E′ at the angular frequencies ω (rad/s)."""
        value = self.complex_modulus(omega)
        return np.asarray(value.imag / value.real)

    def shifted(self, a_T: float, b_T: float = 1.0) -> Prony:
        """Return the material at another temperature: E(ω, T) = b_T E(a_T ω, T_ref).

        Parameters
        ----------
        a_T : float
            Horizontal shift factor, positive; larger than 1 below the reference temperature.
            All times are multiplied by it.
        b_T : float
            Vertical shift factor, positive.

        Notes
        -----
        The thesis writes both ω/a (section 1.2, a rising with temperature) and a_T ω (2.35,
        3.15). The second is used everywhere here.
        """
        if not (np.isfinite(a_T) and a_T > 0):
            raise InputError(f"a_T = {a_T}: a shift factor is positive and finite")
        return self._changed(b_T, a_T)

    def scaled(self, factor: float) -> Prony:
        """Return the material with every modulus multiplied by ``factor`` > 0."""
        return self._changed(factor, 1.0)

    def _changed(self, stiffer: float, slower: float) -> Prony:
        """Return the material with all moduli and all times multiplied by a factor each."""
        if not (np.isfinite(stiffer) and stiffer > 0):
            raise InputError(f"factor = {stiffer}: a modulus can be scaled by a positive number only")
        terms = (self.E_relaxed * stiffer, self.E * stiffer, self.rho * slower, self.nu)
        creep = self._given_creep
        if creep is not None:
            flow = creep.fluidity / slower / stiffer
            creep = Retardation(creep.unrelaxed / stiffer, creep.weight / stiffer, creep.time * slower, flow)
        return Prony(*terms, self.viscosity * slower * stiffer, creep)

    def __eq__(self, other: object) -> bool:
        """Compare by value, term by term."""
        return isinstance(other, Prony) and self._key() == other._key()

    def __hash__(self) -> int:
        """Hash the values, so that equal materials share one cache entry."""
        return hash(self._key())

    def _key(self) -> tuple[object, ...]:
        creep = self._given_creep
        arrays = (self.E, self.rho) if creep is None else (self.E, self.rho, creep.weight, creep.time)
        return (self.E_relaxed, self.nu, self.viscosity, *(array.tobytes() for array in arrays))

    def __repr__(self) -> str:
        return f"Prony({self._caption})"

    def _repr_html_(self) -> str:
        rows = [(Quantity(E, 0.0, "Pa"), Quantity(rho, 0.0, "s")) for E, rho in zip(self.E, self.rho, strict=True)]
        return html_table(f"Prony series: {self._caption}", ("E", "rho"), rows)

    @property
    def _caption(self) -> str:
        n = self.rho.size
        relaxed, unrelaxed = (Quantity(E, 0.0, "Pa") for E in (self.E_relaxed, self.E_unrelaxed))
        ends = [str(Quantity(rho, 0.0, "s")) for rho in self.rho[[0, -1][: 2 * n]]]
        span = f" from {' to '.join(ends)}" if n else ""
        return f"E relaxed {relaxed}, unrelaxed {unrelaxed}, {n} term{'s' * (n != 1)}{span}, nu {self.nu:g}"

    def __reduce__(self) -> tuple[object, ...]:
        """Rebuild from the terms of both families, so that a copy is bit-identical."""
        return Prony, (self.E_relaxed, self.E, self.rho, self.nu, self.viscosity, self._given_creep)


def _sum_over_terms(weight: Floats, scale: Floats, argument: Floats, shape: Callable[[Floats], Floats]) -> Floats:
    """Return Σ weight · shape(argument/scale), one array of the argument's shape."""
    if weight.size == 0:
        return np.zeros(argument.shape)
    # A ratio beyond the range of the numbers has reached the limit of every shape.
    with np.errstate(over="ignore"):
        return np.asarray(shape(argument[..., None] / scale) @ weight)


def _frozen(values: Floats) -> Floats:
    """Return a read-only copy."""
    copy = np.array(values, dtype=float)
    copy.setflags(write=False)
    return copy


def _not_negative(name: str, value: float, units: str) -> None:
    """Refuse a negative or non-finite number."""
    if not (np.isfinite(value) and value >= 0):
        raise InputError(f"{name} = {value} {units}: expected a finite number, not negative")


def _checked_terms(
    weight_name: str, time_name: str, weight: ArrayLike, time: ArrayLike, constant: float
) -> tuple[Floats, Floats]:
    """Return merged ascending terms, or say which term is not admissible."""
    weights, times = np.asarray(weight, dtype=float), np.asarray(time, dtype=float)
    if weights.ndim != 1 or weights.shape != times.shape:
        raise InputError(
            f"{weight_name} has shape {weights.shape} and {time_name} {times.shape}: "
            "expected two lists of equal length, one weight and one time per term"
        )
    for name, values, good, wrong in (
        (
            weight_name,
            weights,
            np.isfinite(weights) & (weights >= 0),
            ": with a negative weight the material would return more work than was put in (not admissible); fit the "
            "terms with weights ≥ 0",
        ),
        (time_name, times, np.isfinite(times) & (times > 0), " s: expected a positive, finite time"),
    ):
        if not good.all():
            k = int(np.argmin(good))
            raise InputError(f"{name}[{k}] = {values[k]}{wrong}")
    floor = _NEGLIGIBLE * (constant + float(np.sum(weights)))
    return merged(np.where(weights > floor, weights, 0.0), times)


def _positive(name: str, values: ArrayLike, units: str) -> Floats:
    """Return times or frequencies as an array, refusing negative ones."""
    found = np.asarray(values, dtype=float)
    if (found < 0).any():
        raise InputError(f"{name} = {found.min()} {units}: the response is defined for {name} ≥ 0")
    return found

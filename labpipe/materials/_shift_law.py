r"""How the shift factors depend on temperature: WLF and Arrhenius, and their fit to a table.

Both laws give log10 a_T relative to a reference temperature, so that they are zero there:

- WLF: −C₁ (T − T_ref)/(C₂ + T − T_ref), kept here as −m ΔT/(1 + q ΔT) with the slope
  m = C₁/C₂ and the curvature q = 1/C₂, which stays regular where C₁ and C₂ run to infinity
  together;
- Arrhenius: E_a/(R ln 10) (1/T − 1/T_ref), T in kelvin: the WLF law with C₂ = T_ref and
  C₁ = E_a/(R ln 10 T_ref).

References
----------
Williams, Landel & Ferry, J. Am. Chem. Soc. 77 (1955) 3701, doi:10.1021/ja01619a008.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize
from scipy.constants import R

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.uncertainty import propagated_u
from labpipe.units import ZERO_CELSIUS

LawName = Literal["wlf", "arrhenius"]

#: Gas constant times ln 10, J/(mol K).
_GAS_LN10 = R * float(np.log(10.0))
HOLDS = 4.0  # chi-square per degree of freedom, or F of free shifts: twice the stated uncertainty on the whole


@dataclass(frozen=True, slots=True)
class ShiftLaw:
    """One law with its parameters, their covariance, and how well it holds.

    ``parameters`` are slope m (1/K) and curvature q (1/K) of a WLF law about ``T_ref`` [degC], the activation energy
    (J/mol) of Arrhenius' law. ``chi_square`` are the squared deviations of the free shifts over their covariance, with
    ``freedom`` degrees of freedom; a ratio far above one says that the law does not hold.
    """

    name: LawName
    T_ref: float
    parameters: tuple[float, ...]
    covariance: Floats
    chi_square: float = float("nan")
    freedom: int = 0

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> "ShiftLaw":
        """Read a law from a stored result, which keeps no covariance and None for a chi-square that it lacks."""
        parameters, chi_square = tuple(stored["parameters"]), stored.get("chi_square")
        chi_square = float("nan") if chi_square is None else chi_square
        unknown = np.zeros((len(parameters), len(parameters)))
        return cls(stored["name"], stored["T_ref"], parameters, unknown, chi_square, stored.get("freedom", 0))

    @property
    def holds(self) -> bool:
        """Whether it describes the free shifts within their uncertainty; without such shifts nothing contradicts it."""
        return not (self.freedom and self.chi_square / self.freedom > HOLDS)

    def about(self, T_ref: float) -> "ShiftLaw | None":
        """Return the same law about another reference temperature [degC]; None beyond the pole of a WLF law.

        Examples
        --------
        >>> moved = wlf(15.0, 250.0, 40.0).about(60.0)
        >>> round(moved.C1, 3), round(moved.C2, 3)
        (13.889, 270.0)
        """
        if self.name == "arrhenius":
            return replace(self, T_ref=T_ref)
        (m, q), step = self.parameters, T_ref - self.T_ref
        stretch = 1.0 + q * step
        if stretch <= 0.0:
            return None
        change = np.array([[stretch**-2, -2.0 * m * step * stretch**-3], [0.0, stretch**-2]])
        covariance = change @ self.covariance @ change.T
        return replace(self, T_ref=T_ref, parameters=(m / stretch**2, q / stretch), covariance=covariance)

    def log10_aT(self, temperature: ArrayLike) -> Floats:
        """Return log10 a_T at temperatures in °C.

        Raises
        ------
        InputError
            A temperature lies beyond the pole of the WLF law (at or below T_ref − C₂), or below
            absolute zero.
        """
        degrees = np.asarray(temperature, float)
        if np.any(degrees <= -ZERO_CELSIUS):
            raise InputError(f"{degrees.min()} °C lies below absolute zero")
        value = law_values(self.name, self.parameters, degrees, self.T_ref)
        if value is None:
            raise InputError(
                f"the {self.name} law about {self.T_ref:g} °C has no value at "
                f"{degrees} °C: its pole lies at {self.T_ref - self.C2:.1f} °C"
            )
        return value

    @property
    def C1(self) -> float:
        """WLF constant C₁ (1), of Arrhenius' law too; infinite for a straight line."""
        m, q = _slope_and_curvature(self.name, self.parameters, self.T_ref)
        return m / q if q != 0 else float("inf")

    @property
    def C2(self) -> float:
        """WLF constant C₂ in K; of Arrhenius' law the reference temperature in kelvin."""
        q = _slope_and_curvature(self.name, self.parameters, self.T_ref)[1]
        return 1.0 / q if q != 0 else float("inf")

    @property
    def u_C1(self) -> float:
        """Standard uncertainty of C₁ of a WLF law."""
        m, q = self.parameters
        return float(propagated_u(np.array([1.0 / q, -m / q**2]), self.covariance))

    @property
    def u_C2(self) -> float:
        """Standard uncertainty of C₂ of a WLF law in K."""
        return float(np.sqrt(self.covariance[1, 1])) * self.C2**2

    @property
    def activation_energy(self) -> float:
        """Activation energy in J/mol: of the Arrhenius law, or of the WLF law at T_ref."""
        m, _ = _slope_and_curvature(self.name, self.parameters, self.T_ref)
        return m * _GAS_LN10 * (self.T_ref + ZERO_CELSIUS) ** 2


def wlf(C1: float, C2: float, T_ref: float) -> ShiftLaw:
    """Return the WLF law with known constants about T_ref (°C).

    Examples
    --------
    >>> float(wlf(15.0, 250.0, 40.0).log10_aT(-40.0).round(4))
    7.0588
    """
    return ShiftLaw("wlf", T_ref, (C1 / C2, 1.0 / C2), np.zeros((2, 2)))


def arrhenius(activation_energy: float, T_ref: float) -> ShiftLaw:
    """Return the Arrhenius law with a known activation energy (J/mol) about T_ref (°C)."""
    return ShiftLaw("arrhenius", T_ref, (activation_energy,), np.zeros((1, 1)))


def _slope_and_curvature(
    name: LawName, parameters: tuple[float, ...] | Floats, T_ref: float
) -> tuple[float, float] | Floats:
    """Return m and q of a law."""
    if name == "wlf":
        return parameters[0], parameters[1]
    kelvin = T_ref + ZERO_CELSIUS
    return parameters[0] / (_GAS_LN10 * kelvin**2), 1.0 / kelvin


def law_values(
    name: LawName, parameters: tuple[float, ...] | Floats, temperature: Floats, T_ref: float
) -> Floats | None:
    """Return log10 a_T, or None where the WLF law has passed its pole."""
    m, q = _slope_and_curvature(name, parameters, T_ref)
    difference = temperature - T_ref
    stretch = 1.0 + q * difference
    return None if np.any(stretch <= 0) else np.asarray(-m * difference / stretch)


def law_slopes(name: LawName, parameters: tuple[float, ...] | Floats, temperature: Floats, T_ref: float) -> Floats:
    """Return the derivatives of log10 a_T, last axis over the parameters."""
    m, q = _slope_and_curvature(name, parameters, T_ref)
    share = (temperature - T_ref) / (1.0 + q * (temperature - T_ref))
    if name == "arrhenius":
        return np.asarray(-share[..., None] / (_GAS_LN10 * (T_ref + ZERO_CELSIUS) ** 2))
    return np.stack([-share, m * share**2], axis=-1)


def shift_at(law: ShiftLaw, temperature: Floats, log10_aT: Floats, where: float) -> float:
    """Return log10 a_T at any temperature: the law, and the deviation of the shifts there.

    Parameters
    ----------
    law : ShiftLaw
        Through the shifts.
    temperature : array (isotherm,) [degC]
        In any order; NaN shifts are left out.
    log10_aT : array (isotherm,)
        Relative to the law's reference temperature.
    where : float [degC]
        Between isotherms the deviation is interpolated, beyond them it stays that of the last.

    Raises
    ------
    InputError
        There is one isotherm only, or the law has no value there.

    Examples
    --------
    >>> law = ShiftLaw("arrhenius", 20.0, (0.0,), np.zeros((1, 1)))
    >>> shift_at(law, np.array([0.0, 20.0]), np.array([2.0, 0.0]), 10.0)
    1.0
    """
    known = np.isfinite(log10_aT)
    if where != law.T_ref and np.unique(temperature[known]).size < 2:
        raise InputError(
            f"one isotherm cannot be shifted to {where:g} °C; take the material at "
            f"{law.T_ref:g} °C, where it was measured, or measure more temperatures"
        )
    deviation = log10_aT[known] - law.log10_aT(temperature[known])
    # The law and the shifts are both zero at the reference, wherever it lies.
    at, first = np.unique(np.append(law.T_ref, temperature[known]), return_index=True)
    knots = np.append(0.0, deviation)[first]
    return float(law.log10_aT(where)) + float(np.interp(where, at, knots))


def fit_law(name: LawName, temperature: Floats, log10_aT: Floats, covariance: Floats, T_ref: float) -> ShiftLaw:
    """Fit a law to free shifts by generalised least squares.

    ``covariance`` (isotherm, isotherm) is that of ``log10_aT`` (isotherm,), relative to ``T_ref``, and may be singular,
    for the reference shift is exact. The parameters never put the WLF pole among the temperatures.
    """
    # Rows that whiten the residuals; an exact reference shift carries no information.
    size, vectors = np.linalg.eigh(covariance)
    known = size > 1e-12 * max(float(size[-1]), 0.0)
    whitened = (vectors[:, known] / np.sqrt(size[known])).T

    def residuals(parameters: Floats) -> Floats:
        value = law_values(name, parameters, temperature, T_ref)
        return np.full(whitened.shape[0], 1e12) if value is None else whitened @ (log10_aT - value)

    def slopes(parameters: Floats) -> Floats:
        return np.asarray(-whitened @ law_slopes(name, parameters, temperature, T_ref))

    # A start inside the domain: a + a q ΔT + m ΔT = 0 is linear in (q, m), else a straight line.
    difference = temperature - T_ref
    q, m = np.linalg.lstsq(np.column_stack([difference * log10_aT, difference]), -log10_aT, rcond=None)[0]
    if name == "arrhenius" or np.any(1.0 + q * difference <= 0.05):
        q, m = 0.0, -float(difference @ log10_aT / (difference @ difference))
    first = np.array([m, q]) if name == "wlf" else np.array([m * _GAS_LN10 * (T_ref + ZERO_CELSIUS) ** 2])
    exact = 1e-14
    found = optimize.least_squares(residuals, first, slopes, x_scale="jac", ftol=exact, xtol=exact, gtol=exact)
    spread = np.asarray(np.linalg.pinv(found.jac.T @ found.jac, hermitian=True))
    freedom = max(int(known.sum()) - found.x.size, 0)
    return ShiftLaw(name, T_ref, tuple(float(p) for p in found.x), spread, 2.0 * float(found.cost), freedom)

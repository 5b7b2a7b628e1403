"""The outer parameters of a joint fit: shifts, vertical law, delay, and the state that they make.

Horizontal: one free number per isotherm but the reference, a WLF or Arrhenius law, or fixed.
Vertical: a law with at most two numbers, since one number per isotherm could imitate half of the
horizontal shifts. Delay: one number, a pure time in the instrument's phase.

Laws are zero at the temperature of the reference isotherm, the middle one of the sweeps. The reference
temperature that a user asks for plays no part in a fit (:mod:`._reference`), so that neither shifts
nor uncertainties nor the choice of laws depend on it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials._shift_law import fit_law, law_slopes, law_values
from labpipe.units import ZERO_CELSIUS

Horizontal = Literal["free", "wlf", "arrhenius", "fixed"]
Vertical = Literal["none", "rho_T", "linear", "quadratic"]

#: Every vertical law and its number of parameters, simplest first: b = 1; b = T/T0 in kelvin, the
#: entropic elasticity of a rubber; b = 1 + β ΔT; b = 1 + β ΔT + γ ΔT², ΔT per 100 K.
VERTICAL_SIZE: dict[Vertical, int] = {"none": 0, "rho_T": 0, "linear": 1, "quadratic": 2}
_UNIT, _LEAST_FACTOR = 100.0, 0.02
#: Storage modulus [Pa] above which no reading is of a rubber or a melt: there nothing stiffens as T does.
GLASS = 3e8
# Fastest fall of ln b per kelvin of a material (a glass softens by at most 0.6 % per kelvin), and what is
# left to a sweep's own error.
_STEEPEST_FALL, _SLACK = 0.006, 0.1
#: Standard deviation of the slope of ln b (per kelvin) about a law without numbers: stiff plastics soften by
#: 0.02 to 0.1 % per kelvin in addition to their relaxations; densities fall by 0.03 to 0.1 %.
SLOPE_SPREAD = 5e-4
_DENSITY_SLOPE = -3e-4  # expected in addition to b ∝ T
#: Steps of polymers: 0.03 to 0.3 decades per kelvin, hardly known beforehand.
STEP_PER_KELVIN, STEP_SPREAD, STEP_SPREAD_PER_KELVIN = 0.08, 0.5, 0.12
#: The step per isotherm changes from one to the next by this much (decades), plus this share.
CHANGE, CHANGE_SHARE = 0.4, 0.5
#: Closer isotherms than this (K) are repeats, and the same temperature set and measured.
LEAST_SPACING = 1.0


@dataclass(frozen=True, slots=True)
class State:
    """Parameters (horizontal, vertical, delay), and the factors that they make.

    ``log10_aT``, ``ln_bT`` (isotherm,); ``delay`` [s].
    """

    parameters: Floats
    log10_aT: Floats
    ln_bT: Floats
    delay: float


def expected_shifts(temperature: Floats, log10_aT: Floats) -> tuple[Floats, Floats]:
    """Return prior knowledge of shifts: a weak quadratic pull, rows @ log10_aT − target, around the present ones.

    Steps are those of polymers (within a factor of several), and they change gradually with temperature (within about
    half). Where the data say nothing, as in a stiff glass, the pull leaves a shift on the continuation of its
    neighbours with an uncertainty of about a decade; where they determine it, it is without effect.
    """
    order = np.argsort(temperature, kind="stable")
    count = temperature.size
    spacing = np.maximum(np.diff(temperature[order]), LEAST_SPACING)
    first = np.zeros((count - 1, count))
    at = np.arange(count - 1)
    first[at, order[:-1]], first[at, order[1:]] = 1.0, -1.0
    spread = STEP_SPREAD + STEP_SPREAD_PER_KELVIN * spacing
    # Second differences of the slope, times the mean spacing: decades per step again.
    slope = first / spacing[:, None]
    mean = 0.5 * (spacing[1:] + spacing[:-1])
    second = (slope[:-1] - slope[1:]) * mean[:, None]
    size = np.abs(slope @ log10_aT)
    change = CHANGE + CHANGE_SHARE * np.minimum(size[:-1], size[1:]) * mean
    rows = np.vstack([first / spread[:, None], second / change[:, None]])
    return rows, np.concatenate([STEP_PER_KELVIN * spacing / spread, np.zeros(mean.size)])


@dataclass(frozen=True)
class OuterModel:
    """The laws of a fit over its isotherms.

    ``temperature`` (isotherm,) [degC]; ``reference``: the isotherm where all laws are zero; ``given`` (isotherm,):
    the shifts of a fixed model, the start of the others; ``delay_unit`` [s]: one radian at the highest frequency;
    ``slope_spread`` [1/K]: standard deviation of a slope of ln b about a vertical law that has no numbers; 0 allows
    none; ``expectation``: weak pull on free shifts.
    """

    temperature: Floats
    reference: int
    given: Floats
    delay_unit: float
    horizontal: Horizontal = "free"
    vertical: Vertical = "none"
    has_delay: bool = False
    slope_spread: float = 0.0
    expectation: tuple[Floats, Floats] | None = None

    @property
    def T0(self) -> float:
        """Temperature of the reference isotherm [degC]."""
        return float(self.temperature[self.reference])

    @cached_property
    def horizontal_size(self) -> int:
        """Number of horizontal parameters."""
        return {"free": self.temperature.size - 1, "wlf": 2, "arrhenius": 1, "fixed": 0}[self.horizontal]

    @property
    def has_slope(self) -> bool:
        """True where the vertical law has a slope about it."""
        return self.slope_spread > 0 and not VERTICAL_SIZE[self.vertical]

    @cached_property
    def law_size(self) -> int:
        """Number of parameters that are not held back by an expectation of zero."""
        return self.horizontal_size + VERTICAL_SIZE[self.vertical] + int(self.has_delay)

    @cached_property
    def size(self) -> int:
        """Number of outer parameters."""
        return self.law_size + int(self.has_slope)

    def law_of_b(self, parameters: Floats, at: Floats) -> tuple[Floats, Floats] | None:
        """Return ln b of the vertical law at temperatures, with its derivatives (temperature, parameter).

        None where the law would turn negative.
        """
        n, step = self.horizontal_size, at - self.T0
        rows, count = np.zeros((at.size, self.size)), VERTICAL_SIZE[self.vertical]
        value = np.zeros(at.size)
        if self.vertical == "rho_T":
            value = np.log((at + ZERO_CELSIUS) / (self.T0 + ZERO_CELSIUS))
        if self.has_slope:
            rows[:, n] = self.slope_spread * step
            value = value + rows[:, n] * parameters[n]
        elif count:
            powers = (step[:, None] / _UNIT) ** np.arange(1, count + 1)
            factor = 1.0 + powers @ parameters[n : n + count]
            if np.any(factor < _LEAST_FACTOR):
                return None
            value, rows[:, n : n + count] = np.log(factor), powers / factor[:, None]
        return np.asarray(value), rows

    def start(self, state: State | None = None) -> State:
        """Return the state of this model nearest to another model's state (default: given)."""
        n, found = self.horizontal_size, np.zeros(self.size)
        shifts = self.given if state is None else state.log10_aT
        from_reference = shifts - shifts[self.reference]
        if self.horizontal == "free":
            found[:n] = np.delete(from_reference, self.reference)
        elif self.horizontal != "fixed":
            found[:n] = fit_law(
                self.horizontal, self.temperature, from_reference, np.eye(shifts.size), self.T0
            ).parameters
        started = self.state(found)
        if started is None:
            raise ValueError("the first estimate of a shift law lies outside its domain")
        if state is None:
            return started
        # ln b is nearly linear in its parameters; a slope starts within twice its spread.
        vertical = self.directions(started)[1]
        found[n:] = np.linalg.lstsq(vertical[:, n:], state.ln_bT - started.ln_bT, rcond=None)[0]
        if self.has_slope:
            found[n] = np.clip(found[n], -2.0, 2.0)
        if self.has_delay:
            found[-1] = state.delay / self.delay_unit
        return self.state(found) or started

    def state(self, parameters: Floats) -> State | None:
        """Return the state of a set of parameters, None outside the domain of a law."""
        head = parameters[: self.horizontal_size]
        shifts: Floats | None = self.given
        if self.horizontal == "free":
            shifts = np.insert(head, self.reference, 0.0)
        elif self.horizontal != "fixed":
            shifts = law_values(self.horizontal, head, self.temperature, self.T0)
        law = self.law_of_b(parameters, self.temperature)
        if shifts is None or law is None:
            return None
        delay = float(parameters[-1]) * self.delay_unit if self.has_delay else 0.0
        return State(parameters, shifts, law[0], delay)

    def directions(self, state: State) -> tuple[Floats, Floats, Floats]:
        """Return the changes of log10 a (isotherm, p), ln b (isotherm, p) and delay (p,)."""
        count, n = self.temperature.size, self.horizontal_size
        shift, delay = np.zeros((count, self.size)), np.zeros(self.size)
        if self.horizontal == "free":
            shift[:, :n] = np.delete(np.eye(count), self.reference, axis=1)
        elif self.horizontal != "fixed":
            shift[:, :n] = law_slopes(self.horizontal, state.parameters[:n], self.temperature, self.T0)
        law = self.law_of_b(state.parameters, self.temperature)
        vertical = np.zeros((count, self.size)) if law is None else law[1]
        if self.has_delay:
            delay[-1] = self.delay_unit
        return shift, vertical, delay

    @cached_property
    def _expected(self) -> tuple[Floats, Floats]:
        """Rows and targets (row,) of the expectations of shifts and slope, with unit variance."""
        n, place = self.horizontal_size, np.eye(self.size)
        rows, targets = [np.empty((0, self.size))], [np.empty(0)]
        if self.has_slope:
            rows.append(place[[n]])
            targets.append(np.array([_DENSITY_SLOPE / self.slope_spread if self.vertical == "rho_T" else 0.0]))
        if self.expectation is not None and self.horizontal == "free":
            known, target = self.expectation
            rows.append(np.delete(known, self.reference, axis=1) @ place[:n])
            targets.append(target)
        return np.vstack(rows), np.concatenate(targets)

    def pull(self, state: State) -> tuple[Floats, Floats]:
        """Return the contribution of the expectations to the normal matrix and the gradient."""
        rows, target = self._expected
        return rows.T @ rows, -rows.T @ (rows @ state.parameters - target)

    def pull_cost(self, state: State) -> float:
        """Return the cost of :meth:`pull` alone, which every trial step asks for."""
        rows, target = self._expected
        return float(np.sum((rows @ state.parameters - target) ** 2))


def is_physical(ln_bT: Floats, temperature: Floats, T0: float, stiffness: float = 0.0) -> bool:
    """Tell if vertical factors stay within the range of the modulus of a material.

    ``stiffness`` is the least storage modulus (Pa) of its sweeps. A factor beyond is no vertical shift: it makes
    up for sweeps that do not superpose.
    """
    step = temperature - T0
    rise = 0.0 if stiffness > GLASS else np.log((temperature + ZERO_CELSIUS) / (T0 + ZERO_CELSIUS))
    highest = np.where(step > 0, rise, -_STEEPEST_FALL * step) + _SLACK
    lowest = np.where(step > 0, -_STEEPEST_FALL * step, rise) - _SLACK
    return bool(np.all((ln_bT <= highest) & (ln_bT >= lowest)))

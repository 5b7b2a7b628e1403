"""The outer parameters of a joint fit: shifts, vertical law, delay, and their effect on a state.

Horizontal: one free number per isotherm but the reference, a WLF or Arrhenius law, or fixed.
Vertical: always a law with at most two numbers; one number per isotherm would be able to imitate
half of the horizontal shifts. Delay: one number, a pure time in the instrument's phase.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials._shift_law import fit_law, law_slopes, law_values
from labpipe.materials.superposition._vertical_law import (
    VERTICAL_SIZE,
    Vertical,
    fit_vertical,
    vertical_slopes,
    vertical_values,
)

Horizontal = Literal["free", "wlf", "arrhenius", "fixed"]

#: Steps of polymers: 0.03 to 0.3 decades per kelvin, hardly known beforehand.
STEP_PER_KELVIN, STEP_SPREAD, STEP_SPREAD_PER_KELVIN = 0.08, 0.5, 0.12
#: The step per isotherm changes from one to the next by this much (decades), plus this share.
CHANGE, CHANGE_SHARE = 0.4, 0.5
#: Standard deviation of the slope of ln b_T (per kelvin) about a law without numbers: no modulus is
#: the same at all temperatures. Stiff plastics soften by 0.02 to 0.1 % per kelvin beside their
#: relaxations; densities fall by 0.03 to 0.1 %.
SLOPE_SPREAD = 5e-4
# Slope to be expected beside b ∝ T, between constant density and that of most melts.
_DENSITY_SLOPE = -3e-4
# What a start takes over of a level or a slope, in its standard deviations.
_MOST_SPREADS = 2.0
#: Closer isotherms than this (K) are repeats; their spacing is not resolved.
LEAST_SPACING = 1.0


@dataclass(frozen=True, slots=True)
class State:
    """Where the outer iteration stands.

    ``parameters`` (parameter,): Horizontal, then vertical, then delay. ``log10_aT``, ``ln_bT`` (isotherm,). ``delay``
    [s].
    """

    parameters: Floats
    log10_aT: Floats
    ln_bT: Floats
    delay: float


@dataclass(frozen=True, slots=True)
class Expectation:
    """What is known about shifts before the data: a weak quadratic pull, rows @ log10_aT − target.

    Steps are those of polymers (within a factor of several), and they change gradually with
    temperature (within about half). Where the data determine a shift to 0.03 decades the pull is
    below a thousandth of that; where they say nothing, as in a stiff glass, it leaves the shift
    on the continuation of its neighbours with an uncertainty of about a decade.
    """

    rows: Floats
    target: Floats

    def cost(self, log10_aT: Floats) -> float:
        """Return the squared deviation in units of the expectation's own spread."""
        return float(np.sum((self.rows @ log10_aT - self.target) ** 2))


def expected_shifts(temperature: Floats, log10_aT: Floats) -> Expectation:
    """Return the weak expectation around the present shifts, for free shifts only."""
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
    return Expectation(
        rows=np.vstack([first / spread[:, None], second / change[:, None]]),
        target=np.concatenate([STEP_PER_KELVIN * spacing / spread, np.zeros(mean.size)]),
    )


@dataclass(frozen=True, slots=True)
class OuterModel:
    """Which laws hold, over which isotherms.

    ``temperature`` (isotherm,) [degC]; ``T_ref`` [degC]: where the laws are zero; ``reference``: the isotherm whose
    free shift is zero; ``given`` (isotherm,): the shifts of a fixed model; the start of the others; ``delay_unit`` [s]:
    unit of the delay parameter: one radian at the highest frequency; ``horizontal``, ``vertical``, ``has_delay``: which
    parameters there are; ``level_spread``: standard deviation (relative) of a level of its own per isotherm about the
    vertical law, as a sample that is clamped or tempered anew shows; 0 allows none; ``slope_spread`` [1/K]: standard
    deviation of a slope of ln b about a vertical law that has no numbers; 0 allows none; ``expectation``: weak pull on
    free shifts.
    """

    temperature: Floats
    T_ref: float
    reference: int
    given: Floats
    delay_unit: float
    horizontal: Horizontal = "free"
    vertical: Vertical = "none"
    has_delay: bool = False
    level_spread: float = 0.0
    slope_spread: float = 0.0
    expectation: Expectation | None = None

    @property
    def horizontal_size(self) -> int:
        """Number of horizontal parameters."""
        sizes = {"free": self.temperature.size - 1, "wlf": 2, "arrhenius": 1, "fixed": 0}
        return sizes[self.horizontal]

    @property
    def size(self) -> int:
        """Number of outer parameters."""
        return self.horizontal_size + self.vertical_size + int(self.has_delay)

    @property
    def vertical_size(self) -> int:
        """Number of vertical parameters, levels included."""
        levels = self.temperature.size if self.level_spread > 0 else 0
        return VERTICAL_SIZE[self.vertical] + int(self.has_slope) + levels

    @property
    def has_slope(self) -> bool:
        """Whether the vertical law has a slope about it."""
        return self.slope_spread > 0 and not VERTICAL_SIZE[self.vertical]

    @property
    def expected_slope(self) -> float:
        """The slope parameter that is expected, in its standard deviations."""
        return _DENSITY_SLOPE / self.slope_spread if self.vertical == "rho_T" else 0.0

    @property
    def law_size(self) -> int:
        """Number of parameters that are not held back by an expectation of zero."""
        levels = self.temperature.size if self.level_spread > 0 else 0
        return self.size - levels - int(self.has_slope)

    @property
    def level_slice(self) -> slice:
        """Where the levels stand among the parameters."""
        first = self.horizontal_size + VERTICAL_SIZE[self.vertical] + int(self.has_slope)
        return slice(first, first + (self.temperature.size if self.level_spread > 0 else 0))

    def levels(self, parameters: Floats) -> Floats:
        """Return ln of the level of every isotherm about the vertical law; zero without."""
        found = parameters[self.level_slice]
        return found if found.size else np.zeros(self.temperature.size)

    def start(self, state: State | None = None) -> State:
        """Return the state of this model nearest to another model's state (default: given)."""
        shifts = self.given if state is None else state.log10_aT
        ln_bT = np.zeros(shifts.size) if state is None else state.ln_bT
        delay = 0.0 if state is None else state.delay
        frame = (self.temperature, self.T_ref)
        vertical = fit_vertical(self.vertical, ln_bT, *frame)
        law = vertical_values(self.vertical, vertical, *frame)
        if law is None:
            vertical = np.zeros(vertical.size)
            law = np.zeros(shifts.size)
        if self.has_slope:
            warmer = self.temperature - self.T_ref
            slope = float((ln_bT - law) @ warmer / max(float(warmer @ warmer), 1.0)) / self.slope_spread
            vertical = np.array([np.clip(slope, -_MOST_SPREADS, _MOST_SPREADS)])
            law = law + vertical[0] * self.slope_spread * warmer
        if self.level_spread > 0:
            # What the law leaves, shrunk into the spread that levels may have.
            limit = _MOST_SPREADS * self.level_spread
            vertical = np.concatenate([vertical, np.clip(ln_bT - law, -limit, limit)])
        tail = [delay / self.delay_unit] if self.has_delay else []
        head = self._horizontal_from(shifts)
        started = self.state(np.concatenate([head, vertical, tail]))
        if started is None:
            raise ValueError("the first estimate of a shift law lies outside its domain")
        return started

    def state(self, parameters: Floats) -> State | None:
        """Return the state of a set of parameters, None outside the domain of a law."""
        head, vertical, tail = np.split(parameters, [self.horizontal_size, self.size - int(self.has_delay)])
        shifts = self._shifts(head)
        if shifts is None:
            return None
        numbers = vertical[: VERTICAL_SIZE[self.vertical]]
        law = vertical_values(self.vertical, numbers, self.temperature, self.T_ref)
        if law is None:
            return None
        ln_bT = law + self.levels(parameters)
        if self.has_slope:
            ln_bT = ln_bT + vertical[0] * self.slope_spread * (self.temperature - self.T_ref)
        delay = float(tail[0]) * self.delay_unit if self.has_delay else 0.0
        return State(parameters, shifts, ln_bT, delay)

    def pull(self, state: State) -> tuple[Floats, Floats]:
        """Return what the expectations add to the normal matrix and the gradient."""
        normal, gradient = np.zeros((self.size, self.size)), np.zeros(self.size)
        if self.expectation is not None and self.horizontal == "free":
            known = self.expectation
            rows = known.rows @ self.directions(state)[0]
            normal += rows.T @ rows
            gradient -= rows.T @ (known.rows @ state.log10_aT - known.target)
        if self.level_spread > 0:
            at = np.arange(self.size)[self.level_slice]
            levels = state.parameters[at]
            normal[at, at] += 1.0 / self.level_spread**2
            gradient[at] -= levels / self.level_spread**2
        if self.has_slope:
            at_slope = self.horizontal_size
            normal[at_slope, at_slope] += 1.0
            gradient[at_slope] -= state.parameters[at_slope] - self.expected_slope
        return normal, gradient

    def pull_cost(self, state: State) -> float:
        """Return the cost of :meth:`pull` alone, which every trial step asks for."""
        cost = 0.0
        if self.expectation is not None and self.horizontal == "free":
            cost += self.expectation.cost(state.log10_aT)
        if self.level_spread > 0:
            levels = state.parameters[self.level_slice]
            cost += float(np.sum((levels / self.level_spread) ** 2))
        if self.has_slope:
            cost += float((state.parameters[self.horizontal_size] - self.expected_slope) ** 2)
        return cost

    def directions(self, state: State) -> tuple[Floats, Floats, Floats]:
        """Return the changes of log10 a (isotherm, p), ln b (isotherm, p) and delay (p,)."""
        count, n = self.temperature.size, self.horizontal_size
        shift, vertical = np.zeros((count, self.size)), np.zeros((count, self.size))
        delay = np.zeros(self.size)
        if self.horizontal == "free":
            shift[:, :n] = np.delete(np.eye(count), self.reference, axis=1)
        elif self.horizontal != "fixed":
            head = state.parameters[:n]
            shift[:, :n] = law_slopes(self.horizontal, head, self.temperature, self.T_ref)
        at = self.level_slice
        if self.has_slope:
            vertical[:, n] = self.slope_spread * (self.temperature - self.T_ref)
        else:
            numbers = state.parameters[n : at.start]
            vertical[:, n : at.start] = vertical_slopes(self.vertical, numbers, self.temperature, self.T_ref)
        if self.level_spread > 0:
            vertical[:, at] = np.eye(count)
        if self.has_delay:
            delay[-1] = self.delay_unit
        return shift, vertical, delay

    def _shifts(self, head: Floats) -> Floats | None:
        if self.horizontal == "fixed":
            return self.given
        if self.horizontal == "free":
            return np.insert(head, self.reference, 0.0)
        return law_values(self.horizontal, head, self.temperature, self.T_ref)

    def _horizontal_from(self, shifts: Floats) -> Floats:
        if self.horizontal == "fixed":
            return np.empty(0)
        if self.horizontal == "free":
            return np.delete(shifts - shifts[self.reference], self.reference)
        anchored = shifts - np.interp(self.T_ref, *self._ascending(shifts))
        law = fit_law(self.horizontal, self.temperature, anchored, np.eye(shifts.size), self.T_ref)
        return np.array(law.parameters)

    def _ascending(self, shifts: Floats) -> tuple[Floats, Floats]:
        order = np.argsort(self.temperature)
        return self.temperature[order], shifts[order]

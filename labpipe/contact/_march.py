"""Integrate a viscoelastic contact over a history of displacement or load, with error control.

The history is linear between its samples; two samples at one time are a jump. Inside an interval
the springs' load is taken linear in every step, the memory update is then exact for any step length
(:mod:`labpipe.contact._memory`), and what is left is the curvature of the load in time. It is
controlled by doing every step once whole and once in two halves (see ``March._pair``): the halves
are kept, the difference must stay below a share of the force. It is of third order and what all
steps leave of second, so that the share goes with the power 3/2 of ``rtol``. Steps shrink to the fastest
relaxation after a jump and grow over the decades of a hold; a process much faster than the step
answers as plain compliance.

With ``rtol=None`` every interval is one step. Of a term much faster than the step, a load linear in the step
answers only with the mean of its ramp: after a jump the next step then overshoots with the opposite sign.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep, StepWeights, advance, history, step_weights
from labpipe.contact._springs import Answer, NotNestedError, SpringBed
from labpipe.errors import InputError

Control = Literal["displacement", "force"]

# Difference allowed in a step over rtol^(3/2): the returned error is 0.03 to 0.24 of the power 2/3
# of the difference, measured on ramps, holds, oscillations and tapping of four materials.
_STEP_SHARE = 8.0
# Third-order local error: the factor on the step that would just meet the tolerance, with a margin.
_ORDER, _MARGIN = 1.0 / 3.0, 0.85
_SHRINK, _GROW = 0.1, 4.0
# Steps ten times shorter each that may look like a contact that is not nested.
_UNNESTED_STEPS = 8
_MAX_STEPS_PER_INTERVAL = 20_000


@dataclass(frozen=True, slots=True)
class State:
    """Loads and memory of the springs, and the energies since the start.

    ``work`` is the work of the indenter on the springs (trapezoids over the steps), and ``dissipated``
    the heat of the Kelvin elements, exact for the load path taken; both per unit depth for a line,
    NaN if not asked for.
    """

    answer: Answer
    memory: Floats
    work: float
    dissipated: float


@dataclass(slots=True)
class March:
    """One contact, one material, one history.

    Attributes
    ----------
    contact : SpringBed
        The springs.
    creep : Creep
        Contact creep compliance.
    control : {"displacement", "force"}
        The quantity that the history prescribes.
    rtol : float or None
        Error of force or approach over their largest values; None for one step per interval.
    has_energy : bool
        Keep account of work and heat.
    """

    contact: SpringBed
    creep: Creep
    control: Control
    rtol: float | None
    has_energy: bool = False
    counts: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(("solver_steps", "rejected_steps", "solves"), 0)
    )
    samples_done: int = 0
    _weights: dict[float, StepWeights] = field(default_factory=dict)
    _scale: float = 0.0
    _softest: float = np.nan
    _highest: float = -np.inf
    _deepest: float = 1e-300

    def run(self, time: Floats, value: Floats) -> Iterator[State]:
        """Yield the state at every sample of the history.

        ``time`` (time,) [s]: never falling; ``value`` (time,) [m or N]: displacement, or force per tip (and unit
        depth). A step control that does not get through an interval raises InputError.
        """
        self._softest = float(self.creep.compliance(float(time[-1] - time[0])))
        # A time below every relaxation time: a bound on the trace of the rates.
        fastest = np.inf
        if self.creep.rate.size:
            flow = float(np.sum(self.creep.C / self.creep.tau)) + self.creep.fluidity
            fastest = 1.0 / (float(self.creep.rate.max()) + flow / self.creep.instantaneous)
        start = float(value[0]) if self.control == "displacement" else 0.0
        answer = Answer(np.zeros(self.contact.size), 0.0, min(start, 0.0), 0.0)
        zero = 0.0 if self.has_energy else np.nan
        state = self._jump(State(answer, self.creep.rest(self.contact.size), zero, zero), float(value[0]))
        self.samples_done = 1
        yield state
        suggested = fastest
        for n in range(1, time.size):
            length = float(time[n] - time[n - 1])
            before, after = float(value[n - 1]), float(value[n])
            self._raise_scale(after)
            if length == 0.0:
                if after != before:
                    state, suggested = self._jump(state, after), fastest
            elif self.rtol is None or self.creep.rate.size == 0:
                state = self._single(state, length, after)
            else:
                state, suggested = self._controlled(state, length, before, after, suggested)
            self.samples_done = n + 1
            yield state

    def stored(self, state: State) -> float:
        """Energy held elastically in all springs (per unit depth for a line)."""
        inner, load = self.contact.inner, state.answer.load
        kelvin = float(inner(state.memory, state.memory) @ self.creep.inverse)
        return 0.5 * self.creep.instantaneous * float(inner(load, load)) + 0.5 * kelvin

    def _jump(self, state: State, value: float) -> State:
        """Move in no time: every Kelvin element keeps its length."""
        self._raise_scale(value)
        past = state.memory.sum(axis=0)
        answer = self._solve(past, self.creep.instantaneous, value, state.answer)
        self.counts["solver_steps"] += 1
        work = self._work(state, answer, state.memory) if self.has_energy else np.nan
        return State(answer, state.memory, state.work + work, state.dissipated)

    def _single(self, state: State, length: float, value: float) -> State:
        """Cross one interval in one step."""
        weights = self._weights_of(length)
        past = history(weights, state.memory, state.answer.load)
        self.counts["solver_steps"] += 1
        return self._accept(weights, state, self._solve(past, weights.compliance, value, state.answer))

    def _controlled(
        self, state: State, length: float, before: float, after: float, suggested: float
    ) -> tuple[State, float]:
        """Cross one interval in steps that meet the tolerance."""
        elapsed, step, unnested = 0.0, min(suggested, length), 0
        slope = (after - before) / length
        for _ in range(_MAX_STEPS_PER_INTERVAL):
            left = length - elapsed
            is_last = left <= 1.001 * step  # no sliver is left
            dt = left if is_last else step
            middle_value = before + slope * (elapsed + 0.5 * dt)
            end_value = after if is_last else before + slope * (elapsed + dt)
            try:
                middle, end, error = self._pair(state, dt, middle_value, end_value)
                unnested = 0
            except NotNestedError:
                # A step that is too long rings and looks like it; a profile that is not nested
                # stays so in any step.
                error, unnested = np.inf, unnested + 1
                if unnested > _UNNESTED_STEPS:
                    raise
            factor = _MARGIN * min(max(error, 1e-12), 1e12) ** -_ORDER
            if error > 1.0:
                self.counts["rejected_steps"] += 1
                step = dt * min(max(factor, _SHRINK), _MARGIN)
                continue
            self.counts["solver_steps"] += 2
            half = self._weights_of(0.5 * dt)
            state = self._accept(half, self._accept(half, state, middle), end)
            # A step cut short by the end of the interval says nothing against the longer one.
            step = max(dt * min(max(factor, _SHRINK), _GROW), step if is_last else 0.0)
            if is_last:
                return state, step
            elapsed += dt
        raise InputError(
            f"the step control took more than {_MAX_STEPS_PER_INTERVAL} steps between two samples "
            f"{length} s apart; give a larger rtol or more samples"
        )

    def _pair(self, state: State, dt: float, middle_value: float, end_value: float) -> tuple[Answer, Answer, float]:
        """Solve one step whole and in two halves; return the middle, the end and the error.

        Halves of linear load alone never forget an error made while the force was much larger:
        they ring. Blending the second half with the whole step, 2:1, is the analogue of TR-BDF2
        for an exact memory: second order, and what rings is damped out in one step. It is the same
        as a load that is linear in each half through the middle value returned here. The error is the
        difference of the two solutions in units of the tolerance: springs that leave the contact carry no load in
        either, but differ in how far they have crept, which counts as a load under slow loading.
        """
        start = state.answer
        one, half = self._weights_of(dt), self._weights_of(0.5 * dt)
        past_whole = history(one, state.memory, start.load)
        whole = self._solve(past_whole, one.compliance, end_value, start)
        past_half = history(half, state.memory, start.load)
        middle = self._solve(past_half, half.compliance, middle_value, start)
        memory = advance(half, state.memory, start.load, middle.load)
        past_end = (past_whole + 2.0 * history(half, memory, middle.load)) / 3.0
        compliance = (one.compliance + 2.0 * half.compliance) / 3.0
        end = self._solve(past_end, compliance, end_value, middle)
        path = (start.load + 4.0 * middle.load + end.load) / 6.0
        rigid = self.creep.instantaneous
        crept = past_end + (compliance - rigid) * end.load
        crept = crept - past_whole - (one.compliance - rigid) * whole.load
        difference = np.abs(whole.load - end.load) + np.abs(crept) / self._softest
        error = float(self.contact.stiffness @ difference) / max(end.force, self._scale, 1e-300)
        if self.control == "force":
            # Against the deepest approach: without load the surface recovers towards none.
            self._deepest = max(self._deepest, end.displacement)
            error = max(error, abs(whole.displacement - end.displacement) / self._deepest)
        return middle._replace(load=path), end, error / (_STEP_SHARE * (self.rtol or 1.0) ** 1.5)

    def _solve(self, past: Floats, compliance: float, value: float, before: Answer) -> Answer:
        self.counts["solves"] += 1
        solve = self.contact.press if self.control == "displacement" else self.contact.push
        return solve(past, compliance, value, before.displacement)

    def _accept(self, weights: StepWeights, state: State, answer: Answer) -> State:
        memory = advance(weights, state.memory, state.answer.load, answer.load)
        if not self.has_energy:
            return State(answer, memory, np.nan, np.nan)
        heat = self._heat(weights.dt, state, answer.load)
        return State(answer, memory, state.work + self._work(state, answer, memory), state.dissipated + heat)

    def _raise_scale(self, value: float) -> None:
        """Keep the force that the slowest loading would show at the largest value so far."""
        if self.rtol is None or value <= self._highest:
            return
        self._highest = self._scale = value
        if self.control == "displacement":
            self._scale = self.contact.press(np.zeros(self.contact.size), self._softest, value, 0.0).force

    def _weights_of(self, dt: float) -> StepWeights:
        """Weights of a step, remembered: samples are often even."""
        found = self._weights.get(dt)
        if found is None:
            if len(self._weights) >= 256:
                self._weights.clear()
            found = self._weights[dt] = step_weights(self.creep, dt)
        return found

    def _work(self, state: State, answer: Answer, memory: Floats) -> float:
        """Work on the springs in one step: mean load times displacement of each."""
        old = state.answer.load
        moved = self.creep.instantaneous * (answer.load - old)
        moved = moved + memory.sum(axis=0) - state.memory.sum(axis=0)
        return 0.5 * float(self.contact.inner(old + answer.load, moved))

    def _heat(self, dt: float, state: State, new_load: Floats) -> float:
        r"""Heat of one step, exactly: the integral of (q − w/C)² C/τ; never negative."""
        C, inner = self.creep.C, self.contact.inner
        old_load = state.answer.load
        lag, rise = old_load - state.memory[: C.size] / C[:, None], new_load - old_load
        # ∫e^{-2s}, ∫e^{-s}(1-e^{-s})/x and ∫(1-e^{-s})²/x² over 0 < s < x = dt/τ.
        x = dt / self.creep.tau
        loss, first = -np.expm1(-x), -0.5 * np.expm1(-2.0 * x)
        small = np.minimum(x, 0.05)
        series = small * (1 / 3 - small * (1 / 4 - small * (7 / 60 - small * (1 / 24 - small * 31 / 2520))))
        with np.errstate(divide="ignore", invalid="ignore"):
            cross, second = 0.5 * loss**2 / x, np.where(x < 0.05, series, (x - 2.0 * loss + first) / x**2)
        heat = first * inner(lag, lag) + 2.0 * cross * inner(lag, rise) + second * inner(rise, rise)
        flow = inner(old_load, new_load) + inner(rise, rise) / 3.0
        return float(C @ np.maximum(heat, 0.0)) + self.creep.fluidity * dt * float(flow)

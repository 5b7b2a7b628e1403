r"""The exact exponential memory of a linear viscoelastic spring, and the histories that load it.

Both contact problems collapse to independent springs that obey ``w = J * dq`` with the creep
compliance ``J(t) = J(0) + sum C_k (1 - exp(-t/tau_k))``: a spring in series with Kelvin elements,

.. math:: w = J(0)\,q + \sum_k w_k, \qquad \tau_k \dot w_k + w_k = C_k\,q .

With the load ``q`` linear inside a step, the update of every ``w_k`` is exact for any step length.
Elements much faster than the step answer as plain compliance, elements much slower as dashpots, so
the step is stable at any length, and its cost does not grow with the history. A liquid has one
more element, a bare dashpot that flows by ``fluidity * q``; it is the last row of the memory.

A memory is an array (element, spring); several steps of one history may have any lengths, zero
included. The usual loop is::

    creep = Creep.of(material)
    memory = creep.rest(n_springs)
    weights = step_weights(creep, dt)
    past = history(weights, memory, load)            # what the springs would show at load 0
    new_load = (displacement - past) / weights.compliance
    memory = advance(weights, memory, load, new_load)
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.compilation import lean
from labpipe.errors import InputError

if TYPE_CHECKING:
    from labpipe.materials import Prony


@dataclass(frozen=True, slots=True)
class Creep:
    """Contact creep compliance in 1/Pa.

    ``J*(t) = instantaneous + sum C (1 - exp(-t/tau)) + fluidity t``, which already holds the
    factor ``1 - nu**2`` of the half-space. No terms and no fluidity is an elastic solid.

    ``instantaneous`` [1/Pa]. ``C`` (term,) [1/Pa]. ``tau`` (term,) [s]. ``fluidity`` [1/(Pa s)]. ``rate`` (element,)
    [1/s]: ``1/tau`` of every row of the memory, 0 for the dashpot of a liquid.
    """

    instantaneous: float
    C: Floats
    tau: Floats
    fluidity: float = 0.0
    rate: Floats = field(init=False)

    def __post_init__(self) -> None:
        dashpot = [0.0] if self.fluidity > 0.0 else []
        object.__setattr__(self, "rate", np.concatenate([1.0 / self.tau, dashpot]))

    @classmethod
    def of(cls, material: "Prony") -> "Creep":
        """Take the compliance of a half-space of the material.

        A material without an instantaneous compliance (a dashpot in parallel) raises InputError.
        """
        C, tau = material.creep_terms()
        modulus = float(material.E_unrelaxed)
        if not (np.isfinite(modulus) and modulus > 0.0):
            raise InputError(
                f"the instantaneous modulus is {modulus} Pa, expected a finite positive number: "
                "contact needs a material with an instantaneous compliance"
            )
        factor = 1.0 - float(material.nu) ** 2
        return cls(1.0 / modulus * factor, C * factor, tau, float(material.fluidity) * factor)

    def on(self, compliance: float) -> "Creep":
        """Return the compliance of contact with an elastic counter-body: the compliances add up.

        ``compliance`` [1/Pa]: ``(1 - nu**2)/E`` of the other body.
        """
        return Creep(self.instantaneous + compliance, self.C, self.tau, self.fluidity)

    @property
    def n_terms(self) -> int:
        """Number of Kelvin elements."""
        return int(self.C.size)

    @property
    def inverse(self) -> Floats:
        """``1/C`` of every row of the memory (element,) in Pa; a dashpot stores nothing: 0."""
        return np.concatenate([1.0 / self.C, np.zeros(self.rate.size - self.C.size)])

    def compliance(self, time: Floats | float) -> Floats:
        """Return ``J*(time)`` in 1/Pa; the same shape as ``time`` [s]."""
        t = np.asarray(time, dtype=float)[..., None]
        terms = np.sum(self.C * np.expm1(-t / self.tau), axis=-1)
        return self.instantaneous - terms + self.fluidity * np.asarray(time, dtype=float)

    def rest(self, n_springs: int) -> Floats:
        """Return the memory (element, spring) of springs that never carried a load."""
        return np.zeros((self.rate.size, n_springs))


@dataclass(frozen=True, slots=True)
class StepWeights:
    """Everything that one step of length ``dt`` needs; depends on ``dt`` and the material alone.

    ``w_k <- decay_k w_k + old_k q_old + new_k q_new`` and
    ``displacement = history + compliance * q_new``.
    """

    dt: float
    decay: Floats
    old: Floats
    new: Floats
    compliance: float
    old_total: float


def step_weights(creep: Creep, dt: float) -> StepWeights:
    """Weights of one step.

    ``dt`` [s]: length of the step, in which the load is linear; 0 is an instantaneous (elastic) jump.

    Examples
    --------
    >>> creep = Creep(1.0, np.array([2.0]), np.array([0.5]))
    >>> round(step_weights(creep, 1e6).compliance, 5), step_weights(creep, 0.0).compliance
    (3.0, 1.0)
    """
    if not dt >= 0.0:
        raise InputError(f"a step of {dt} s; the time of a history must not run backwards or be NaN")
    x = dt / creep.tau
    loss = -np.expm1(-x)
    # 1 - (1 - exp(-x))/x = x/2! - x^2/3! + x^3/4! - ... below 0.05, where the difference loses digits
    small, share = np.minimum(x, 0.05), np.zeros_like(x)
    for factorial in (40320.0, -5040.0, 720.0, -120.0, 24.0, -6.0, 2.0):
        share = share * small + 1.0 / factorial
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(x < 0.05, share * small, 1.0 - loss / x)
    new, old = creep.C * share, creep.C * (loss - share)
    if creep.fluidity > 0.0:
        half = 0.5 * creep.fluidity * dt
        new, old = np.append(new, half), np.append(old, half)
    compliance = creep.instantaneous + float(new.sum())
    return StepWeights(float(dt), np.exp(-dt * creep.rate), old, new, compliance, float(old.sum()))


def history(weights: StepWeights, memory: Floats, load: Floats) -> Floats:
    """Displacement (spring,) that the springs would show at the end of the step at zero load.

    ``memory`` (element, spring) and ``load`` (spring,) are those at its start.
    """
    return weights.decay @ memory + weights.old_total * load


def advance(weights: StepWeights, memory: Floats, load: Floats, new_load: Floats) -> Floats:
    """Memory (element, spring) at the end of the step; the input is not changed."""
    result = np.empty_like(memory)
    _advance(weights.decay, weights.old, weights.new, memory, load, new_load, result)
    return result


@lean()
def _advance(
    decay: Floats, old: Floats, new: Floats, memory: Floats, load: Floats, new_load: Floats, result: Floats
) -> None:
    for k in range(decay.size):
        for j in range(load.size):
            result[k, j] = decay[k] * memory[k, j] + old[k] * load[j] + new[k] * new_load[j]


def condense(creep: Creep, shortest: float, longest: float, tolerance: float) -> tuple[Creep, int, int]:
    """Fold terms far below a time scale into one, and drop those far above it.

    Fast terms become a single term with the same sum of ``C`` and the same sum of ``C tau``: what
    is left out is of second order in ``tau/shortest``. Slow terms, which have no time to creep, are
    dropped.

    ``shortest`` [s]: duration of the fastest event of interest; ``longest`` [s]: of everything; ``tolerance``:
    relative error of the compliance that each of the two shortcuts may cost. Returns the shorter compliance, with the
    same instantaneous one, and how many terms were folded into one and dropped.
    """
    order = np.argsort(creep.tau)
    C, tau = creep.C[order], creep.tau[order]
    omega = np.pi / shortest
    fast = np.cumsum(C * np.minimum(omega * tau, 1e150) ** 2) < tolerance * creep.instantaneous
    slow = np.cumsum((C * np.minimum(longest / tau, 1e150))[::-1])[::-1]
    frozen = (slow < tolerance * creep.instantaneous) & ~fast
    kept = ~fast & ~frozen
    n_fast = int(fast.sum())
    folded, mean_time = [C[fast].sum()] * bool(n_fast), [C[fast] @ tau[fast] / C[fast].sum()] if n_fast else []
    C, tau = np.concatenate([folded, C[kept]]), np.concatenate([mean_time, tau[kept]])
    return Creep(creep.instantaneous, C, tau, creep.fluidity), max(n_fast - 1, 0), int(frozen.sum())


def checked_history(time: ArrayLike, value: ArrayLike, name: str) -> tuple[Floats, Floats]:
    """Return a history as two arrays (time,), or say where it is wrong.

    Raises
    ------
    InputError
        Lengths differ, a number is missing or infinite, or time runs backwards.

    Examples
    --------
    >>> checked_history([0.0, 1.0], [0.0, float("nan")], "displacement")
    Traceback (most recent call last):
    labpipe.errors.InputError: displacement[1] is nan (at 1 s); fill or cut the gap before simulating
    """
    times, values = np.asarray(time, dtype=float), np.asarray(value, dtype=float)
    if times.ndim != 1 or times.shape != values.shape or times.size == 0:
        raise InputError(
            f"time has the shape {times.shape} and {name} {values.shape}; expected two rows of the "
            "same length with at least one sample"
        )
    if (bad := np.flatnonzero(~np.isfinite(times))).size:
        raise InputError(f"time[{bad[0]}] is {times[bad[0]]}; every sample needs a finite time")
    if (bad := np.flatnonzero(~np.isfinite(values))).size:
        n = bad[0]
        raise InputError(f"{name}[{n}] is {values[n]} (at {times[n]:g} s); fill or cut the gap before simulating")
    if (back := np.flatnonzero(np.diff(times) < 0.0)).size:
        n = back[0] + 1
        raise InputError(
            f"time runs backwards at sample {n}: {times[n]:g} s after {times[n - 1]:g} s; "
            "sort the history (two samples at one time are a jump)"
        )
    return times, values


def checked_load(time: ArrayLike, load: ArrayLike) -> tuple[Floats, Floats]:
    """Return a history of load as :func:`checked_history` does; no load may be negative [N]."""
    times, loads = checked_history(time, load, "load")
    if (negative := np.flatnonzero(loads < 0.0)).size:
        n = negative[0]
        raise InputError(f"load[{n}] is {loads[n]} N; a contact without adhesion cannot pull")
    return times, loads

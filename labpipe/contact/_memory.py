r"""The exact exponential memory of a linear viscoelastic spring, and the histories that load it.

Both contact problems collapse to independent springs that obey ``w = J * dq`` with the creep
compliance ``J(t) = J(0) + sum C_k (1 - exp(-t/tau_k))``: a spring in series with Kelvin elements,

.. math:: w = J(0)\,q + \sum_k w_k, \qquad \tau_k \dot w_k + w_k = C_k\,q .

With the load ``q`` linear inside a step, the update of every ``w_k`` is exact for any step length, and its cost does
not grow with the history. A liquid has one more element, a bare dashpot that flows by ``fluidity * q``; it is the last
row of the memory, an array (element, spring).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError

if TYPE_CHECKING:
    from labpipe.materials import Prony


class Elements(NamedTuple):
    """The elements of a spring as steps take them: ``w' + rate w = flow q`` of each, a dashpot with rate 0 last."""

    instantaneous: float
    rate: Floats
    flow: Floats


@dataclass(frozen=True)
class Creep:
    """Contact creep compliance in 1/Pa, with the factor ``1 - nu**2`` of the half-space.

    ``J*(t) = instantaneous + sum C (1 - exp(-t/tau)) + fluidity t``.
    """

    instantaneous: float
    C: Floats
    tau: Floats
    fluidity: float = 0.0

    @cached_property
    def elements(self) -> Elements:
        """The same as elements, a dashpot last."""
        dashpot = [self.fluidity] if self.fluidity > 0.0 else []
        rate = np.concatenate([1.0 / self.tau, np.zeros(len(dashpot))])
        return Elements(self.instantaneous, rate, np.concatenate([self.C / self.tau, dashpot]))

    @property
    def rate(self) -> Floats:
        """``1/tau`` of every element (element,) in 1/s, 0 for the dashpot of a liquid."""
        return self.elements.rate

    @classmethod
    def of(cls, material: "Prony") -> "Creep":
        """Take the compliance of a half-space of the material."""
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
        """Return that of contact with an elastic body of a ``compliance`` ``(1 - nu**2)/E`` [1/Pa]: they add up."""
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


def condense(creep: Creep, shortest: float, longest: float, tolerance: float) -> tuple[Creep, int, int]:
    """Fold terms far below the ``shortest`` event [s] into one, and drop those far above the ``longest``.

    Fast terms become a single term with the same sum of ``C`` and the same sum of ``C tau``: what is left out is of
    second order in ``tau/shortest``. Each of the two shortcuts may cost ``tolerance`` of the compliance. Returns the
    shorter compliance, and how many terms were folded and dropped.
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
    """Return a history as two arrays (time,), or say where it is wrong."""
    times, values = np.asarray(time, dtype=float), np.asarray(value, dtype=float)
    if times.ndim != 1 or times.shape != values.shape or times.size == 0:
        raise InputError(
            f"time has the shape {times.shape} and {name} {values.shape}; expected two rows of the "
            "same length with at least one sample"
        )
    for label, array in (("time", times), (name, values)):
        if (bad := np.flatnonzero(~np.isfinite(array))).size:
            raise InputError(f"{label}[{bad[0]}] is {array[bad[0]]}; fill or cut the gap before simulating")
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


def checked_times(times: ArrayLike, duration: float) -> Floats:
    """Return instants that rise within the duration as an array (time,)."""
    wanted = np.atleast_1d(np.asarray(times, dtype=float))
    is_inside = np.all((wanted >= 0.0) & (wanted <= duration))
    if wanted.ndim != 1 or not wanted.size or not is_inside or np.any(np.diff(wanted) <= 0.0):
        raise InputError(f"times must increase strictly and lie within 0 and {duration} s")
    return wanted

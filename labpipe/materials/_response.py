r"""Stress of a solid under any history of strain, with the energies, and the inequalities it obeys.

Boltzmann's superposition, thesis (1.4), for a generalised Maxwell solid: with :math:`e_j` the strain
of the spring of element j,

.. math::
    \sigma = E_\infty \varepsilon + \sum_j E_j e_j, \qquad
    \dot e_j = \dot\varepsilon - e_j / \rho_j,

which is solved exactly for a strain that is linear between the samples. The stored energy (1.25) is
:math:`\psi = \tfrac12 E_\infty \varepsilon^2 + \tfrac12 \sum_j E_j e_j^2` per volume (the double
integral with :math:`G(2t - \tau - \eta)`), the rate of dissipation (1.20), which is also (1.22),
:math:`\Lambda = \sum_j E_j e_j^2 / \rho_j`. The balance of energy (1.16) without flow of heat,
:math:`c \dot\theta = \Lambda`, gives the adiabatic rise of the temperature.

Under a history of temperature too, a solid that expands by :math:`\alpha\Theta` is stressed by
:math:`\varepsilon - \alpha\Theta` only: the kernels of the thesis's coupling terms (1.19) are then
:math:`K = \alpha G` and :math:`M = \alpha^2 G`, its three integrals one of (1.20)'s form in that
difference, and not negative. Of the work, :math:`\int \sigma\alpha \, d\Theta` is given as heat. With a
flow of heat the entropy inequality (1.18) has one more term (:func:`entropy_inequality`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials.prony import Prony
from labpipe.variables import variable

_BEYOND, _PER_DECADE = 1e3, 20
"""Times and frequencies are tried so far beyond the terms' own, with so many to a decade."""

_ROUNDING = 1e-12
"""Share of the largest value below which a negative one is rounding."""


class Inequality(NamedTuple):
    """One thermodynamic condition and whether it holds.

    Attributes
    ----------
    equation : str
        Number in the thesis.
    statement : str
    margin : float
        Least value of what must not be negative, over its largest size; where the condition fails
        it is negative.
    at : float
        Time [s] or angular frequency [rad/s] of that least value.
    holds : bool
    """

    equation: str
    statement: str
    margin: float
    at: float
    holds: bool


def respond(
    solid: Prony,
    time: ArrayLike,
    strain: ArrayLike,
    *,
    heat_capacity: float | None = None,
    temperature: ArrayLike | None = None,
    expansion: float = 0.0,
) -> xr.Dataset:
    """Follow a uniaxial strain history, exactly between the samples.

    Parameters
    ----------
    solid : Prony
    time : array (time,) [s]
        Never falling; two samples at one time are a jump. Before the first sample there is no strain.
    strain : array (time,)
        Linear between the samples.
    heat_capacity : float, optional [J/(m3 K)]
        Per volume; asks for the temperature without flow of heat.
    temperature : array (time,), optional [K]
        Above that at which there is neither stress nor strain; linear between the samples. How it
        changes the relaxation times is not followed.
    expansion : float [1/K]
        Linear thermal expansion.

    Returns
    -------
    Dataset
        Over ``time``: ``strain``; ``stress`` [Pa], thesis (1.4); ``work`` done so far, ``stored_energy``
        (1.25) and ``dissipated_energy`` [J/m3], whose balance is (1.23); ``dissipation_rate`` [W/m3],
        (1.20); with a heat capacity ``temperature_rise`` [K], (1.16); with a temperature
        ``reversible_heat`` [J/m3], the part of the work that thermal expansion exchanges as heat, and
        the rate of dissipation is (1.19).

    Raises
    ------
    InputError
        The histories do not fit, are not finite, or time falls; or the solid has a dashpot in
        parallel, whose stress follows the rate and jumps with it; or a temperature without expansion.

    Examples
    --------
    >>> solid = Prony(1.0, [1.0], [1.0])
    >>> made = respond(solid, [0.0, 0.0, 1.0], [0.0, 1.0, 1.0])
    >>> [round(float(s), 3) for s in made.stress]
    [0.0, 2.0, 1.368]
    """
    t, strains = np.asarray(time, dtype=float), np.asarray(strain, dtype=float)
    if t.ndim != 1 or t.shape != strains.shape or not t.size:
        raise InputError(f"time has shape {t.shape} and strain {strains.shape}: expected two lists of equal length")
    if not (np.isfinite(t).all() and np.isfinite(strains).all()):
        raise InputError("time and strain must be finite numbers")
    falling = np.flatnonzero(np.diff(t) < 0)
    if falling.size:
        n = int(falling[0])
        raise InputError(f"time[{n + 1}] = {t[n + 1]} s comes before time[{n}] = {t[n]} s; sort the history")
    if solid.viscosity > 0:
        message = "the solid has a dashpot in parallel: its stress follows the rate of strain; give a solid without one"
        raise InputError(message)
    if heat_capacity is not None and not (np.isfinite(heat_capacity) and heat_capacity > 0):
        raise InputError(f"heat_capacity = {heat_capacity} J/(m3 K): expected a positive number")
    expanded = np.zeros(t.size)
    if temperature is not None:
        warm = np.asarray(temperature, dtype=float)
        if warm.shape != t.shape or not np.isfinite(warm).all():
            raise InputError(f"temperature has shape {warm.shape}: expected a finite number for each of {t.size} times")
        if not (np.isfinite(expansion) and expansion != 0.0):
            raise InputError(f"expansion = {expansion} 1/K: a history of temperature needs the thermal expansion")
        expanded = expansion * warm
    held = strains - expanded
    inner, springs, lost = np.zeros(solid.rho.size), np.empty((t.size, solid.rho.size)), np.empty(t.size)
    # Before the first sample there is no strain: a first one that is not zero is a jump.
    lengths, rises = np.diff(t, prepend=t[0]), np.diff(held, prepend=0.0)
    for i, (length, rise) in enumerate(zip(lengths.tolist(), rises.tolist(), strict=True)):
        inner, lost[i] = _step(solid, inner, length, rise)
        springs[i] = inner
    stress = solid.E_relaxed * held + springs @ solid.E
    stored = 0.5 * (solid.E_relaxed * held**2 + springs**2 @ solid.E)
    dissipated = np.cumsum(lost)
    heat = np.cumsum(_mean_stress(solid, held, springs, lengths) * np.diff(expanded, prepend=0.0))
    table = {
        "strain": variable("time", strains, "1", "strain"),
        "stress": variable("time", stress, "Pa", "stress"),
        "work": variable("time", stored + dissipated + heat, "J/m3", "work done on the solid so far"),
        "stored_energy": variable("time", stored, "J/m3", "elastically stored energy"),
        "dissipated_energy": variable("time", dissipated, "J/m3", "dissipated energy so far"),
        "dissipation_rate": variable("time", springs**2 @ (solid.E / solid.rho), "W/m3", "rate of dissipation"),
    }
    if heat_capacity is not None:
        table["temperature_rise"] = variable("time", dissipated / heat_capacity, "K", "adiabatic rise of temperature")
    if temperature is not None:
        table["reversible_heat"] = variable("time", heat, "J/m3", "work exchanged as heat by thermal expansion")
    return xr.Dataset(table, coords={"time": variable("time", t, "s", "time")})


def entropy_inequality(
    dissipation_rate: ArrayLike, temperature_gradient: ArrayLike, conductivity: float, temperature: float
) -> Floats:
    """Return the left side of the entropy inequality (1.18), with Fourier's flow of heat.

    The flow ``q = -k grad(T)`` adds ``k grad(T)^2 / T``, which is not negative either, so that neither
    part can make up for the other.

    Parameters
    ----------
    dissipation_rate : array (n,) [W/m3]
        Of :func:`respond`.
    temperature_gradient : array (n,) [K/m]
    conductivity : float [W/(m K)]
    temperature : float [K]
        Absolute, about which the solid is linear.

    Returns
    -------
    array (n,) [W/m3]

    Raises
    ------
    InputError
        Conductivity or absolute temperature are not positive.

    Examples
    --------
    >>> entropy_inequality([2.0], [1000.0], 0.3, 300.0).tolist()
    [1002.0]
    """
    if not (np.isfinite([conductivity, temperature]).all() and conductivity > 0 and temperature > 0):
        raise InputError(
            f"conductivity = {conductivity} W/(m K), temperature = {temperature} K: expected positive numbers; "
            "heat that flows to the hotter side breaks (1.17)"
        )
    gradient = np.asarray(temperature_gradient, dtype=float)
    return np.asarray(np.asarray(dissipation_rate, dtype=float) + conductivity * gradient**2 / temperature)


def _mean_stress(solid: Prony, held: Floats, springs: Floats, lengths: Floats) -> Floats:
    """Return the mean stress [Pa] of every step, exactly; the first begins without strain."""
    before = np.vstack([np.zeros(springs.shape[1]), springs[:-1]])
    start = np.append(0.0, held[:-1])
    rises = held - start
    ends = 0.5 * (before + springs)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = lengths[:, None] / solid.rho
        steady = solid.rho * (rises / lengths)[:, None]
        inside = steady + (before - steady) * -np.expm1(-x) / x
    means = np.where(lengths[:, None] > 0.0, inside, ends)
    return np.asarray(0.5 * solid.E_relaxed * (start + held) + means @ solid.E)


def _step(solid: Prony, before: Floats, length: float, rise: float) -> tuple[Floats, float]:
    """Return the springs' strains after a step and the energy [J/m3] dissipated in it."""
    if length <= 0.0:
        return before + rise, 0.0
    x = length / solid.rho
    gone, rate = -np.expm1(-x), rise / length
    steady = solid.rho * rate
    after = before + (steady - before) * gone
    # The integral of e^2 over the step, e = steady + (before - steady) exp(-t / rho).
    swing = before - steady
    square = steady**2 * length + 2.0 * steady * swing * solid.rho * gone
    square += swing**2 * solid.rho * -0.5 * np.expm1(-2.0 * x)
    return after, float(np.maximum(square, 0.0) @ (solid.E / solid.rho))


def inequalities(E_relaxed: float, E: Sequence[float] | Floats, rho: Sequence[float] | Floats) -> list[Inequality]:
    """Hold relaxation terms, admissible or not, against the thesis's thermodynamic conditions.

    :class:`Prony` refuses a negative weight outright. A sum with one may still obey the conditions that
    look at one step or at cycles; some history of strain then leaves only that element strained, and (1.20)
    gains energy there. This tells which conditions hold, and where the others fail.

    Parameters
    ----------
    E_relaxed : float [Pa]
    E : sequence of float [Pa]
        Weights of E(t) = E_relaxed + sum E exp(-t / rho), of any sign.
    rho : sequence of float [s]
        Positive times.

    Returns
    -------
    list of Inequality
        (1.8) fading memory, (1.20) for a step: the relaxation modulus never rises, (1.21) and (1.24)
        no work gained in a closed cycle (loss modulus at every frequency), (1.25) stored energy of a
        step not negative, convexity, which the text demands after (1.25), and (1.20) and (1.25) for
        every history: no weight is negative.

    Raises
    ------
    InputError
        The lists differ in length, a time is not positive, or a number is not finite.

    Examples
    --------
    >>> [row.holds for row in inequalities(1.0, [1.0], [1.0])]
    [True, True, True, True, True, True]
    >>> [row.equation for row in inequalities(1.0, [1.0, -0.1], [1.0, 1e-3]) if not row.holds]
    ['1.8', '1.20', '1.21, 1.24', '1.25 text', '1.20, 1.25']
    >>> [row.equation for row in inequalities(2.0, [2.0, -0.1], [1.0, 0.5]) if not row.holds]
    ['1.20, 1.25']
    """
    weight, times = np.asarray(E, dtype=float), np.asarray(rho, dtype=float)
    if weight.ndim != 1 or weight.shape != times.shape:
        raise InputError(f"E has shape {weight.shape} and rho {times.shape}: expected two lists of equal length")
    if not (np.isfinite(E_relaxed) and np.isfinite(weight).all() and np.isfinite(times).all() and np.all(times > 0)):
        raise InputError("the modulus and weights must be finite, and every time positive and finite")
    each, which = np.unique(times, return_inverse=True)  # elements of one time are one element
    of_elements = np.append(each, np.inf), np.append(np.bincount(which, weight, each.size), E_relaxed)
    low, high = (float(times.min()), float(times.max())) if times.size else (1.0, 1.0)
    count = round(_PER_DECADE * np.log10(_BEYOND**2 * high / low)) + 1
    t = np.geomspace(low / _BEYOND, high * _BEYOND, count)
    decay = np.exp(-t[:, None] / times)
    omega = 1.0 / t
    x = omega[:, None] * times
    loss = (x / (1.0 + x**2)) @ weight
    falling, bending = decay @ (weight / times), decay @ (weight / times**2)
    return [
        _held("1.8", "the memory fades: |dE/dt| falls with time", t, -np.diff(np.abs(falling), append=0.0)),
        _held("1.20", "E(t) never rises: the dissipation after a step is not negative", t, t * falling),
        _held("1.21, 1.24", "no work is gained in a cycle: E''(ω) is not negative", omega, loss),
        _held("1.25", "the stored energy of a step is not negative: E(t) ≥ 0", t, E_relaxed + decay @ weight),
        _held("1.25 text", "E(t) is convex", t, t**2 * bending),
        _held("1.20, 1.25", "dissipation and stored energy of every history: no weight is negative", *of_elements),
    ]


def _held(equation: str, statement: str, at: Floats, values: Floats) -> Inequality:
    size = float(np.abs(values).max(initial=0.0)) or 1.0
    worst = int(np.argmin(values))
    margin = float(values[worst]) / size
    return Inequality(equation, statement, margin, float(at[worst]), margin >= -_ROUNDING)

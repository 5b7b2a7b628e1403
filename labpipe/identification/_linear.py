"""Indentation and rheometer as data: forces, stiffness and moduli, linear in the Prony terms.

While a contact only grows, its force is that of the elastic contact run through the relaxation
modulus (Lee and Radok), ``F(t) = int E*(t - s) dA(delta(s))`` with the elastic force over reduced
modulus ``A``. Under a small oscillation about a mean depth it is ``K* = E*(omega) A'(delta)``.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.identification._evidence import Evidence, Fuller, Group, LinearModel
from labpipe.materials.spectrum import moduli_of_terms


def lee_radok_basis(time: Floats, area: Floats, rho: Floats, nu: float, *, may_recede: bool = False) -> Floats:
    """Return the force of a growing contact per Pa of each term of the relaxation modulus.

    ``time`` (sample,) [s]: Not falling. ``area`` (sample,) [m2]: Elastic force over reduced modulus, not falling;
    linear between samples, 0 before. ``rho`` (term,) [s]: Relaxation times. ``nu``: Poisson's ratio: reduced moduli
    are E/(1 - nu^2). ``may_recede``: The contact may recede a little, which is close enough for an uncertainty. Returns
    (sample, 1 + term) [N/Pa]: The first column is that of E_relaxed. Raises InputError: Time or contact go back.

    Examples
    --------
    A step of the contact, held for one relaxation time:

    >>> made = lee_radok_basis(np.array([0.0, 1.0]), np.array([2.0, 2.0]), np.array([1.0]), 0.0)
    >>> [float(round(x, 4)) for x in made[1]]
    [2.0, 0.7358]
    """
    step, growth = np.diff(time), np.diff(area)
    if np.any(step < 0.0) or (np.any(growth < 0.0) and not may_recede):
        raise InputError("time or contact decrease: Lee and Radok's integral needs a growing contact")
    x = step[:, None] / rho
    decay = np.exp(-x)
    share = np.where(x > 0.0, -np.expm1(-x) / np.where(x > 0.0, x, 1.0), 1.0)
    gained = share * growth[:, None]
    made = np.empty((time.size, rho.size + 1))
    made[:, 0] = area
    level = np.full(rho.size, area[0])
    made[0, 1:] = level
    for n in range(step.size):
        level = level * decay[n] + gained[n]
        made[n + 1, 1:] = level
    return made / (1.0 - nu**2)


def force_evidence(
    name: str,
    lag: Floats,
    force: Floats,
    u_force: Floats,
    basis: Floats,
    *,
    shifts: Mapping[str, Floats] | None = None,
    factors: tuple[str, ...] = (),
    offsets: tuple[str, ...] = (),
) -> Evidence:
    """Take the force of a relaxation as evidence.

    ``name``: Of the experiment. ``lag``, ``force``, ``u_force`` (n,) [s], [N], [N]: Time since the ramp's end, force,
    and the uncertainty from noise. ``basis`` (n, 1 + term) [N/Pa]: Rows of :func:`lee_radok_basis` there. ``shifts``:
    Derivative of the basis by unknowns, such as the zero of depth. ``factors``, ``offsets``: Unknowns that multiply
    every force, or are added to it (gain, punch; tare).
    """
    window, added = (float(lag.min()), float(lag.max())), {name: np.ones(force.size) for name in offsets}
    model = LinearModel(basis, window, dict(shifts or {}), factors, added)
    return Evidence(name, (Group("force", force, u_force, lag, "N", "time since the ramp", "s"),), model)


def modulus_basis(omega: Floats, rho: Floats) -> Floats:
    """Return storage and loss modulus (2, n, 1 + term) per Pa of each term."""
    return np.roll(moduli_of_terms(np.log(omega), np.log(rho)), 1, axis=1).reshape(2, omega.size, rho.size + 1)


def stiffness_evidence(
    name: str,
    frequency: Floats,
    storage: tuple[Floats, Floats],
    loss: tuple[Floats, Floats],
    slope: Floats,
    rho: Floats,
    nu: float,
    *,
    slope_by: Mapping[str, Floats] | None = None,
    factors: tuple[str, ...] = (),
    offsets: Mapping[str, Floats] | None = None,
    fuller: Fuller | None = None,
) -> Evidence:
    """Take the dynamic stiffness of an oscillating punch as evidence.

    ``name``: Of the experiment. ``frequency`` (n,) [Hz]. ``storage``, ``loss`` [N/m]: Stiffness with its uncertainty.
    ``slope`` (n,) [m]: Derivative of elastic force over reduced modulus by depth, at the mean depth. ``rho``, ``nu``
    (term,): Of the spectrum. ``slope_by``: Derivative of ``slope`` by unknowns, such as the zero of depth.
    ``factors``: Unknowns that multiply every stiffness. ``offsets``: Derivative of storage, then loss stiffness by
    unknowns that only add, such as a phase. ``fuller``: A simulation of the finite amplitude; numbers are storage,
    then loss.
    """
    omega = 2.0 * np.pi * frequency
    reduced = modulus_basis(omega, rho).reshape(2 * omega.size, -1) / (1.0 - nu**2)
    shifts = {n: np.tile(d, 2)[:, None] * reduced for n, d in (slope_by or {}).items()}
    window = 1.0 / float(omega.max()), 1.0 / float(omega.min())
    model = LinearModel(np.tile(slope, 2)[:, None] * reduced, window, shifts, factors, dict(offsets or {}), fuller)
    groups = tuple(
        Group(f"{label} stiffness", values, u, frequency, "N/m", "frequency", "Hz")
        for label, (values, u) in (("storage", storage), ("loss", loss))
    )
    return Evidence(name, groups, model)


def modulus_evidence(
    name: str,
    frequency: Floats,
    storage: tuple[Floats, Floats],
    loss: tuple[Floats, Floats],
    rho: Floats,
    *,
    factors: tuple[str, ...] = (),
) -> Evidence:
    """Take moduli in tension, of a rheometer, as evidence known beforehand.

    ``name``: Of the experiment. ``frequency`` (n,) [Hz]: At the temperature of the other experiments. ``storage``,
    ``loss`` [Pa]: Moduli with their uncertainty. ``rho`` (term,) [s]: Of the spectrum. ``factors``: Unknowns that
    multiply every modulus, such as the specimen's dimensions.
    """
    made = stiffness_evidence(name, frequency, storage, loss, np.ones(frequency.size), rho, 0.0, factors=factors)
    groups = tuple(replace(g, name=g.name.replace("stiffness", "modulus"), units="Pa") for g in made.groups)
    return replace(made, groups=groups, is_prior=True)

"""Ting's equations of one impact as ordinary differential equations, which SciPy integrates in plain Python.

While the contact grows, a Prony solid needs two memories per term, of the indentation and of its power 3/2.
While it shrinks, it is as wide as it was at an earlier time t₁ and the force is what the history up
to t₁ has left (T. C. T. Ting, https://doi.org/10.1115/1.3625192); t₁ follows from the derivative of
his condition. One impact on a rigid surface: no dent of an earlier one, no plate.
"""

from math import sqrt
from typing import Any

import numpy as np
import xarray as xr
from scipy.integrate import solve_ivp

from labpipe.arrays import Floats
from labpipe.materials import Prony

NAME = "Ting's equations, SciPy"
#: Of a contact's duration: how long after the deepest point t₁ is taken to mirror it.
_MIRRORED = 1e-7


def first_impact(
    solid: Prony, radius: float, mass: float, height: float, gravity: float, rtol: float = 1e-6
) -> xr.Dataset:
    """Integrate the first impact of a sphere that falls from rest.

    ``solid``: of the sphere, with a constant Poisson's ratio; ``radius``: [m]; ``mass``: [kg]; ``height``: of the fall
    [m]; ``gravity``: [m/s²]; ``rtol``: relative tolerance of the integrator. Returns ``restitution``, ``peak_force``
    [N], ``peak_approach`` [m] and ``contact_duration`` [s] over ``impact`` (1,).
    """
    speed = sqrt(2.0 * gravity * height)
    terms, tau, relaxed = np.asarray(solid.E), np.asarray(solid.rho), float(solid.E_relaxed)
    hertz = 4.0 / 3.0 * sqrt(radius) / (1.0 - float(np.asarray(solid.nu)) ** 2)
    n, unrelaxed = terms.size, relaxed + float(terms.sum())
    time = (mass**2 / (hertz**2 * unrelaxed**2 * speed)) ** 0.2  # of an elastic contact, but for a factor near 3
    depth = speed * time

    # approach, speed, memories of approach and of its power 3/2
    scale = np.concatenate([[depth, speed], np.full(n, depth), np.full(n, depth**1.5)])

    def approaching(_: float, y: Floats) -> Floats:
        root = sqrt(max(y[0], 0.0))
        force = hertz * (relaxed * y[0] * root + terms @ y[2 + n :])
        memory = -y[2 : 2 + n] / tau + y[1]
        return np.concatenate([[y[1], gravity - force / mass], memory, -y[2 + n :] / tau + 1.5 * root * y[1]])

    def deepest(_: float, y: Floats) -> float:
        return float(y[1])

    deepest.terminal = True  # type: ignore[attr-defined]
    options: dict[str, Any] = {"method": "LSODA", "rtol": rtol}
    start = np.concatenate([[0.0, speed], np.zeros(2 * n)])
    grown = solve_ivp(approaching, (0.0, 100.0 * time), start, events=deepest, dense_output=True, atol=rtol * scale,
                      **options)  # fmt: skip
    turn, bottom = float(grown.t_events[0][0]), grown.y_events[0][0]

    def left(t: float, then: float) -> tuple[float, Floats, Floats]:
        """Return the force at a time whose contact is that of an earlier one, the state then, and its decay since."""
        state = grown.sol(then)
        decay = np.exp(-(t - then) / tau)
        return hertz * (relaxed * max(state[0], 0.0) ** 1.5 + (terms * decay) @ state[2 + n :]), state, decay

    def leaving(t: float, y: Floats) -> Floats:
        then = min(max(y[-1], 0.0), turn)
        force, state, decay = left(t, then)
        memory = y[2:-1]
        change = unrelaxed * y[1] - (terms / tau) @ (memory - decay * state[2 : 2 + n])
        back = change / ((relaxed + terms @ decay) * state[1])
        return np.concatenate([[y[1], gravity - force / mass], -memory / tau + y[1], [back]])

    def apart(_: float, y: Floats) -> float:
        return float(relaxed * y[0] + terms @ y[2:-1])

    apart.terminal = True  # type: ignore[attr-defined]
    ahead = _MIRRORED * turn
    slope = approaching(turn, bottom)
    begin = np.concatenate([(bottom + ahead * slope)[: 2 + n], [turn - ahead]])
    size = np.concatenate([scale[: 2 + n], [time]])
    shrunk = solve_ivp(leaving, (turn + ahead, 100.0 * time), begin, events=apart, atol=rtol * size, **options)
    end, last = float(shrunk.t_events[0][0]), shrunk.y_events[0][0]

    states = grown.sol(np.linspace(0.0, turn, 4001))
    force = hertz * (relaxed * np.maximum(states[0], 0.0) ** 1.5 + terms @ states[2 + n :])
    found = {
        "restitution": -last[1] / speed,
        "peak_force": force.max(),
        "peak_approach": bottom[0],
        "contact_duration": end,
    }
    return xr.Dataset({name: ("impact", [float(value)]) for name, value in found.items()})

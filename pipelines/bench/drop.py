"""A sphere that falls and bounces: error against run time of three solvers, and of Ting's equations in SciPy.

Truth: Ting's integral for the first impact of a polymer of eleven terms (ten digits), and a train
of 34 bounces of one of fifteen terms by springs at a hundred times finer steps than the default.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import isnan, nan, sqrt
from typing import Any

import numpy as np
import xarray as xr
from scipy.integrate import solve_ivp

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.materials import Prony
from pipelines.bench.measure import OURS, THESIS, Calls, Extra, Point, Suite, race
from pipelines.rig.apparatus import SPHERE

TING = "Ting's equations, SciPy"
_BODY = SPHERE.radius, SPHERE.mass, SPHERE.heights[0]
_TAU = np.logspace(-10, 2, 15)
_SHARE = (1 / 2e9 - 1 / 6e9) / 15
#: Ting's integral for the first impact of the polymer without its four fastest terms.
_FIRST = {
    "restitution": 0.938881646,
    "peak_force": 259.5168018,
    "peak_approach": 7.243709307e-5,
    "contact_duration": 1.2344948e-3,
}
#: Some bounces of the train: number: touch since the first (s), restitution, largest force (N).
_TRAIN = {
    0: (nan, 0.938866, 259.514693),
    1: (0.034046427, 0.938783, 240.709239),
    2: (0.066052398, 0.938675, 223.234283),
    3: (0.096140314, 0.938567, 207.004401),
    31: (0.484611580, 0.90733, 22.415490),
}


def run(quick: bool) -> list[Suite]:
    """Measure the first impact and the train of bounces."""
    solid = Prony.from_creep(2e9, np.full(11, _SHARE), _TAU[4:], nu=0.35)
    steps = (2e-4, 2e-5, 4e-6) if quick else (2e-4, 5e-5, 2e-5, 8e-6, 4e-6, 2e-6, 1e-6)
    tolerances = (1e-3, 1e-4, 1e-5, 1e-6) if quick else (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
    peers = {
        f"{TING}, rtol {rtol:.0e}": (TING, partial(first_impact, solid, *_BODY, SPHERE.gravity, rtol))
        for rtol in ((1e-6, 1e-10) if quick else (1e-4, 1e-6, 1e-8, 1e-10))
    }
    points = _measured({**_solvers(solid, 2e-3, tolerances, steps), **peers}, _first_error, 3 if quick else 7)
    title = "First impact of an acrylic-like sphere, 1.5 mm: against Ting's integral"
    error = "worst relative error of restitution, force, approach, duration (1)"
    first = Suite("drop-first", title, error, points)

    solid = Prony.from_creep(2e9, np.full(15, _SHARE), _TAU, nu=0.35)
    calls = _solvers(
        solid, 0.5, (1e-3, 1e-4) if quick else (1e-2, 1e-3, 1e-4, 1e-5), (2e-4,) if quick else (2e-4, 1e-4, 5e-5)
    )
    points = _measured(calls, _train_error, 1 if quick else 3)
    title = "34 bounces in 0.5 s of an acrylic-like sphere, 15 terms from 1e-10 to 1e2 s"
    error = "worst relative error of touch times, forces, restitutions (1)"
    notes = ["A wrong number of bounces counts as an error of 1."]
    return [first, Suite("drop-train", title, error, points, notes=notes)]


def _solvers(solid: Prony, after: float, tolerances: Sequence[float], steps: Sequence[float]) -> Calls:
    """Name our solvers at several tolerances and the thesis's at several steps, ``after`` s beyond the fall."""
    duration = sqrt(2.0 * SPHERE.heights[0] / SPHERE.gravity) + after
    drop = partial(contact.drop, solid, *_BODY, duration)
    calls: dict[str, tuple[str, Callable[[], object]]] = {
        f"{name}, rtol {rtol:.0e}": (OURS, partial(drop, solver=solver, rtol=rtol))
        for solver, name in (("mdr", "springs"), ("rings", "rings"))
        for rtol in tolerances
    }
    return calls | {
        f"thesis's scheme, step {step:.0e} s": (THESIS, partial(drop, solver="thesis", time_step=step))
        for step in steps
    }


def _measured(calls: Calls, error: Callable[[Any], float], repeats: int) -> list[Point]:
    def judge(_: str, found: Any) -> tuple[float, Extra]:
        return error(found), {"bounces": int(found.sizes["impact"])}

    return race(calls, repeats, judge, "springs, rtol 1e-04", budget=60.0)


def _first_error(found: Any) -> float:
    if not found.sizes["impact"]:
        return 1.0
    return max(abs(float(found[name][0]) / exact - 1.0) for name, exact in _FIRST.items())


def _train_error(found: Any, bounces: int = 34) -> float:
    if found.sizes["impact"] != bounces:
        return 1.0
    touch = found.impact_time.values - found.impact_time.values[0]
    errors = [abs(touch[n] / time - 1.0) for n, (time, _, _) in _TRAIN.items() if not isnan(time)]
    errors += [abs(float(found.restitution[n]) - restitution) for n, (_, restitution, _) in _TRAIN.items()]
    return max(*errors, *(abs(float(found.peak_force[n]) / force - 1.0) for n, (_, _, force) in _TRAIN.items()))


def first_impact(
    solid: Prony, radius: float, mass: float, height: float, gravity: float, rtol: float = 1e-6
) -> xr.Dataset:
    """Integrate the first impact of a sphere that falls from rest, by Ting's equations as ordinary differential ones.

    While the contact grows, a Prony solid needs two memories per term, of the indentation and of its power 3/2.
    While it shrinks, it is as wide as it was at an earlier time t₁ and the force is determined by the history up
    to t₁ (T. C. T. Ting, https://doi.org/10.1115/1.3625192); t₁ follows from the derivative of
    his condition. One impact on a rigid surface: no dent of an earlier one, no plate.

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
    ahead = 1e-7 * turn  # how long after the deepest point t₁ is taken to mirror it
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

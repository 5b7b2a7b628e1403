"""An independent bouncing body: Hertz with velocity-dependent loss and a dent that heals slowly.

Deliberately another contact law and another integrator than the package's own simulator.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

GRAVITY = 9.81
MASS = 0.505


@dataclass(frozen=True)
class Bouncing:
    """Truth of one drop; ``sample`` gives position and velocity at any times."""

    sample: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    release: float
    touch: np.ndarray
    liftoff: np.ndarray
    incoming: np.ndarray
    outgoing: np.ndarray


@cache
def drop(
    height: float = 1.5e-3,
    loss: float = 0.5,
    dent: float = 0.0,
    duration: float = 0.5,
    release: float = 0.01,
    plate_mass: float = np.inf,
) -> Bouncing:
    """Force ``K s^1.5 (1 + loss s')``; the dent grows towards ``dent * s`` and heals in 5 ms."""
    stiffness, healing = 4.0e8, 5e-3
    plate = 2 * np.pi * 300.0, 0.02

    def force(indentation, rate):
        return stiffness * max(indentation, 0.0) ** 1.5 * max(1.0 + loss * rate, 0.0)

    def plate_motion(y, load):
        return -(plate[0] ** 2) * y[3] - 2 * plate[1] * plate[0] * y[4] - load / plate_mass

    def in_contact(_, y):
        indentation = y[3] - y[2] - y[0]
        rate = (dent * max(indentation, 0.0) - y[2]) / healing
        load = force(indentation, y[4] - y[1] - rate)
        return [y[1], load / MASS - GRAVITY, rate, y[4], plate_motion(y, load)]

    def in_flight(_, y):
        return [y[1], -GRAVITY, -y[2] / healing, y[4], plate_motion(y, 0.0)]

    def touching(_, y):
        return y[0] - y[3] + y[2]

    def leaving(t, y):
        return touching(t, y)

    touching.terminal, touching.direction = True, -1
    leaving.terminal, leaving.direction = True, 1
    state, now, contact = np.array([height, 0.0, 0.0, 0.0, 0.0]), 0.0, False
    pieces, touch, liftoff, incoming, outgoing = [], [], [], [], []
    settled = False
    while now < duration - release:
        solution = solve_ivp(
            in_contact if contact else in_flight,
            (now, duration - release),
            state,
            method="DOP853",
            rtol=1e-9,
            atol=1e-13,
            events=None if settled else (leaving if contact else touching),
            dense_output=True,
            max_step=3e-4 if contact else np.inf,
            first_step=1e-7,
        )
        pieces.append((now, solution.t[-1], solution.sol))
        now, state = solution.t[-1], solution.y[:, -1]
        if solution.status != 1:
            break
        if contact and state[1] - state[4] < 2e-3:
            settled = True  # flights shorter than the contact: permanent from here on
            continue
        (liftoff if contact else touch).append(now + release)
        (outgoing if contact else incoming).append(abs(state[1]))
        contact = not contact

    def sample(times):
        position, speed = np.full(times.shape, height), np.zeros(times.shape)
        for start, end, dense in pieces:
            inside = (times - release >= start) & (times - release <= end)
            if inside.any():
                position[inside], speed[inside] = dense(times[inside] - release)[:2]
        return position, speed

    n = len(liftoff)
    return Bouncing(
        sample,
        release,
        np.array(touch),
        np.array(liftoff),
        np.array(incoming[: max(n, len(touch))]),
        np.array(outgoing),
    )


def measured(
    truth: Bouncing, rate: float, noise: float, seed: int = 0, step: float = 1e-7, duration=0.5
) -> tuple[xr.DataArray, np.ndarray, np.ndarray]:
    """What a sensor with white noise and a quantised output records; true position and speed."""
    time = np.arange(0.0, duration, 1.0 / rate)
    position, speed = truth.sample(time)
    random = np.random.default_rng(seed)
    reading = np.round((position + noise * random.standard_normal(len(time))) / step) * step
    return as_displacement(time, reading), position, speed


def as_displacement(time, values) -> xr.DataArray:
    return xr.DataArray(
        values,
        dims="time",
        coords={"time": ("time", time, {"units": "s", "long_name": "time"})},
        name="displacement",
        attrs={"units": "m", "long_name": "displacement"},
    )


@pytest.fixture(scope="session")
def bouncing():
    """The reference trajectory as a function of its parameters."""
    return drop


@pytest.fixture(scope="session")
def measure():
    """The sensor as a function of trajectory, rate and noise."""
    return measured


@pytest.fixture(scope="session")
def displacement_of():
    """Wrap times and values as a displacement record."""
    return as_displacement

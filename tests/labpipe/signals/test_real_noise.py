"""Stated uncertainties of drops whose noise is white, flicker and hum at once."""

import warnings
from collections import defaultdict

import numpy as np
import pytest
import xarray as xr
from scipy.special import gamma

from labpipe import contact, signals
from labpipe.arrays import Floats
from labpipe.materials import Prony

_INTERVAL, _STEP = 5e-5, 1e-7
_WHITE, _FLICKER, _HUM = 0.8e-6, 0.4e-6, 0.3e-6  # m, root mean squares
_HEIGHTS = (1.5e-3, 5e-3, 10e-3)
_BEFORE, _LONGEST, _IMPACTS = 0.025, 0.3, 3  # s at rest and after the release; impacts of a record
_AFTER_RELEASE, _BESIDE_CONTACT = 1e-3, 2e-4  # s in which a velocity is of neither flight nor contact


def flicker(rng: np.random.Generator, count: int) -> Floats:
    """Return noise with the power 1/f of one root mean square, cut from eight times the length."""
    frequency = np.fft.rfftfreq(8 * count)
    frequency[0] = np.inf
    waves = (rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size)) / np.sqrt(frequency)
    long = np.fft.irfft(waves, 8 * count)
    return np.asarray(long[:count] / long.std())


def drawn(rng: np.random.Generator) -> Prony:
    """Draw a polymer that returns 0.7 to 0.99 of its speed: E(t) = rest + extra (1 + t / tau)^-beta."""
    rest = 10 ** rng.uniform(9.0, 9.5)
    extra, tau, beta = rest * 10 ** rng.uniform(-1.0, 0.5), 10 ** rng.uniform(-5.5, -3.5), rng.uniform(0.05, 0.4)
    s = np.logspace(-9.0, 1.5, 43)  # (1 + t / tau)^-beta is the Laplace transform of s^(beta - 1) exp(-s) / gamma
    weights = extra * s**beta * np.exp(-s) * np.log(s[1] / s[0]) / gamma(beta)
    return Prony(rest, weights, tau / s, nu=0.35)


def recorded(seed: int) -> tuple[xr.Dataset, float, xr.DataArray, Floats]:
    """Return a motion, the time of its release, its record, and the true speed at each reading."""
    rng = np.random.default_rng(seed)
    height, start = _HEIGHTS[seed % 3], _BEFORE + _INTERVAL * rng.uniform()
    time = np.arange(int((start + _LONGEST) / _INTERVAL)) * _INTERVAL
    since = np.maximum(time - start, 0.0)
    falls = since > 0.0
    motion = contact.drop(drawn(rng), 9.525e-3, 0.505, height, _LONGEST, times=since[falls])
    moved, speed = np.full(time.size, height), np.zeros(time.size)
    moved[falls], speed[falls] = motion["displacement"].values, motion["velocity"].values
    if motion.sizes["impact"] > _IMPACTS:  # the record ends with the flight after the last of them
        kept = since < float(motion["impact_time"][_IMPACTS]) - 2 * _INTERVAL
        time, moved, speed = time[kept], moved[kept], speed[kept]
    line = np.sqrt(2.0) * np.sin(2 * np.pi * (50.0 + 0.03 * rng.standard_normal()) * time + rng.uniform(0, 2 * np.pi))
    noise = _WHITE * rng.standard_normal(time.size) + _FLICKER * flicker(rng, time.size) + _HUM * line
    shown = np.round((moved + noise) / _STEP) * _STEP
    return motion, start, xr.DataArray(shown, {"time": time}, ["time"], attrs={"units": "m"}), speed


def errors(seeds: range) -> dict[str, list[float]]:
    """Return the errors of all that is read off the records, over their standard uncertainties."""
    found: dict[str, list[float]] = defaultdict(list)
    for seed in seeds:
        motion, start, record, speed = recorded(seed)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "the record ends before the body is at rest")
            events = signals.bounces(record, contact="polymer")
        touches, liftoffs = (motion[name].values[:_IMPACTS] for name in ("impact_time", "lift_off_time"))
        count = min(events.sizes["impact"], touches.size)
        true = {"touch_time": touches + start, "liftoff_time": liftoffs + start, "contact_duration": liftoffs - touches}
        speeds = {"incoming_speed": "impact_speed", "outgoing_speed": "rebound_speed", "restitution": "restitution"}
        true |= {name: motion[of].values for name, of in speeds.items()}
        for name, exact in true.items():
            off = events[name].values[:count] - exact[:count]
            found[name] += (off / events[f"u_{name}"].values[:count]).tolist()
        velocity = signals.velocity(record, events=events, releases=[float(events["release_time"])])
        z, since = ((velocity - speed) / velocity["u_velocity"]).values, record["time"].values - start
        is_in, is_near = np.zeros((2, z.size), bool)
        for touch, liftoff in zip(touches, liftoffs, strict=True):
            is_in |= (since > touch) & (since < liftoff)
            is_near |= (since > touch - _BESIDE_CONTACT) & (since < liftoff + _BESIDE_CONTACT)
        is_flight = (since > _AFTER_RELEASE) & (since < since[-1] - _AFTER_RELEASE) & ~is_near
        found["velocity in contact"] += z[is_in].tolist()
        found["velocity in flight"] += z[is_flight].tolist()
        found["velocity at rest"] += z[since < -_AFTER_RELEASE].tolist()
        alone = signals.velocity(record)
        found["velocity without events"] += ((alone - speed) / alone["u_velocity"]).values.tolist()
    return found


@pytest.mark.parametrize(
    ("seeds", "least", "rms"),
    [
        (range(300, 308), 0.85, (0.7, 1.25)),
        pytest.param(range(300, 384), 0.93, (0.85, 1.05), marks=pytest.mark.nightly),
    ],
)
def test_intervals_hold_under_white_flicker_and_hum(seeds, least, rms):
    found = errors(seeds)
    for name, values in found.items():
        inside, size = float(np.mean(np.abs(values) < 1.96)), float(np.sqrt(np.mean(np.square(values))))
        assert least <= inside, (name, inside)
        assert rms[0] < size < rms[1], (name, size)

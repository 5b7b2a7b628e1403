"""Extreme laser records: bounces known to the microsecond, and records without any.

A body falls freely, is thrown back by a pulse of force near that of Hertz, a power of a sine, and
flies again; the record is sampled from the closed form and its integral, whatever the sensor adds.
"""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from tests.extremes.inputs import Random, laid_out, with_gaps
from tests.extremes.outcome import Case, Outcome, silently, worst
from tests.extremes.signals import record_of

_GRAVITY = 9.81
#: Points of the integral of one contact.
_CONTACT_POINTS = 400


class Flight:
    """A drop of ``height`` (m): touches, lift-offs (s), restitution, the level at any time."""

    def __init__(self, random: Random, height: float, contact: float, bounces: int) -> None:
        fall = np.sqrt(2.0 * height / _GRAVITY)
        self.release = float(random.uniform(0.02, 0.3)) * fall
        self.touch: list[float] = [self.release + float(fall)]
        self.liftoff: list[float] = []
        self.restitution = random.uniform(0.35, 0.85, bounces)
        exponent = float(random.uniform(1.3, 1.7))
        time = [np.array([0.0]), self.release + np.linspace(0.0, 1.0, 300) * fall]
        level = [np.array([height]), height * (1.0 - np.linspace(0.0, 1.0, 300) ** 2)]
        speed, low = _GRAVITY * float(fall), 0.0
        s = np.linspace(0.0, 1.0, _CONTACT_POINTS)
        pulse = np.sin(np.pi * s) ** exponent
        gained = _integral(s, pulse)
        for e in self.restitution:
            begin, out = self.touch[-1], e * speed
            rate = -speed + (speed + out) * gained / gained[-1]
            moved = low + contact * _integral(s, rate)
            self.liftoff.append(begin + contact)
            low = float(moved[-1])
            flight = 2.0 * out / _GRAVITY
            t = np.linspace(0.0, 1.0, 300) * flight
            time += [begin + contact * s[1:], self.liftoff[-1] + t[1:]]
            level += [moved[1:], low + (out * t - 0.5 * _GRAVITY * t**2)[1:]]
            self.touch.append(self.liftoff[-1] + flight)
            speed = out
        self.time, self.level = np.concatenate(time), np.concatenate(level)
        # The last flight is cut: what follows it is not known.
        self.end = self.touch.pop() - 0.1 * flight


def _integral(s: Floats, values: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(0.5 * np.diff(s) * (values[1:] + values[:-1]))])


def known_bounces(random: Random) -> Outcome:
    """Any height, sampling, noise, zero and direction: what is found is right, or it is refused."""
    height = 10 ** random.uniform(-3.3, -1)
    fall = float(np.sqrt(2.0 * height / _GRAVITY))
    contact = fall * 10 ** random.uniform(-2.2, -1.2)
    flight = Flight(random, height, contact, int(random.integers(1, 5)))
    count = int(np.clip(flight.end / (contact / random.uniform(6.0, 15.0)), 150, 3000))
    time = np.linspace(0.0, flight.end, count)
    noise = height * 10 ** random.uniform(-6, -2.3)
    level = np.interp(time, flight.time, flight.level)
    sign = float(random.choice([-1.0, 1.0]))
    zero = height * float(random.choice([0.0, -1.0, 1e3]))
    values = zero + sign * level + noise * random.standard_normal(count)
    if random.random() < 0.3:
        values[random.integers(0, count, 3)] += 300.0 * noise  # flashes
    values = with_gaps(random, laid_out(random, values, is_single=random.random() < 0.2 and not zero))
    with silently():
        found = signals.bounces(record_of(laid_out(random, time), values))
    if found.sizes["impact"] > len(flight.touch):
        return Outcome(np.inf, f"{found.sizes['impact']} impacts of {len(flight.touch)}")
    return _compared(found, flight, fall, sign, values)


def _compared(found: xr.Dataset, flight: Flight, fall: float, sign: float, values: Floats) -> Outcome:
    """Every impact is matched to the nearest true one; what a gap hides may be missing."""
    touch = found["touch_time"].values
    index = np.abs(touch[:, None] - np.array(flight.touch)).argmin(axis=1)
    looks = [
        ("touch_time", np.array(flight.touch)[index], 2e-3 * fall, 8.0),
        ("liftoff_time", np.array(flight.liftoff)[index], 2e-3 * fall, 8.0),
        ("restitution", flight.restitution[index], 2e-3, 8.0),
    ]
    shares = [
        (
            float(np.max(np.abs(found[name].values - truth) / (factor * found[f"u_{name}"].values + floor))),
            f"{name} by {factor:g} u and 2e-3",
        )
        for name, truth, floor, factor in looks
    ]
    turned = found.attrs["direction"] != sign
    return worst(*shares, (np.inf if turned else 0.0, "up was taken for down"))


def no_bounce(random: Random) -> Outcome:
    """Noise, waves, steps, ramps and bursts hold no falling body, and that is said."""
    count = int(random.integers(60, 1200))
    time = np.arange(count, dtype=float) * float(10 ** random.uniform(-5, -2))
    s = np.linspace(0.0, 1.0, count)
    size = 10 ** random.uniform(-9, 0)
    shapes: Mapping[str, Floats] = {
        "rest": np.zeros(count),
        "noise": random.standard_normal(count),
        "wave": np.sin(2 * np.pi * random.uniform(0.2, 0.2 * count / 8.0) * s),
        "ramp": 3.0 * s,
        "step": np.where(s < random.random(), 0.0, 1.0),
        "walk": np.cumsum(random.standard_normal(count)) / np.sqrt(count),
        "spike": np.where(np.arange(count) == count // 2, 50.0, 0.0),
        "fall without an end": -(s**2),
        "slow exponential": np.exp(-3.0 * s),
    }
    name = str(random.choice(list(shapes)))
    noise = float(random.choice([0.0, 10 ** random.uniform(-5, -2)]))
    values = size * (shapes[name] + noise * random.standard_normal(count))
    values = with_gaps(random, laid_out(random, values + size * random.choice([0.0, 1e5])))
    with silently():
        found = signals.bounces(record_of(time, values))
    return Outcome(np.inf, f"{name}: {found.sizes['impact']} bounces found")


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {"known bounces": (known_bounces, 10), "no bounce": (no_bounce, 40)}

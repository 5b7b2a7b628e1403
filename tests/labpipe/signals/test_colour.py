"""Colour of the noise: found in what is free of motion, and carried into the fits."""

import numpy as np
import pytest
import xarray as xr

from labpipe import signals
from labpipe.contact import drop
from labpipe.materials import Prony
from labpipe.signals._colour import _normal, estimate_corner, velocity_factor
from labpipe.signals._derivative import velocity
from tests.rounding import rounding

_INTERVAL = 5e-5
_SOLID = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)


def flicker(rng: np.random.Generator, count: int, sigma: float, corner: float) -> np.ndarray:
    """Return noise whose power is that of white noise of ``sigma`` times 1 + corner / f."""
    frequency = np.maximum(np.fft.rfftfreq(count, _INTERVAL), 1.0 / (count * _INTERVAL))
    waves = np.fft.rfft(rng.standard_normal(count)) * np.sqrt(1.0 + corner / frequency)
    return sigma * np.fft.irfft(waves, count)


@pytest.mark.parametrize("corner", [200.0, 1000.0])
def test_the_corner_of_flicker_noise_is_found(corner):
    noise = [flicker(np.random.default_rng(i), 8192, 1.0, corner) for i in range(12)]
    found = [estimate_corner(one, np.full(8192, 1e-4), _INTERVAL) for one in noise]
    assert np.median(found) == pytest.approx(corner, rel=0.25)
    # A spline that follows everything slow leaves nothing to see.
    assert estimate_corner(noise[0], np.full(8192, 0.9), _INTERVAL) == 0.0


def test_white_noise_has_no_colour():
    found = [
        estimate_corner(np.random.default_rng(i).standard_normal(8192), np.full(8192, 1e-3), _INTERVAL)
        for i in range(20)
    ]
    assert np.count_nonzero(found) <= 1


def test_the_normal_matrix_is_that_of_the_noise():
    rng, corner, count = np.random.default_rng(0), 300.0, 512
    design = np.stack([np.ones(count), np.linspace(-1, 1, count), np.linspace(-1, 1, count) ** 2], axis=1)
    np.testing.assert_allclose(_normal(design, _INTERVAL, 0.0), design.T @ design, rtol=rounding(count))
    # Drawn over four times the length, so that the noise does not repeat.
    drawn = np.array([design[:, 1:].T @ flicker(rng, 4 * count, 1.0, corner)[:count] for _ in range(1500)])
    expected = np.diag(_normal(design, _INTERVAL, corner))[1:]
    # A slope is insensitive to what is slower than the record, the mean of a square is not.
    assert drawn[:, 0].var() == pytest.approx(expected[0], rel=0.25)
    assert drawn[:, 1].var() > 1.5 * np.sum(design[:, 2] ** 2)


def test_a_smoother_velocity_suffers_more_from_colour():
    factor = velocity_factor(np.array([1e-3, 1e-2, 1e-1]), _INTERVAL, 300.0)
    assert np.all(np.diff(factor) < 0)
    assert np.all(velocity_factor(np.array([1e-3, 1.0]), _INTERVAL, 0.0) == 1.0)


def test_stated_uncertainties_hold_under_flicker_noise_and_hum():
    rng = np.random.default_rng(3)
    before, duration = 0.02, 0.2
    time = np.arange(round(duration / _INTERVAL)) * _INTERVAL
    since = np.maximum(time - before, 0.0)
    made = drop(_SOLID, 9.525e-3, 0.505, 5e-3, duration, times=np.unique(since))
    true = made.isel(time=np.searchsorted(made.time.values, since))
    errors: dict[str, list[float]] = {"touch": [], "duration": [], "speed": [], "velocity": []}
    for _ in range(6):
        hum = 0.42e-6 * np.sin(2 * np.pi * 50.0 * time + rng.uniform(0.0, 2 * np.pi))
        noise = flicker(rng, time.size, 0.8e-6, 300.0) + hum
        record = xr.DataArray(true.displacement.values + noise, {"time": time}, ["time"], attrs={"units": "m"})
        with pytest.warns(UserWarning, match="before the body is at rest"):
            found = signals.bounces(record)
        rows = slice(0, 3)
        for name, column, wanted in (
            ("touch", "touch_time", true.impact_time + before),
            ("duration", "contact_duration", true.contact_duration),
            ("speed", "incoming_speed", true.impact_speed),
        ):
            errors[name] += ((found[column] - wanted.values[: found.sizes["impact"]]) / found[f"u_{column}"])[
                rows
            ].values.tolist()
        edges = np.concatenate([found.touch_time, found.liftoff_time])
        speed = velocity(record, breaks=np.sort(edges), releases=[float(found.release_time)])
        flying = (since > 2e-3) & (time < float(true.impact_time[2]) + before) & (true.force.values == 0.0)
        errors["velocity"] += ((speed - true.velocity.values) / speed.u_velocity).values[flying].tolist()
    inside = {name: float(np.mean(np.abs(values) < 1.96)) for name, values in errors.items()}
    assert min(inside.values()) > 0.85, inside
    assert 0.5 < float(np.std(errors["velocity"])) < 1.3

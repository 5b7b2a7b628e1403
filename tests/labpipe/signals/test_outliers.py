"""Outliers: found in runs up to ten, never at kinks, contacts or steps of a clean record."""

import numpy as np
import pytest

from labpipe.signals import outliers


@pytest.fixture
def smooth_record():
    """Return a sine of 300 readings a period with noise of 1 and amplitude 1000."""
    noise = np.random.default_rng(5).standard_normal(2000)
    return 1e3 * np.sin(2 * np.pi * np.arange(2000) / 300) + noise


@pytest.mark.parametrize("length", range(1, 11))
@pytest.mark.parametrize("first", [0, 1, 700, 1988])
def test_a_run_is_found_anywhere(smooth_record, first, length):
    """Fewer than four readings between a run and the end of a record may be left out with it."""
    values = smooth_record.copy()
    values[first : first + length] += 500.0
    found = outliers(values)
    wild = set(range(first, min(first + length, 2000)))
    flagged = set(np.flatnonzero(found.flags).tolist())
    assert wild <= flagged
    assert flagged - wild <= ({0} if first == 1 else set(range(1996, 2000)) if first == 1988 else set())


def test_readings_of_either_sign_are_one_run_and_good_ones_between_are_kept(smooth_record):
    values = smooth_record.copy()
    values[[400, 401, 402]] += [900.0, -700.0, 800.0]
    values[[900, 902]] += [800.0, -800.0]
    assert outliers(values).runs == [(400, 402), (900, 900), (902, 902)]


@pytest.mark.parametrize("speed", [2.0, 10.0, 50.0, 1000.0])
@pytest.mark.parametrize("lasts", [0.3, 1.0, 2.0, 3.0, 5.0, 8.0, 13.0, 20.0])
@pytest.mark.parametrize("restitution", [0.2, 0.6, 0.95])
def test_no_reading_of_an_impact_is_an_outlier(speed, lasts, restitution):
    """A half sine of force over any number of readings, between two flights, at any phase of the sampling."""
    for phase in np.linspace(0.0, 1.0, 7):
        index = np.arange(-60.0, 61.0) + phase
        inside = np.clip(index / lasts, 0.0, 1.0)
        turned = (1 + restitution) * 0.5 * (inside - np.sin(np.pi * inside) / np.pi) * lasts
        level = -speed * index + speed * (turned + (1 + restitution) * np.clip(index - lasts, 0.0, None))
        noise = np.random.default_rng(7).standard_normal(index.size)
        assert not outliers(level + noise, noise=1.0).flags.any()


def test_steps_and_pulses_of_motion_are_no_outliers():
    index = np.arange(400)
    noise = np.random.default_rng(8).standard_normal(400)
    assert not outliers(1e3 * (index > 200) + noise).flags.any()
    for lasts in (4, 6, 10):
        pulse = np.where((index >= 200) & (index < 200 + lasts), np.sin(np.pi * (index - 199.5) / lasts), 0.0)
        assert not outliers(1e3 * pulse + noise).flags.any()


def test_uneven_times_and_missing_readings(smooth_record):
    time = np.cumsum(np.random.default_rng(9).uniform(0.5, 1.5, 2000))
    values = 1e3 * np.sin(2 * np.pi * time / 300) + np.random.default_rng(5).standard_normal(2000)
    values[[300, 301, 302]] = [np.nan, 5e3, np.nan]
    assert outliers(values, time).runs == [(301, 301)]

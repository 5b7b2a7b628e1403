"""Harmonic indentation in closed form, and against the simulator."""

import numpy as np
import pytest

from labpipe.contact import dissipated_power, dissipated_work, tapping_amplitude
from labpipe.errors import InputError
from labpipe.materials import Prony

RADIUS, PERIOD, DEPTH = 2e-3, 8e-3, 18e-3
RUBBER = Prony(7.6e6, [30e6, 60e6], [1e-2, 1e-4], nu=0.5)
GEOMETRY = (0.05 * RADIUS, RADIUS, PERIOD)


def test_work_beyond_the_front_is_left_out() -> None:
    amplitude, frequency = np.linspace(1e-6, 2e-4, 40), np.array([[0.1], [1e3]])
    work = dissipated_work(RUBBER, frequency, amplitude, *GEOMETRY, DEPTH, beyond="nan")
    front = tapping_amplitude(RUBBER, frequency, *GEOMETRY)
    assert np.array_equal(np.isfinite(work), amplitude <= front)


def test_the_spectral_route_is_the_closed_form_and_adds_harmonics():
    rubber = Prony(7.6e6, [30e6, 76e6], [0.05, 1e-3], nu=0.5)
    frequency, mean = 2.0, 1e-4
    time = np.arange(240) / 240 * 3 / frequency
    first, third = (np.sin(2 * np.pi * n * frequency * time) for n in (1, 3))
    power = [
        dissipated_power(rubber, time, mean + one, 2e-3, 8e-3, 18e-3)
        for one in (1e-5 * first, 2e-6 * third, 1e-5 * first + 2e-6 * third)
    ]
    works = [dissipated_work(rubber, n * frequency, a, mean, 2e-3, 8e-3, 18e-3) for n, a in ((1, 1e-5), (3, 2e-6))]
    assert power[0] == pytest.approx(float(works[0]) * frequency, rel=1e-9)
    assert power[1] == pytest.approx(float(works[1]) * 3 * frequency, rel=1e-9)
    assert power[2] == pytest.approx(power[0] + power[1], rel=1e-9)


def test_a_record_without_a_spectrum_is_refused():
    for time, said in ((np.arange(4.0), "8 or more"), (np.arange(10.0) ** 2, "uneven")):
        with pytest.raises(InputError, match=said):
            dissipated_power(Prony(7.6e6, [], [], nu=0.5), time, np.ones(time.size), 2e-3, 8e-3)

"""The thesis's scheme: it converges to the springs, slowly, and says what it cannot do."""

import json

import numpy as np
import pytest

from labpipe.contact import drop
from labpipe.errors import InputError
from labpipe.materials import Prony

SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
FALL = float(np.sqrt(2 * 1.5e-3 / 9.81))
SPHERE = {"radius": 9.525e-3, "mass": 0.505, "height": 1.5e-3}


def first_impact(time_step, ring_width=4e-5):
    return drop(SLS, **SPHERE, duration=FALL + 2e-3, solver="thesis", time_step=time_step, ring_width=ring_width)


def test_the_thesis_time_step_is_percents_off():
    result = first_impact(2e-4)
    assert 0.01 < abs(float(result.peak_force[0]) / 257.5063769 - 1) < 0.2
    assert abs(float(result.restitution[0]) / 0.7288782966 - 1) < 0.2


def test_its_work_grows_with_the_square_of_the_steps():
    products = [json.loads(first_impact(dt).attrs["work"])["history_products"] for dt in (2e-5, 1e-5)]
    assert products[1] / products[0] == pytest.approx(4.0, rel=0.05)


def test_the_fall_comes_first_and_times_may_be_asked_for():
    result = first_impact(2e-5)
    assert float(result.displacement[0]) == 1.5e-3
    assert np.all(np.diff(result.time) > 0)
    asked = drop(SLS, **SPHERE, duration=0.02, solver="thesis", times=[0.0, 0.01, 0.02])
    assert asked.displacement.values[1] == pytest.approx(1.5e-3 - 0.5 * 9.81 * 1e-4, abs=1e-6)


def test_an_hour_of_history_is_refused():
    with pytest.raises(InputError, match="time step"):
        drop(SLS, **SPHERE, duration=10.0, solver="thesis", time_step=2e-6)

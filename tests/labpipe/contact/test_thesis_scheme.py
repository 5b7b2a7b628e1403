"""The thesis's scheme: it converges to the springs, slowly, and says what it cannot do."""

import json

import numpy as np
import pytest

from labpipe.contact import drop
from labpipe.contact.impact._thesis_scheme import drop_thesis
from labpipe.contact.memory._creep import Creep
from labpipe.errors import InputError
from labpipe.materials import Prony

SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
FALL = float(np.sqrt(2 * 1.5e-3 / 9.81))
SPHERE = {"radius": 9.525e-3, "mass": 0.505, "height": 1.5e-3}


def first_impact(time_step, ring_width=4e-5):
    return drop(SLS, **SPHERE, duration=FALL + 2e-3, solver="thesis", time_step=time_step, ring_width=ring_width)


def test_it_converges_to_the_exact_impact():
    """Ting's integral: e 0.7288782966, F 257.5063769 N, t_c 1.115611844 ms."""
    errors = []
    for time_step in (2e-5, 4e-6):
        result = first_impact(time_step)
        errors.append(abs(float(result.peak_force[0]) / 257.5063769 - 1))
    assert errors[0] < 8e-3
    assert errors[1] < 1.5e-3
    assert float(result.restitution[0]) == pytest.approx(0.7288782966, abs=4e-3)
    assert float(result.contact_duration[0]) == pytest.approx(1.1156e-3, abs=1e-5)


def test_the_thesis_time_step_is_percents_off():
    result = first_impact(2e-4)
    assert 0.01 < abs(float(result.peak_force[0]) / 257.5063769 - 1) < 0.2
    assert abs(float(result.restitution[0]) / 0.7288782966 - 1) < 0.2


def test_it_flickers_where_the_step_creeps_more_than_the_glass():
    """15 modes over 12 decades, J(dt) > 2 J(0): the thesis's own step loses the bounces."""
    C, tau = np.full(15, (1 / 2e9 - 1 / 6e9) / 15), np.logspace(-10, 2, 15)
    material = Prony.from_creep(2e9, C, tau, nu=0.35)
    assert float(material.creep(2e-4)) > 2.0 / 6e9
    assert drop(material, **SPHERE, duration=0.5, solver="thesis").sizes["impact"] > 100
    assert drop(material, **SPHERE, duration=0.5).sizes["impact"] < 40


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


def test_three_rings_are_enough_to_begin():
    creep, scheme = Creep.of(SLS), {"ring_width": 1e-3, "time_step": 1e-5}
    run = drop_thesis(creep, 9.525e-3, 0.505, 9.81, 0.05, 1e-4, 2e-3, **scheme)
    assert run is not None
    with pytest.raises(InputError, match=r"2 rings.*3 or more rings"):
        drop_thesis(creep, 9.525e-3, 0.505, 9.81, 0.05, 1e-4, 1e-3, **scheme)

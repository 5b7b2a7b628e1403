"""Times of flight over a recovering dent and a ringing plate."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from labpipe.contact.impact._flight import time_to_touch
from labpipe.contact.impact._plate import Plate, PlateState
from tests.rounding import rounding

G = 9.81


def test_without_a_dent_it_is_the_parabola():
    assert time_to_touch(-0.1, G, np.zeros(1), np.ones(1)) == pytest.approx(0.2 / G, rel=rounding(100))


def test_a_permanent_dent_does_not_matter():
    assert time_to_touch(-0.1, G, np.array([1e-5]), np.zeros(1)) == pytest.approx(0.2 / G)


@settings(max_examples=60, deadline=None)
@given(
    speed=st.floats(1e-4, 1.0),
    depth=st.lists(st.floats(0, 1e-6), min_size=3, max_size=3),
    rate=st.lists(st.floats(-4, 8), min_size=3, max_size=3),
)
def test_it_is_the_first_meeting_with_the_dent(speed, depth, rate):
    dent, rates = np.array(depth), 10.0 ** np.array(rate)
    time = time_to_touch(-speed, G, dent, rates)
    if -speed + rates @ dent >= 0.0:
        assert time == 0.0
        return
    moments = np.linspace(0.0, time, 400)[1:]
    moved = -speed * moments + 0.5 * G * moments**2
    gap = np.exp(-np.outer(moments, rates)) @ dent - dent.sum() - moved
    scale = speed * time
    assert abs(gap[-1]) < 1e-9 * scale
    assert np.all(gap[:-1] > -1e-9 * scale)


def test_a_surface_that_follows_at_once_means_no_flight():
    assert time_to_touch(-0.1, G, np.array([1e-3]), np.array([1e3])) == 0.0


def test_a_plate_at_rest_changes_nothing():
    plate, dent, rate = Plate(1.0, 300.0), np.array([1e-6]), np.array([20.0])
    plain = time_to_touch(-0.05, G, dent, rate)
    assert time_to_touch(-0.05, G, dent, rate, plate, PlateState()) == pytest.approx(plain)


def test_a_ringing_plate_is_met_at_its_first_crest():
    plate, state = Plate(1.0, 300.0), PlateState(2e-4, 0.0)
    none = np.zeros(1)
    time = time_to_touch(-0.05, G, none, none, plate, state)
    moments = np.linspace(0.0, time, 4000)[1:]
    position = 2e-4 - 0.05 * moments + 0.5 * G * moments**2
    surface = np.array([plate.free(state, t).displacement for t in moments])
    assert position[-1] == pytest.approx(surface[-1], abs=1e-15)
    assert np.all(position[:-1] < surface[:-1] + 1e-15)
    assert time < 0.1 / G


def test_a_sphere_that_does_not_leave_a_plate_at_rest_touches_at_once():
    none = np.zeros(1)
    assert time_to_touch(0.0, G, none, none, Plate(1.0, 300.0), PlateState()) == 0.0


@pytest.mark.parametrize("frequency", [1e3, 1e6, 1e9])
def test_a_fast_plate_is_met_where_its_swing_is_reached(frequency):
    """Only the time within its swing is looked at, however many periods the flight has."""
    plate, state = Plate(1.0, frequency, 0.01), PlateState(0.0, 1e-3)
    time = time_to_touch(-0.05, G, np.array([1e-7]), np.array([20.0]), plate, state)
    assert time == pytest.approx(0.1 / G, rel=1e-3)

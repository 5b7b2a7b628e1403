"""Sampling of segments, and peaks between steps."""

import numpy as np
import pytest

from labpipe.contact.impact._motion import MOTION, Body, motion
from labpipe.contact.impact._trajectory import Contact, Flight, columns, peak
from tests.rounding import rounding

BODY = Body(mass=2.0, gravity=10.0, plate=None)


def record(time, position, velocity, force=0.0, radius=0.0):
    return motion(
        time=time, position=position, velocity=velocity, approach=position, force=force, contact_radius=radius
    )


def trail(*records):
    return np.array([record.item() for record in records], MOTION)


def test_a_peak_between_unequal_steps_is_exact_for_a_parabola():
    time = np.array([0.0, 0.3, 1.0, 1.1])
    values = 5.0 - (time - 0.8) ** 2
    assert peak(time, values) == pytest.approx(5.0, rel=rounding(50))


def test_a_peak_at_the_end_stays():
    assert peak(np.array([0.0, 1.0]), np.array([1.0, 3.0])) == 3.0


def test_segments_meet_without_repeating_an_instant():
    fall = Flight(record(-1.0, -5.0, 0.0), 0.0, np.array([]), np.array([]), np.array([]))
    contact = Contact(trail(record(0.0, 0.0, 10.0), record(0.1, 0.9, 8.0, 40.0, 1e-3)))
    rest = Contact(trail(contact.records[-1], record(0.2, 1.0, 0.0, 20.0, 1e-3)), is_resting=True)
    result = columns([fall, contact, rest], BODY, None)
    assert np.all(np.diff(result.time) > 0)
    assert result.time[-1] == 0.2
    asked = columns([fall, contact, rest], BODY, np.array([-0.5, 0.0, 0.05, 0.1, 0.2]))
    np.testing.assert_allclose(asked.position[[0, 1, 3, 4]], [-3.75, 0.0, 0.9, 1.0])
    np.testing.assert_allclose(asked.velocity[[0, 1, 3]], [5.0, 10.0, 8.0])
    assert asked.force[2] == pytest.approx(20.0)


def test_a_flight_between_contacts_is_sampled_evenly_from_end_to_end():
    before = Contact(trail(record(-0.2, 0.1, -8.0), record(0.0, 0.0, -10.0)))
    fly = Flight(record(0.0, 0.0, -10.0), 2.0, np.array([]), np.array([]), np.array([]))
    after = Contact(trail(record(2.0, 0.0, 10.0), record(2.1, 0.9, 8.0, 40.0, 1e-3)))
    result = columns([before, fly, after], BODY, None)
    steps = np.diff(result.time[1:-1])
    np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
    assert steps.size > 10
    last = columns([before, fly], BODY, None)
    assert last.time[-1] == 2.0

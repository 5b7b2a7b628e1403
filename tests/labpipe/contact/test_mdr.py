"""The springs of the method of dimensionality reduction against elastic closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from labpipe.contact.impact._line_springs import line_springs
from labpipe.errors import InputError
from tests.labpipe.contact.elastic_springs import elastic_force
from tests.rounding import rounding

R = 9.525e-3


@settings(max_examples=40, deadline=None)
@given(per_radius=st.floats(3, 200), a=st.floats(1e-9, 1.19e-3))
def test_hertz_is_exact_at_any_resolution(per_radius, a):
    springs = line_springs(R, 1.2e-3, 2e-4, per_radius)
    push, slope, radius = elastic_force(springs, a**2 / R)
    assert push == pytest.approx(4 / 3 * a**3 / R, rel=1e-9, abs=0.0)
    assert slope == pytest.approx(2 * a, rel=1e-9, abs=0.0)
    # Far inside the first spring the square of the radius is a difference of larger ones.
    lost = rounding(10, springs.position[1] ** 2 / a)
    assert radius == pytest.approx(a, rel=1e-9, abs=lost)


@pytest.mark.parametrize("a", [1e-4, 8e-4, 3e-3])
def test_the_exact_sphere_follows_its_closed_form(a):
    springs = line_springs(R, 4e-3, 1e-4, 200, "sphere")
    logarithm = np.log((R + a) / (R - a))
    push, _, radius = elastic_force(springs, 0.5 * a * logarithm)
    assert push == pytest.approx(0.5 * (R**2 + a**2) * logarithm - R * a, rel=2e-5)
    assert radius == pytest.approx(a, rel=1e-4)


def test_parabola_and_sphere_differ_as_stated():
    approach = (8e-4) ** 2 / R
    parabola = elastic_force(line_springs(R, 2e-3, 1e-4, 200), approach)[0]
    sphere = elastic_force(line_springs(R, 2e-3, 1e-4, 200, "sphere"), approach)[0]
    assert 1 - sphere / parabola == pytest.approx(7e-4, rel=0.1)


def test_extending_keeps_the_springs_that_were_there():
    small = line_springs(R, 1e-3, 1e-4, 50)
    large = small.extended(2e-3)
    assert large.position[-1] > 2e-3
    np.testing.assert_array_equal(large.position[: small.position.size], small.position)
    np.testing.assert_array_equal(large.weight[: small.position.size - 1], small.weight[:-1])


def test_springs_of_a_sphere_end_at_its_equator():
    springs = line_springs(R, 1.0, 1e-3, 40, "sphere")
    assert springs.position[-1] < R
    assert np.all(np.isfinite(springs.gap))


def test_an_unknown_profile_is_refused():
    with pytest.raises(InputError, match='"cone"'):
        line_springs(R, 1e-3, 1e-4, 50, "cone")


def test_pressure_and_surface_of_the_parabola_are_hertzian():
    a = 8e-4
    springs = line_springs(R, 2e-3, 1e-4, 80)
    free = a**2 / R - springs.gap
    r = np.linspace(0.0, 1.5, 151) * a
    pressure = springs.pressure(np.maximum(free, 0.0), a, r)
    expected = 2 / (np.pi * R) * np.sqrt(np.maximum(a**2 - r**2, 0.0))
    np.testing.assert_allclose(pressure, expected, rtol=1e-9, atol=1e-12 * expected[0])
    surface = springs.surface(np.maximum(free, 0.0), r)
    inside, outside = r < 0.98 * a, r > 1.02 * a
    np.testing.assert_allclose(surface[inside], a**2 / R - r[inside] ** 2 / (2 * R), rtol=1e-4)
    s = r[outside]
    hertz = ((2 * a**2 - s**2) * np.arcsin(a / s) + a * np.sqrt(s**2 - a**2)) / (np.pi * R)
    np.testing.assert_allclose(surface[outside], hertz, rtol=1e-3)

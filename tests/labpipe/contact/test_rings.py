"""The ring elements: kernel, factors, and the elastic sphere."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipk

from labpipe.contact.impact._rings import disc_displacement, factors, influence, ring_springs
from labpipe.errors import InputError
from tests.labpipe.contact.elastic_springs import elastic_force

R = 9.525e-3


def test_disc_displacement_at_centre_rim_and_far_away():
    assert disc_displacement(1e-9, 2.0) == pytest.approx(4.0)
    assert disc_displacement(2.0, 2.0) == pytest.approx(8.0 / np.pi)
    assert disc_displacement(1e4, 2.0) == pytest.approx(4.0 / 1e4, rel=1e-6)


@pytest.mark.parametrize("r", [0.3, 0.99, 1.01, 2.5])
def test_disc_displacement_is_the_integral_over_line_loads(r):
    """A ring of radius s moves r by 4 s/(pi (r+s)) K(m), m = 4 r s/(r+s)^2."""

    def ring(s):
        return 4.0 * s / (np.pi * (r + s)) * ellipk(4.0 * r * s / (r + s) ** 2)

    split = [r] if r < 1.0 else None
    expected = quad(ring, 0.0, 1.0, points=split, limit=200)[0]
    assert disc_displacement(r, 1.0) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("n_rings", [5, 64, 150])
def test_factors_multiply_to_the_influence_matrix(n_rings):
    lower, upper = factors(n_rings)
    np.testing.assert_allclose(lower @ upper, influence(n_rings), atol=1e-13 * n_rings)
    np.testing.assert_array_equal(np.triu(lower, 1), 0.0)
    np.testing.assert_array_equal(np.tril(upper, -1), 0.0)


def test_factors_are_nested():
    """The factors of a smaller disc are the leading blocks: a contact may shrink and grow."""
    np.testing.assert_allclose(factors(150).upper[:70, :70], factors(70).upper, rtol=1e-11)


@pytest.mark.parametrize("rings_per_radius", [40, 80, 160])
def test_hertz_within_the_staircase(rings_per_radius):
    a = 8e-4
    springs = ring_springs(R, 1.2 * a, a / rings_per_radius)
    errors, radii = [], []
    for trial in np.linspace(0.97, 1.03, 41) * a:
        push, _, radius = elastic_force(springs, trial**2 / R)
        errors.append(push / (4 / 3 * trial**3 / R) - 1)
        radii.append((radius - trial) / springs.width)
    # Measured with a prototype: mean 4.2e-5, 1.1e-5, 2.7e-6 and peak to peak 2e-4, 5.1e-5, 1.3e-5
    assert abs(np.mean(errors)) < 5e-5 * (40 / rings_per_radius) ** 2
    assert np.ptp(errors) < 3e-4 * (40 / rings_per_radius) ** 2
    assert np.max(np.abs(radii)) < 0.01


def test_pressure_of_the_sphere_is_hertzian():
    a, n = 8e-4, 100
    springs = ring_springs(R, a, a / n)
    approach = a**2 / R
    load = np.maximum(approach - springs.gap, 0.0)
    r = np.linspace(0.01, 1.0, 100) * a
    pressure = springs.pressure(load, a, r)
    expected = 2 / (np.pi * R) * np.sqrt(a**2 - r**2)
    np.testing.assert_allclose(pressure[:90], expected[:90], rtol=2e-3)
    assert np.all(pressure >= 0.0)
    surface = springs.surface(approach - springs.gap, r)
    np.testing.assert_allclose(surface[:90], approach - r[:90] ** 2 / (2 * R), rtol=1e-4)


def test_too_many_rings_are_refused():
    with pytest.raises(InputError, match="ring width"):
        ring_springs(R, 1e-3, 1e-8)

"""Impact at another temperature: time-temperature superposition as a law of similarity."""

import numpy as np
import pytest

from labpipe import contact, materials
from labpipe.materials import Prony

RADIUS, MASS, HEIGHT, GRAVITY, LASTS = 9.525e-3, 0.505, 1.5e-3, 9.81, 0.08


def test_a_heated_material_is_the_one_with_its_times_shifted_by_its_law() -> None:
    """Arrhenius by hand, 80 kJ/mol from 20.042 degC, as the library's file says."""
    cold, warm = materials.load("acrylic"), materials.load("acrylic", temperature=39.0)
    a_T = np.exp(80e3 / 8.31446261815324 * (1 / (39.0 + 273.15) - 1 / (20.042 + 273.15)))
    assert a_T == pytest.approx(0.1363, rel=1e-3)
    np.testing.assert_allclose(warm.rho, a_T * cold.rho, rtol=1e-12)
    by_hand = Prony(cold.E_relaxed, cold.E, a_T * cold.rho, nu=cold.nu)
    found = contact.drop(warm, RADIUS, MASS, HEIGHT, 0.03)
    expected = contact.drop(by_hand, RADIUS, MASS, HEIGHT, 0.03)
    np.testing.assert_allclose(found["force"], expected["force"], rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize(("a_T", "b_T"), [(0.1363, 1.0), (3.0, 1.0), (0.5, 0.8)])
def test_a_shifted_impact_is_the_same_impact_on_another_scale(a_T: float, b_T: float) -> None:
    """Lengths and times times a_T, moduli b_T: forces a_T² b_T, mass a_T³ b_T, gravity 1/a_T.

    The speed stays, so that the relaxation times bear the same ratio to the duration. Measured:
    the solver keeps the similarity to 9e-13.
    """
    solid = materials.load("acrylic")
    here = contact.drop(solid, RADIUS, MASS, HEIGHT, LASTS, gravity=GRAVITY)
    there = contact.drop(
        solid.shifted(a_T, b_T), a_T * RADIUS, a_T**3 * b_T * MASS, a_T * HEIGHT, a_T * LASTS, gravity=GRAVITY / a_T
    )
    assert here.sizes["impact"] == there.sizes["impact"] == 2
    scales = {
        "restitution": 1.0,
        "impact_speed": 1.0,
        "impact_time": a_T,
        "contact_duration": a_T,
        "peak_approach": a_T,
        "peak_contact_radius": a_T,
        "peak_force": a_T**2 * b_T,
        "energy_dissipated": a_T**3 * b_T,
    }
    for name, scale in scales.items():
        np.testing.assert_allclose(there[name], scale * here[name], rtol=1e-11, err_msg=name)


def test_all_moduli_times_a_factor_are_an_impact_of_a_mass_divided_by_it() -> None:
    """With b_T alone: E → bE and m → bm leave the motion, and forces grow by b."""
    solid = materials.load("acrylic")
    one = contact.drop(solid, RADIUS, MASS, HEIGHT, 0.03)
    other = contact.drop(solid.scaled(1.25), RADIUS, 1.25 * MASS, HEIGHT, 0.03)
    np.testing.assert_allclose(other["approach"], one["approach"], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(other["peak_force"], 1.25 * one["peak_force"], rtol=1e-9)

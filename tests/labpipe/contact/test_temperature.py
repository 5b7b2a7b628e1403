"""Impact at another temperature: time-temperature superposition as a law of similarity."""

import numpy as np
import pytest

from labpipe import contact, materials

RADIUS, MASS, HEIGHT, GRAVITY, LASTS = 9.525e-3, 0.505, 1.5e-3, 9.81, 0.08


@pytest.mark.parametrize(("a_T", "b_T"), [(0.1363, 1.0), (0.5, 0.8)])
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

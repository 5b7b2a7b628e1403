"""The rig's own periodic indentation against the tapping reference and elastic closed forms."""

import numpy as np
import pytest

from pipelines.rig.reference_indentation import reference_indentation
from pipelines.rig.solids import SOLIDS, Element, Viscoelastic

GEOMETRY = {"tip_radius": 2e-3, "period": 8e-3, "depth": 1.0}


def test_tapping_of_the_standard_linear_solid() -> None:
    time = np.linspace(0, 2, 8001)
    displacement = 2e-4 * (0.2 - 0.8 * np.cos(2 * np.pi * time))
    force, half_width = reference_indentation(
        Viscoelastic((Element(2e9, 0.025),), 2e9, 0.35), time=time, displacement=displacement, **GEOMETRY
    )
    at = [round(t * 4000) for t in (0.25, 0.40, 0.50, 0.60, 0.70)]
    np.testing.assert_allclose(force[at], [76097.57, 347012.22, 393383.73, 280053.48, 93998.13], rtol=4e-6)
    np.testing.assert_allclose(half_width[at] / 8e-3, [0.029436, 0.072878, 0.081384, 0.069640, 0.040454], atol=2e-4)
    assert force.max() == pytest.approx(397765.82, rel=2e-6)
    second = slice(4000, 8001)
    loss = np.trapezoid(force[second], displacement[second])
    assert loss == pytest.approx(12.82979, rel=2e-5)


@pytest.mark.parametrize(
    ("half_width", "force", "approach"),
    [(0.05, 0.001971623489289, 0.0029522075916386), (0.2, 0.033730559443818, 0.021063410887972)],
)
def test_the_elastic_closed_form(half_width: float, force: float, approach: float) -> None:
    """Rows of the table P R/(E* λ²) and δ R/λ² of the parabolic tip on a half-plane."""
    depth = approach * 8e-3**2 / 2e-3
    found, width = reference_indentation(
        Viscoelastic((), 1.0, 0.0), time=np.array([0.0, 1.0]), displacement=np.array([0.0, depth]), **GEOMETRY
    )
    assert found[1] == pytest.approx(force * 8e-3**2 / 2e-3, rel=3e-5)
    assert width[1] / 8e-3 == pytest.approx(half_width, abs=3e-4)


def test_a_step_of_displacement_relaxes_as_the_modulus() -> None:
    time = np.concatenate([[0.0, 1e-9], np.geomspace(1e-4, 10, 60)])
    displacement = np.where(time > 0, 1e-4, 0.0)
    solid = SOLIDS["nbr"].at()
    force, _ = reference_indentation(solid, time=time, displacement=displacement, **GEOMETRY)
    modulus = solid.relaxation(np.maximum(time, 5e-10))
    np.testing.assert_allclose(force[2:] / force[2], modulus[2:] / modulus[2], rtol=3e-6)

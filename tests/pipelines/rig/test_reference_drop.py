"""The rig's own drop against published tables and closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from labpipe import contact
from labpipe.materials import Prony
from pipelines.rig.reference_drop import Floor, Trajectory, reference_drop
from pipelines.rig.solids import Element, Viscoelastic

ELASTIC = Viscoelastic((), 3.2e9, 0.35)
BODY = {"radius": 9.525e-3, "mass": 0.505}


def paraboloid(position: np.ndarray, radius: float) -> np.ndarray:
    """The profile of the published tables."""
    return position**2 / radius


def standard_linear_solid(height: float, duration: float, floor: Floor | None = None) -> Trajectory:
    """E from 2 to 4 GPa, one retardation time of 1 ms, hence a relaxation time of 0.5 ms."""
    solid = Viscoelastic((Element(2e9, 0.5e-3),), 2e9, 0.35)
    return reference_drop(solid, height=height, duration=duration, floor=floor, profile=paraboloid, **BODY)


@pytest.fixture(scope="module")
def train() -> Trajectory:
    return standard_linear_solid(1.5e-3, 0.13)


def test_the_bounce_train_of_the_standard_linear_solid(train: Trajectory) -> None:
    """Ting's integral and a fine MDR: touch times, speeds and restitution, height 1.5 mm."""
    touch = [0.0, 0.026442691, 0.045524494, 0.068560063, 0.075008460]
    rows = [0, 1, 2, 4, 5]
    np.testing.assert_allclose(train.touch[rows] - train.touch[0], touch, rtol=2e-5, atol=1e-9)
    restitution = train.outgoing_speed / train.incoming_speed[: train.outgoing_speed.size]
    np.testing.assert_allclose(
        restitution[rows], [0.72887820, 0.71789195, 0.70453813, 0.65656622, 0.58239721], rtol=6e-4
    )
    np.testing.assert_allclose(restitution[0], 0.72887820, rtol=5e-5)
    assert train.touch.size == train.liftoff.size + 1  # the last touch is permanent


def test_the_first_impact_has_the_force_and_radius_of_the_table(train: Trajectory) -> None:
    assert train.force.max() == pytest.approx(257.50634, rel=1e-5)
    assert train.contact_radius.max() == pytest.approx(8.00166e-4, rel=1e-3)
    assert -train.height.min() == pytest.approx(6.721988e-5, rel=1e-5)


def test_an_elastic_whole_sphere_is_pressed_in_as_the_closed_form_says() -> None:
    """F = E* ((a² + R²) artanh(a/R) − a R) at the approach a artanh(a/R); its work is the energy of the fall."""
    R, modulus = BODY["radius"], ELASTIC.unrelaxed / (1 - ELASTIC.nu**2)
    found = reference_drop(ELASTIC, height=10e-3, duration=0.06, **BODY)
    a = np.linspace(0.0, 0.2 * R, 20_001)[1:]
    approach, force = a * np.arctanh(a / R), modulus * ((a**2 + R**2) * np.arctanh(a / R) - a * R)
    assert found.contact_radius.max() > 0.1 * R
    np.testing.assert_allclose(np.interp(-found.height.min(), approach, force), found.force.max(), rtol=1e-4)
    np.testing.assert_allclose(np.interp(-found.height.min(), approach, a), found.contact_radius.max(), rtol=2e-3)
    work = np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(approach))
    fallen = BODY["mass"] * 9.81 * (10e-3 + approach[1:])
    deepest = approach[1:][np.searchsorted(work - fallen, 0.0)]
    np.testing.assert_allclose(-found.height.min(), deepest, rtol=1e-4)


def test_two_elastic_bodies_touch_as_long_and_as_wide_as_hertz_says() -> None:
    """1/E* is the sum of both; the energy of the fall gives the depth, and the time as an integral over it."""
    disc, R, m = (1 - 0.22**2) / 70e9, BODY["radius"], BODY["mass"]
    softness = (1 - ELASTIC.nu**2) / ELASTIC.unrelaxed + disc
    found = reference_drop(ELASTIC, height=1.5e-3, duration=0.03, profile=paraboloid, disc=disc, **BODY)

    def square_of_speed(depth: float) -> float:
        return 2 * 9.81 * (1.5e-3 + depth) - 16 / 15 * np.sqrt(R) * depth**2.5 / softness / m

    deepest = brentq(square_of_speed, 1e-5, 1e-3)
    # the substitution depth = deepest (1 - s^2) removes the root at the end
    time, _ = quad(lambda s: 4 * deepest * s / np.sqrt(square_of_speed(deepest * (1 - s * s))), 0.0, 1.0)
    assert found.liftoff[0] - found.touch[0] == pytest.approx(time, rel=1e-3)
    assert -found.height.min() == pytest.approx(deepest, rel=1e-4)
    assert found.contact_radius.max() == pytest.approx(np.sqrt(R * deepest), rel=2e-3)  # a spring is 0.25 % of it
    made = contact.drop(Prony(3.2e9, [], [], nu=0.35), R, m, 1.5e-3, 0.03, substrate=("70 GPa", 0.22))
    assert float(made["contact_duration"][0]) == pytest.approx(time, rel=1e-3)
    assert float(made["peak_contact_radius"][0]) == pytest.approx(np.sqrt(R * deepest), rel=1e-3)


def test_a_moving_floor_takes_energy_and_a_heavy_one_takes_none() -> None:
    rigid = standard_linear_solid(5e-3, 0.05)
    heavy = standard_linear_solid(5e-3, 0.05, Floor(mass=1e9))
    light = standard_linear_solid(5e-3, 0.05, Floor(mass=20.0))
    assert heavy.outgoing_speed[0] == pytest.approx(rigid.outgoing_speed[0], rel=1e-5)
    assert light.outgoing_speed[0] < 0.995 * rigid.outgoing_speed[0]
    assert np.abs(light.floor).max() > 1e-6

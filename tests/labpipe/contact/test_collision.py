"""Appendix A: the dashpot sphere's table, the corrected stiffness, and energy."""

import warnings

import numpy as np
import pytest

from labpipe.contact._collision import collision, contact_stiffness
from labpipe.errors import InputError

RADIUS, MASS = 9.525e-3, 0.505

# b, restitution and contact time of x'' + b sqrt(x) x' + x^{3/2} = 0, x'(0) = 1, until F = 0.
DASHPOT = [(0.1, 0.8928588755, 3.15725566), (3.0, 0.1337166224, 2.27385627)]


def scaled(damping: float):
    """A collision with k/m = 1e15 and unit speed: gravity is 1e-7 of everything else."""
    stiffness = contact_stiffness(RADIUS, 1e9, 0.3)
    mass = stiffness / 1e15
    return collision(
        RADIUS, mass, 5.0, youngs_modulus=1e9, nu=0.3, damping=damping * mass * 1e9, gravity=0.1, duration=10.001
    )


@pytest.mark.parametrize(("damping", "restitution", "duration"), DASHPOT)
def test_one_impact_matches_the_dashpot_table(damping, restitution, duration) -> None:
    found = scaled(damping)
    assert float(found.restitution[0]) == pytest.approx(restitution, rel=1e-6)
    assert float(found.contact_duration[0]) * 1e6 == pytest.approx(duration, rel=2e-6)


def test_printed_stiffness_is_half_the_right_one() -> None:
    right = contact_stiffness(RADIUS, 3.2e9, 0.35)
    assert right == pytest.approx(4 * 3.2e9 * np.sqrt(RADIUS) / (3 * (1 - 0.35**2)))
    assert contact_stiffness(RADIUS, 3.2e9, 0.35, as_printed=True) == pytest.approx(right / 2)
    printed = collision(RADIUS, MASS, 1.5e-3, duration=0.03, as_printed=True)
    default = collision(RADIUS, MASS, 1.5e-3, duration=0.03)
    assert float(printed.peak_overlap[0] / default.peak_overlap[0]) == pytest.approx(2**0.4, rel=0.01)


@pytest.mark.parametrize("as_printed", [False, True])
def test_plasticity_leaves_a_dent_and_the_force_never_pulls(as_printed) -> None:
    found = collision(RADIUS, MASS, 5e-3, damping=15e3, yield_depth=60e-6, duration=0.2, as_printed=as_printed)
    dents = found.permanent_overlap.values
    assert dents[0] > 0.0
    assert np.all(np.diff(dents) >= 0.0)
    assert float(found.force.min()) == 0.0
    left = found.dropna("impact")
    assert np.all(left.energy_dissipated.values > 0.0)
    assert np.all((left.restitution.values > 0.0) & (left.restitution.values < 1.0))


def test_printed_unloading_is_reported_when_it_makes_energy() -> None:
    with pytest.warns(UserWarning, match="gained energy"):
        collision(RADIUS, MASS, 1.5e-3, unloading_multiplier=1.3, duration=0.03, as_printed=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        collision(RADIUS, MASS, 1.5e-3, duration=0.1, as_printed=True)


@pytest.mark.parametrize(
    "wrong",
    [
        {"height": 0.0},
        {"mass": -1.0},
        {"damping": -1.0},
        {"yield_depth": 0.0},
        {"unloading_multiplier": 0.5},
        {"rtol": 0.1},
        {"time": [0.0, 0.0]},
        {"time": [0.0, 9.0]},
    ],
)
def test_values_outside_the_domain_are_refused(wrong) -> None:
    arguments = {"radius": RADIUS, "mass": MASS, "height": 1.5e-3} | wrong
    with pytest.raises(InputError):
        collision(**arguments)


def test_the_first_impacts_are_those_of_the_whole_run() -> None:
    law = {"damping": 15e3, "yield_depth": 5e-5, "unloading_multiplier": 1.2}
    few, all_of_them = (collision(9.525e-3, 0.505, 5e-3, duration=0.2, impacts=n, **law) for n in (2, None))
    assert few.sizes["impact"] == 2 < all_of_them.sizes["impact"]
    for name in ("restitution", "impact_time", "peak_overlap"):
        np.testing.assert_array_equal(few[name], all_of_them[name][:2])
    assert float(few.time[-1]) == pytest.approx(float(few.impact_time[1] + few.contact_duration[1]), rel=1e-12)

"""Appendix A: the dashpot sphere's table, the corrected stiffness, and energy."""

import warnings

import numpy as np
import pytest

from labpipe.contact._collision import collision, contact_stiffness
from labpipe.errors import InputError

RADIUS, MASS = 9.525e-3, 0.505


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
        {"damping": -1.0},
        {"yield_depth": 0.0},
        {"unloading_multiplier": 0.5},
        {"rtol": 0.1},
        {"time": [0.0, 9.0]},
    ],
)
def test_values_outside_the_domain_are_refused(wrong) -> None:
    arguments = {"radius": RADIUS, "mass": MASS, "height": 1.5e-3} | wrong
    with pytest.raises(InputError):
        collision(**arguments)

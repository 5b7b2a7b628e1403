"""Adhesion of a sphere: JKR against its energy, Hertz, and the published numbers."""

import numpy as np
import pytest

from labpipe.contact import adhesion_in_impact, adhesive_states
from labpipe.contact._adhesion import Jkr
from labpipe.contact.sphere.hertz import static_load
from labpipe.errors import InputError
from labpipe.materials import Prony, load

R, E, W = 0.01, 1e6, 0.05


def test_jkr_parts_at_three_halves_pi_w_r() -> None:
    radii, contact = np.geomspace(1e-6, 1e-3, 200_001), Jkr(R, E, W)
    force, _ = contact.state(radii)
    assert force.min() == pytest.approx(-1.5 * np.pi * W * R, rel=1e-8)
    assert contact.pull_off == pytest.approx(1.5 * np.pi * W * R)
    parted = np.cbrt(9 * np.pi * W * R**2 / (8 * E))  # a³ = 9πwR²/8E*
    assert radii[force.argmin()] == pytest.approx(parted, rel=1e-4)


def test_a_load_gives_the_stable_contact_that_carries_it() -> None:
    loads = np.array([-1.4, -0.5, 0.0, 2.0, 1e3]) * np.pi * W * R
    contact = Jkr(R, E, W)
    radii = np.array([contact.contact_radius(load) for load in loads])
    assert contact.state(radii)[0] == pytest.approx(loads, rel=1e-9, abs=1e-12)
    hertz = static_load(1.0, R, E)
    assert Jkr(R, E, 0.0).contact_radius(1.0) == pytest.approx(float(hertz.contact_radius))


def test_the_energy_lost_and_the_regimes_are_the_published_ones() -> None:
    assert Jkr(R, E, W).lost_energy == pytest.approx(7.092 * (W**5 * R**4 / E**2) ** (1 / 3), rel=1e-4)
    assert Jkr(R, E, W).tabor == pytest.approx((R * W**2 / (E**2 * 0.3e-9**3)) ** (1 / 3))
    stiff, middle = Jkr(1e-9, 1e11, 1e-3), Jkr(1e-6, 1e10, 0.05)
    assert [stiff.regime, middle.regime, Jkr(R, E, W).regime] == ["DMT", "transition", "JKR"]
    assert stiff.pull_off == pytest.approx(2.0 * np.pi * 1e-3 * 1e-9)


def test_adhesion_is_negligible_for_the_sphere_of_the_drops_and_not_for_soft_dust() -> None:
    drop = adhesion_in_impact(load("acrylic"), 9.525e-3, 0.505, 0.17, 1.2e-3, 260.0)
    assert drop.verdict == "negligible"
    assert drop.pull_off == pytest.approx(2.244e-3, rel=1e-3)
    dust = adhesion_in_impact(Prony(1e6, [], [], nu=0.5), 1e-4, 4e-9, 0.1, 1e-3, 1e-6)
    assert dust.verdict == "may matter"


def test_bad_values_are_refused() -> None:
    with pytest.raises(InputError, match="work"):
        Jkr(R, E, -1.0)
    with pytest.raises(InputError, match="reduce the load"):
        adhesive_states(Prony(1e6, [], [], nu=0.5), R, W, 1e9)

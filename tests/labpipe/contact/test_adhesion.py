"""Adhesion: closed forms of JKR and DMT, Maugis between them, and any profile by MDR."""

import numpy as np
import pytest
from scipy.integrate import quad

from labpipe.contact import (
    adhesion_in_impact,
    adhesive_indentation,
    adhesive_pull_off,
    dmt,
    jkr,
    jkr_at_force,
    maugis,
    pull_off,
    tabor,
)
from labpipe.contact.beyond._adhesion import cohesive_stress, lost_energy, maugis_parameter, regime
from labpipe.contact.beyond._adhesive_mdr import slope_of
from labpipe.contact.sphere.hertz import static_load
from labpipe.errors import InputError
from labpipe.materials import Prony, load
from tests.rounding import rounding

R, E, W = 0.01, 1e6, 0.05
WIDTH = (np.pi * W * R**2 * 0.75 / E) ** (1 / 3)
RADII = np.array([0.1, 0.5, 0.8, 1.0, 2.0, 4.0]) * WIDTH


def stress_of(rate: float) -> float:
    """Cohesive stress at which Maugis's parameter has a value."""
    return rate * float((2.0 * np.pi * W * E**2 / (9.0 * R)) ** (1 / 3))


def test_jkr_holds_its_published_numbers() -> None:
    """Pull-off −3πwR/2 under load, −5πwR/6 at fixed displacement, contact at zero load."""
    scale = np.pi * W * R
    at_pull_off = jkr((9 * np.pi * W * R**2 / (8 * E)) ** (1 / 3), R, E, W)
    assert float(at_pull_off.force) == pytest.approx(-1.5 * scale, rel=1e-13)
    parted = jkr((np.pi * W * R**2 / (8 * E)) ** (1 / 3), R, E, W)
    assert float(parted.force) == pytest.approx(-5 / 6 * scale, rel=1e-13)
    free = jkr_at_force(0.0, R, E, W)
    assert float(free.contact_radius) ** 3 == pytest.approx(9 * np.pi * W * R**2 / (2 * E), rel=1e-6, abs=0.0)
    assert float(jkr(free.contact_radius, R, E, W).force) == pytest.approx(0.0, abs=1e-12 * scale)
    assert pull_off(R, E, W) == pytest.approx(1.5 * scale, rel=rounding(10))


def test_a_load_gives_the_stable_contact_that_carries_it() -> None:
    loads = np.array([-1.49, -1.0, 0.0, 3.0, 1e4]) * np.pi * W * R
    found = jkr_at_force(loads, R, E, W)
    np.testing.assert_allclose(jkr(found.contact_radius, R, E, W).force, loads, rtol=1e-9, atol=1e-12)
    assert np.all(np.diff(found.contact_radius) > 0.0)


def test_without_adhesion_it_is_hertz() -> None:
    loads = np.array([0.1, 1.0, 10.0])
    hertz = static_load(loads, R, E)
    found = jkr_at_force(loads, R, E, 0.0)
    np.testing.assert_allclose(found.contact_radius, hertz.contact_radius, rtol=rounding(50))
    np.testing.assert_allclose(found.indentation, hertz.approach, rtol=1e-13)
    np.testing.assert_allclose(dmt(found.contact_radius, R, E, 0.0).force, loads, rtol=1e-13)


def test_the_work_of_a_state_is_the_work_of_adhesion() -> None:
    """Griffith: at fixed displacement the elastic energy falls by w for every area of contact."""
    a, d = 2.0 * WIDTH, 1e-5
    force = jkr(a, R, E, W)

    def elastic(radius: float) -> float:
        """Energy at the displacement of the state: Hertz up to a, then a flat punch back."""
        punch = radius**2 / R - float(force.indentation)
        press = 8.0 * E * radius**5 / (15.0 * R**2)
        return press - 4.0 / 3.0 * E * radius**3 / R * punch + E * radius * punch**2

    step = a * d
    slope = (elastic(a + step) - elastic(a - step)) / (2.0 * step)
    assert slope == pytest.approx(2.0 * np.pi * a * W, rel=1e-8)


@pytest.mark.parametrize("rate", [0.03, 0.3, 1.0, 3.0, 30.0])
def test_maugis_agrees_with_the_springs_that_know_nothing_of_his_formulas(rate: float) -> None:
    """Closed form against quadrature over one-dimensional springs: measured 2e-13 and less."""
    stress = stress_of(rate)
    assert maugis_parameter(R, E, W, stress) == pytest.approx(rate, rel=1e-13)
    closed = maugis(RADII, R, E, W, stress)
    springs = adhesive_indentation(slope_of("parabola", R), RADII, E, W, stress)
    scale = np.pi * W * R
    np.testing.assert_allclose(closed.force, springs.force, rtol=1e-11, atol=1e-12 * scale)
    np.testing.assert_allclose(closed.indentation, springs.indentation, rtol=1e-11, atol=1e-19)
    np.testing.assert_allclose(closed.cohesive_radius, springs.cohesive_radius, rtol=1e-12)


def test_maugis_ends_in_jkr_and_in_dmt() -> None:
    """Force off by 20 πwR/λ² near JKR and 50 πwR λ near DMT, at these radii, as measured."""
    scale = np.pi * W * R

    def apart(rate: float, limit: np.ndarray) -> float:
        return float(np.abs(maugis(RADII, R, E, W, stress_of(rate)).force - limit).max() / scale)

    soft, stiff = jkr(RADII, R, E, W).force, dmt(RADII, R, E, W).force
    assert apart(1e4, soft) == pytest.approx(2.0e-7, rel=0.01)
    assert apart(1e3, soft) / apart(1e4, soft) == pytest.approx(100.0, rel=1e-3)
    assert apart(1e-5, stiff) == pytest.approx(5.0e-4, rel=0.01)
    assert apart(1e-4, stiff) / apart(1e-5, stiff) == pytest.approx(10.0, rel=0.02)


def test_pull_off_runs_from_dmt_to_jkr_as_the_published_fit() -> None:
    """Carpick, Ogletree, Salmeron (1999): −7/4 + (4.04 λ^1.4 − 1)/(4.04 λ^1.4 + 1)/4, to 1.3 %."""
    rates = np.array([0.01, 0.1, 0.5, 1.0, 2.0, 5.0, 20.0])
    found = np.array([pull_off(R, E, W, "maugis", stress_of(r)) for r in rates])
    found /= np.pi * W * R
    power = 4.04 * rates**1.4
    np.testing.assert_allclose(found, 1.75 - 0.25 * (power - 1) / (power + 1), rtol=0.013)
    assert np.all(np.diff(found) < 0.0)
    assert found[0] < pull_off(R, E, W, "dmt") / (np.pi * W * R)
    assert found[-1] > 1.5


def test_tabor_and_maugis_parameters_are_in_the_ratio_of_the_published_potential() -> None:
    rate = maugis_parameter(R, E, W, cohesive_stress(W))
    assert rate / tabor(R, E, W) == pytest.approx(1.157, abs=5e-4)
    assert [regime(m) for m in (0.01, 1.0, 30.0)] == ["DMT", "Maugis", "JKR"]


def test_the_energy_of_sticking_is_the_area_under_the_jkr_curve() -> None:
    ends = ((np.pi * W * R**2 / (8 * E)) ** (1 / 3), (2 * np.pi * W * R**2 / E) ** (1 / 3))

    def integrand(a: float) -> float:
        stretch = 2.0 * a / R - 0.5 * np.sqrt(2.0 * np.pi * W / (E * a))
        return float(jkr(a, R, E, W).force) * float(stretch)

    area, _ = quad(integrand, ends[1], ends[0], epsabs=0.0, epsrel=1e-11)
    assert lost_energy(R, E, W) == pytest.approx(area, rel=1e-10, abs=0.0)
    johnson = 7.09 * (W**5 * R**4 / E**2) ** (1 / 3)
    assert lost_energy(R, E, W) == pytest.approx(johnson, rel=5e-4)


def test_springs_with_the_edge_stretched_are_jkr() -> None:
    springs = adhesive_indentation(slope_of("parabola", R), RADII, E, W)
    closed = jkr(RADII, R, E, W)
    np.testing.assert_allclose(springs.force, closed.force, rtol=1e-12)
    np.testing.assert_allclose(springs.indentation, closed.indentation, rtol=1e-12)
    limits = (0.1 * WIDTH, 10.0 * WIDTH)
    held = adhesive_pull_off(slope_of("parabola", R), E, W, limits)
    assert held == pytest.approx(1.5 * np.pi * W * R, rel=1e-12)


@pytest.mark.parametrize("slope", [0.1, 1.0])
def test_a_cone_parts_at_the_published_force(slope: float) -> None:
    """Maugis and Barquins 1981: F = 54 w²/(π E* tan³θ)."""
    limits = np.array([0.01, 100.0]) * W / (slope**2 * E)
    held = adhesive_pull_off(slope_of("cone", slope), E, W, (limits[0], limits[1]))
    assert held == pytest.approx(54.0 * W**2 / (np.pi * E * slope**3), rel=1e-11, abs=0.0)


def test_a_flat_end_parts_at_kendalls_force() -> None:
    state = adhesive_indentation(slope_of("flat", 1.0), [2e-3], E, W)
    assert float(-state.force[0]) == pytest.approx(np.sqrt(8.0 * np.pi * E * W * 8e-9), rel=rounding(50))


def test_an_exact_sphere_without_adhesion_is_the_closed_form_of_sneddon() -> None:
    """F = E*[(R² + a²)/2 ln((R+a)/(R−a)) − aR], δ = (a/2) ln((R+a)/(R−a))."""
    a = np.array([0.1, 0.3, 0.5]) * R
    found = adhesive_indentation(slope_of("sphere", R), a, E, 0.0)
    logarithm = np.log((R + a) / (R - a))
    np.testing.assert_allclose(found.indentation, 0.5 * a * logarithm, rtol=1e-12)
    force = E * (0.5 * (R**2 + a**2) * logarithm - a * R)
    np.testing.assert_allclose(found.force, force, rtol=1e-10)


def test_adhesion_is_negligible_for_the_sphere_of_the_drops_and_not_for_soft_dust() -> None:
    drop = adhesion_in_impact(load("acrylic"), 9.525e-3, 0.505, 0.1716, 1.23e-3, 260.0)
    assert drop.verdict == "negligible"
    assert drop.regime == "JKR"
    assert drop.pull_off == pytest.approx(1.5 * np.pi * 0.05 * 9.525e-3, rel=1e-3)
    assert drop.pull_off_bound > drop.pull_off
    gel = Prony(5e4, [5e4], [1e-3], nu=0.5)
    dust = adhesion_in_impact(gel, 5e-6, 5e-13, 0.01, 1e-4, 1e-9)
    assert dust.verdict == "may matter"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jkr_at_force(-1.0, R, E, W), "holds 0.002356 N and no more"),
        (lambda: jkr(-1.0, R, E, W), "contact_radius is -1.0 m"),
        (lambda: jkr(1.0, R, E, np.nan), "work is nan"),
        (lambda: pull_off(R, E, W, "other"), 'theory "other" is unknown'),  # type: ignore[arg-type]
        (lambda: maugis(0.0, R, E, W, 1e6), "needs more than 0"),
        (lambda: adhesive_indentation(slope_of("parabola", R), [0.0], E, W), "expected positive"),
        (lambda: slope_of("cube", 1.0), 'shape "cube" is unknown'),
        (lambda: adhesion_in_impact(load("acrylic"), R, 1.0, 0.0, 1.0, 1.0), "speed is 0"),
        (lambda: tabor(R, E, W, 0.0), "equilibrium_distance is 0"),
    ],
)
def test_bad_values_are_refused(call: object, message: str) -> None:
    assert callable(call)
    with pytest.raises(InputError, match=message):
        call()

"""Stress, energies and inequalities of a solid under any strain."""

import numpy as np
import pytest

from labpipe import materials
from labpipe.errors import InputError
from labpipe.materials import Prony, entropy_inequality, inequalities, respond
from tests.rounding import rounding

SOLID = Prony(2e6, [3e6, 1e7], [0.3, 1e-3], nu=0.4)


def test_a_step_relaxes_with_the_modulus():
    time = np.concatenate([[0.0, 0.0], np.geomspace(1e-5, 10.0, 50)])
    made = respond(SOLID, time, np.append(0.0, np.full(51, 1e-2)))
    np.testing.assert_allclose(made.stress[1:], 1e-2 * SOLID.relaxation(time[1:]), rtol=rounding(100))
    np.testing.assert_allclose(respond(SOLID, time[1:], np.full(51, 1e-2)).stress, made.stress[1:], rtol=rounding(10))


def test_a_sine_settles_at_the_complex_modulus():
    omega, cycles, samples = 20.0, 12, 400
    time = np.linspace(0.0, cycles * 2 * np.pi / omega, cycles * samples + 1)
    made = respond(SOLID, time, 1e-3 * np.sin(omega * time))
    modulus = complex(SOLID.complex_modulus(omega))
    last = time >= time[-1] - 2 * np.pi / omega - 1e-12
    expected = 1e-3 * np.abs(modulus) * np.sin(omega * time[last] + np.angle(modulus))
    np.testing.assert_allclose(made.stress[last], expected, atol=1e-4 * np.abs(expected).max())
    lost = np.diff(made.dissipated_energy.values[last][[0, -1]])[0]
    assert lost == pytest.approx(np.pi * modulus.imag * 1e-6, rel=1e-4)


def test_energies_balance_and_nothing_is_gained():
    rng = np.random.default_rng(0)
    time, strain = np.cumsum(rng.exponential(0.005, 400)), np.cumsum(rng.standard_normal(400)) * 1e-3
    made = respond(SOLID, time, strain, heat_capacity=2e6)
    assert np.all(made.dissipation_rate >= 0)  # (1.20)
    assert np.all(np.diff(made.dissipated_energy) >= 0)  # (1.22)
    assert np.all(made.work >= made.stored_energy)  # (1.23)
    assert np.all(made.stored_energy >= 0)  # (1.25)
    # The work by itself: the trapezoid of chords that are a twentieth of the shortest time.
    slow = Prony(2e6, [3e6, 1e7], [0.3, 2e-3])
    fine = np.unique(np.concatenate([time, np.linspace(time[0], time[-1], 20_001)]))
    there = respond(slow, fine, np.interp(fine, time, strain))
    jump = 0.5 * slow.E_unrelaxed * strain[0] ** 2
    done = jump + np.trapezoid(there.stress.values, there.strain.values)
    assert done == pytest.approx(float(respond(slow, time, strain).work[-1]), rel=1e-3)
    np.testing.assert_allclose(made.temperature_rise, made.dissipated_energy / 2e6, rtol=rounding(10))


def test_every_library_solid_obeys_the_inequalities():
    for name in ("acrylic", "peek", "nylon", "ptfe", "nbr"):
        solid = materials.load(name)
        assert all(row.holds for row in inequalities(solid.E_relaxed, solid.E, solid.rho)), name


@pytest.mark.parametrize(
    ("relaxed", "E", "rho", "failing"),
    [
        # A negative weight of short time: E(t) rises at first, memory and convexity fail with it.
        (1.0, [1.0, -0.1], [1.0, 1e-3], {"1.8", "1.20", "1.21, 1.24", "1.25 text", "1.20, 1.25"}),
        # One of long time behind a strong term: E(t) rises late and gains work slowly.
        (1.0, [1.0, -0.5], [1e-3, 1.0], {"1.20", "1.21, 1.24", "1.25 text", "1.8", "1.20, 1.25"}),
        # A modulus that ends below zero, though it falls and is convex.
        (-0.5, [1.0], [1.0], {"1.25", "1.20, 1.25"}),
        # Every step and every cycle is in order; a history that ends with the second element alone strained is not.
        (2.0, [2.0, -0.1], [1.0, 0.5], {"1.20, 1.25"}),
    ],
)
def test_inadmissible_terms_fail_where_they_should(relaxed, E, rho, failing):
    assert {row.equation for row in inequalities(relaxed, E, rho) if not row.holds} == failing


@pytest.mark.parametrize(
    ("time", "strain", "said"),
    [
        ([0.0, 1.0], [0.0], "equal length"),
        ([0.0, 2.0, 1.0], [0.0, 1.0, 1.0], r"time\[2\]"),
        ([0.0, np.nan], [0.0, 1.0], "finite"),
    ],
)
def test_histories_that_do_not_fit_are_refused(time, strain, said):
    with pytest.raises(InputError, match=said):
        respond(SOLID, time, strain)


def test_a_dashpot_in_parallel_and_a_wrong_heat_capacity_are_refused():
    with pytest.raises(InputError, match="dashpot"):
        respond(Prony(1.0, [], [], viscosity=1.0), [0.0], [0.0])
    with pytest.raises(InputError, match="heat_capacity"):
        respond(SOLID, [0.0], [0.0], heat_capacity=-1.0)
    with pytest.raises(InputError, match="positive"):
        inequalities(1.0, [1.0], [0.0])


def test_free_expansion_is_without_stress_and_a_held_bar_relaxes():
    time = np.array([0.0, 0.1, 1.0, 30.0])
    warm, expansion = np.array([0.0, 5.0, 20.0, 20.0]), 1e-4
    free = respond(SOLID, time, expansion * warm, temperature=warm, expansion=expansion)
    np.testing.assert_allclose(free.stress, 0.0, atol=1e-9)
    held = respond(SOLID, time, np.zeros(4), temperature=warm, expansion=expansion)
    assert float(held.stress[-1]) == pytest.approx(-SOLID.E_relaxed * expansion * 20.0, rel=1e-6)
    np.testing.assert_allclose(held.work, 0.0, atol=1e-12 * SOLID.E_relaxed)  # nobody moves its ends
    assert np.all(held.dissipation_rate >= 0)  # (1.19)


def test_work_under_a_changing_temperature_is_the_integral_of_the_stress():
    rng = np.random.default_rng(3)
    time = np.linspace(0.0, 2.0, 30)
    strain, warm = 1e-3 * np.cumsum(rng.standard_normal((2, 30)), axis=1) * np.array([[1.0], [1e3]])
    made = respond(SOLID, time, strain, temperature=warm, expansion=7e-5)
    fine = np.linspace(0.0, 2.0, 29 * 4000 + 1)
    there = respond(SOLID, fine, np.interp(fine, time, strain), temperature=np.interp(fine, time, warm), expansion=7e-5)
    first = 0.5 * float(there.stress[0]) * strain[0]
    done = first + np.trapezoid(there.stress.values, there.strain.values)
    assert float(made.work[-1]) == pytest.approx(done, rel=1e-4)
    assert np.all(np.diff(made.dissipated_energy) >= 0)


def test_heat_only_flows_to_the_colder_side():
    assert entropy_inequality([0.0, 1.0], [-200.0, 0.0], 0.25, 293.0).min() > 0
    with pytest.raises(InputError, match="hotter side"):
        entropy_inequality([0.0], [1.0], -0.25, 293.0)
    with pytest.raises(InputError, match="thermal expansion"):
        respond(SOLID, [0.0], [0.0], temperature=[1.0])
    with pytest.raises(InputError, match="for each of 1 times"):
        respond(SOLID, [0.0], [0.0], temperature=[1.0, 2.0], expansion=1e-4)

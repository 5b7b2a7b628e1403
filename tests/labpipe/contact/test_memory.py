"""The exponential memory against closed forms, at every ratio of step to retardation time."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from labpipe.contact.memory._creep import Creep, advance, condense, history, step_weights
from labpipe.errors import InputError
from labpipe.materials import Prony
from tests.rounding import rounding

PMMA15 = Creep.from_terms(1 / 6e9, np.full(15, (1 / 2e9 - 1 / 6e9) / 15), np.logspace(-10, 2, 15), nu=0.35)


def displacement_under(creep, times, loads, *, hold=False):
    """Displacement at every time for a load that is linear between them."""
    memory, out = creep.rest(1), [creep.instantaneous * loads[0]]
    for i, dt in enumerate(np.diff(times)):
        weights = step_weights(creep, dt, hold=hold)
        old, new = np.array([loads[i]]), np.array([loads[i + 1]])
        out.append(float((history(weights, memory, old) + weights.compliance * new)[0]))
        memory = advance(weights, memory, old, new)
    return np.array(out)


def test_a_ramp_of_load_is_exact_at_any_step_length():
    times = np.concatenate([[0.0], np.logspace(-13, 5, 60)])
    found = displacement_under(PMMA15, times, times)
    t = times[:, None]
    creep_part = PMMA15.C * (t + PMMA15.tau * np.expm1(-t / PMMA15.tau))
    exact = PMMA15.instantaneous * times + creep_part.sum(axis=1)
    np.testing.assert_allclose(found[1:], exact[1:], rtol=1e-12)


def test_a_step_of_load_follows_the_creep_compliance():
    times = np.logspace(-12, 4, 50)
    grid = np.concatenate([[0.0], times])
    found = displacement_under(PMMA15, grid, np.ones(51), hold=True)
    np.testing.assert_allclose(found[1:], PMMA15.compliance(times), rtol=1e-13)


@settings(max_examples=60, deadline=None)
@given(x=st.floats(-16, 16), splits=st.lists(st.floats(0.01, 0.99), min_size=1, max_size=4))
def test_splitting_a_step_changes_nothing(x, splits):
    creep = Creep.from_terms(1.0, np.array([3.0]), np.array([1.0]))
    dt = 10.0**x
    times = np.concatenate([[0.0], np.sort(splits) * dt, [dt]])
    loads = 2.0 + 5.0 * times / dt
    memory = np.array([[0.7]])

    def final(nodes, values):
        state = memory
        for i, length in enumerate(np.diff(nodes)):
            weights = step_weights(creep, length)
            state = advance(weights, state, np.array([values[i]]), np.array([values[i + 1]]))
        return state[0, 0]

    once = final(np.array([0.0, dt]), np.array([2.0, 7.0]))
    assert final(times, loads) == pytest.approx(once, rel=1e-13)


@pytest.mark.parametrize("x", [1e-12, 1e-6, 0.049, 0.051, 1.0, 30.0, 1e4])
def test_weights_match_high_precision_values(x):
    """Against exact rational series / asymptotics evaluated with extended precision."""
    from fractions import Fraction

    creep = Creep.from_terms(1.0, np.array([1.0]), np.array([1.0]))
    weights = step_weights(creep, x)
    if x < 1.0:
        exact_x = Fraction(x)
        share, term = Fraction(0), Fraction(1)
        for n in range(1, 30):
            term = term * exact_x / (n + 1) if n > 1 else exact_x / 2
            share += term if n % 2 else -term
        expected = float(share)
    else:
        expected = 1.0 - (1.0 - np.exp(-x)) / x
    assert weights.new[0] == pytest.approx(expected, rel=rounding(50), abs=0.0)
    assert weights.old[0] + weights.new[0] == pytest.approx(-np.expm1(-x), rel=rounding(50), abs=0.0)


def test_a_liquid_flows_under_load_and_keeps_its_dent():
    liquid = Creep.from_terms(1.0, [], [], fluidity=0.5)
    times = np.array([0.0, 1.0, 1.5, 4.0])
    found = displacement_under(liquid, times, times)
    np.testing.assert_allclose(found, times + 0.25 * times**2, rtol=rounding(50))
    np.testing.assert_allclose(liquid.compliance(times), 1.0 + 0.5 * times)
    assert liquid.relaxed == np.inf
    assert condense(liquid, 1e-3, 1.0, 1e-6).creep.fluidity == 0.5


def test_the_compliance_is_that_of_the_material_with_the_contact_factor():
    material = Prony(2e9, [1e9, 3e9], [1e-4, 2.0], nu=0.35)
    t = np.array([0.0, 1e-5, 1e-2, 3.0, 1e3])
    np.testing.assert_allclose(Creep.of(material).compliance(t), material.creep(t, "contact"))
    liquid = Prony(0.0, [1e9], [1.0], nu=0.3)
    np.testing.assert_allclose(Creep.of(liquid).compliance(t), liquid.creep(t, "contact"))


def test_a_material_without_instantaneous_compliance_is_refused():
    with pytest.raises(InputError, match="instantaneous"):
        Creep.of(Prony(1e9, [], [], viscosity=1e6))


def test_condensed_terms_keep_the_creep_within_the_tolerance():
    short = condense(PMMA15, 1e-3, 0.5, 1e-6)
    assert short.creep.n_terms + short.n_folded + short.n_frozen == PMMA15.n_terms
    assert short.n_folded >= 3
    omega = np.pi / 1e-3

    def complex_compliance(creep):
        return creep.instantaneous + np.sum(creep.C / (1 + 1j * omega * creep.tau))

    full = complex_compliance(PMMA15)
    assert abs(complex_compliance(short.creep) - full) < 1e-6 * abs(full)


def test_elements_far_outside_the_time_scale_are_dropped():
    creep = Creep.from_terms(1.0, np.ones(3), np.array([1e-12, 1e-3, 1e12]))
    short = condense(creep, 1e-3, 1.0, 1e-6)
    assert (short.n_folded, short.n_frozen, short.creep.n_terms) == (0, 1, 2)


def test_an_elastic_solid_has_no_memory():
    creep = Creep.from_terms(2.0, np.array([]), np.array([]), nu=0.5)
    weights = step_weights(creep, 1.0)
    assert weights.compliance == pytest.approx(1.5)
    assert history(weights, creep.rest(3), np.ones(3)).tolist() == [0.0, 0.0, 0.0]
    assert condense(creep, 1e-3, 1.0, 1e-6).creep.n_terms == 0


@pytest.mark.parametrize(
    ("C", "tau"), [([1.0], [1.0, 2.0]), ([-1.0], [1.0]), ([1.0], [0.0]), ([np.nan], [1.0]), ([1.0], [np.inf])]
)
def test_unphysical_terms_are_refused(C, tau):
    with pytest.raises(InputError):
        Creep.from_terms(1.0, C, tau)


@pytest.mark.parametrize("dt", [-1.0, np.nan])
def test_time_running_backwards_is_refused(dt):
    with pytest.raises(InputError, match="backwards"):
        step_weights(PMMA15, dt)


def test_a_term_without_compliance_is_no_term():
    creep = Creep.from_terms(1e-9, [0.0, 2e-9, 0.0], [1e-3, 1e-2, 1.0])
    assert creep.n_terms == 1
    assert creep.tau.tolist() == [1e-2]

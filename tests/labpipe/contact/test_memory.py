"""The exponential memory against closed forms, at every ratio of step to retardation time."""

import numpy as np
import pytest

from labpipe.contact._memory import Creep, advance, condense, history, step_weights
from labpipe.errors import InputError
from labpipe.materials import Prony

PMMA15 = Creep.of(Prony.from_creep(2e9, np.full(15, (1 / 2e9 - 1 / 6e9) / 15), np.logspace(-10, 2, 15), nu=0.35))


def displacement_under(creep, times, loads):
    """Displacement at every time for a load that is linear between them."""
    memory, out = creep.rest(1), [creep.instantaneous * loads[0]]
    for i, dt in enumerate(np.diff(times)):
        weights = step_weights(creep, dt)
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


def test_a_material_without_instantaneous_compliance_is_refused():
    with pytest.raises(InputError, match="instantaneous"):
        Creep.of(Prony(1e9, [], [], viscosity=1e6))


def test_condensed_terms_keep_the_creep_within_the_tolerance():
    short, n_folded, n_frozen = condense(PMMA15, 1e-3, 0.5, 1e-6)
    assert short.n_terms + n_folded + n_frozen == PMMA15.n_terms
    assert n_folded >= 3
    omega = np.pi / 1e-3

    def complex_compliance(creep):
        return creep.instantaneous + np.sum(creep.C / (1 + 1j * omega * creep.tau))

    full = complex_compliance(PMMA15)
    assert abs(complex_compliance(short) - full) < 1e-6 * abs(full)

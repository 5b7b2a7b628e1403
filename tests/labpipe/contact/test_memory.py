"""The exponential memory against closed forms, at every ratio of step to retardation time."""

import numpy as np

from labpipe.contact._memory import Creep
from labpipe.contact._springs import SpringBed
from labpipe.contact._stepping import advance, look_ahead, weigh
from labpipe.materials import Prony

PMMA15 = Creep.of(Prony.from_creep(2e9, np.full(15, (1 / 2e9 - 1 / 6e9) / 15), np.logspace(-10, 2, 15), nu=0.35))


def displacement_under(creep, times, loads):
    """Displacement at every time of one spring under a load that jumps to its first value, then is linear."""
    law = creep.elements
    bed = SpringBed(np.zeros(1), np.ones(1), np.zeros(1))
    memory, weights, past = np.zeros((law.rate.size, 1)), np.zeros((3, law.rate.size)), np.zeros(1)
    out = [creep.instantaneous * loads[0]]
    for i, dt in enumerate(np.diff(times)):
        old, new = np.array([loads[i]]), np.array([loads[i + 1]])
        compliance, late = weigh(law, float(dt), weights)
        look_ahead(bed.gap, weights, late, memory, old, past)
        out.append(float(past[0] + compliance * new[0]))
        advance(bed, law, float(dt), weights, memory, old, new, memory)
    return np.array(out)


def test_a_ramp_of_load_is_exact_at_any_step_length():
    times = np.concatenate([[0.0], np.logspace(-13, 5, 60)])
    found = displacement_under(PMMA15, times, times)
    t = times[:, None]
    creep_part = PMMA15.C * (t + PMMA15.tau * np.expm1(-t / PMMA15.tau))
    exact = PMMA15.instantaneous * times + creep_part.sum(axis=1)
    np.testing.assert_allclose(found[1:], exact[1:], rtol=1e-12)

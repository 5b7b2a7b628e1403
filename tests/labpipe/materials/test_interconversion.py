"""The conversion between relaxation and retardation terms: weak terms, and families with a dashpot."""

import numpy as np
import pytest

from labpipe.materials.prony._interconversion import (
    Relaxation,
    Retardation,
    creep_from_relaxation,
    relaxation_from_creep,
)
from tests.rounding import rounding

EXACT = rounding(20 * 2)
"""Two terms, each found from sums of some twenty operations."""


def test_a_liquid_flows_and_no_instantaneous_compliance_is_a_dashpot_each_with_one_term_fewer():
    liquid = Relaxation(0.0, np.array([1.0, 2.0]), np.array([1.0, 10.0]))
    soft = Retardation(0.0, np.array([1.0, 2.0]), np.array([1.0, 5.0]))
    creep, family = creep_from_relaxation(liquid), relaxation_from_creep(soft)
    assert creep.fluidity == pytest.approx(1 / 21)
    assert family.viscosity == pytest.approx(1 / 1.4)
    assert creep.time.size == family.time.size == 1
    for given, back in ((liquid, relaxation_from_creep(creep)), (soft, creep_from_relaxation(family))):
        np.testing.assert_allclose(back.weight, given.weight, rtol=EXACT)
        np.testing.assert_allclose(back.time, given.time, rtol=EXACT)


def test_weak_terms_come_back_in_all_their_digits():
    time = np.logspace(-10, 4, 43)
    weight = 1e8 * np.exp(-0.5 * ((np.log10(time) + 3) / 4) ** 2)
    weight[::3] *= 1e-10
    back = relaxation_from_creep(creep_from_relaxation(Relaxation(1e6, weight, time)))
    np.testing.assert_allclose(back.weight, weight, rtol=rounding(20 * 43**2))
    np.testing.assert_allclose(back.time, time, rtol=rounding(20 * 43))

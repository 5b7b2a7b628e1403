"""The conversion between relaxation and retardation terms where one family has a dashpot."""

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

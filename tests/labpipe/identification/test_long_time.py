"""What a record of ten minutes says of the modulus that is left for good."""

import numpy as np
import pytest

from labpipe.identification import LongTimeModulus, infer, long_time_modulus
from pipelines.rig.solids import Element, Viscoelastic
from tests.labpipe.identification.holds import hold

_GAIN = 2e-3


def told(solid: Viscoelastic, seed: int, longest: float = 600.0) -> LongTimeModulus:
    """A hold, read to 0.1 %, of a fractional solid that no series equals."""
    return long_time_modulus(infer(*hold(solid, seed, shortest=0.2, longest=longest, noise=1e-3, gain=_GAIN)))


@pytest.mark.parametrize("order", [0.08, 0.3])
def test_power_law_tail_is_bounded_from_above_only(order: float) -> None:
    solid = Viscoelastic((Element(3e7, 1e-4, order),), 2e6, 0.5)
    said = told(solid, 1)
    assert said.verdict == "bounded from above"
    assert said.low == 0.0
    assert solid.relaxed < said.high
    exact = solid.relaxation(np.array([60.0, 600.0]))
    assert said.modulus == pytest.approx(exact[1], rel=4 * _GAIN)
    assert said.fall == pytest.approx(1.0 - exact[1] / exact[0], rel=0.1)


def test_plateau_is_identified_and_its_interval_holds_the_truth() -> None:
    solid = Viscoelastic((Element(3e7, 1e-6, 0.5),), 2e6, 0.5)
    said = told(solid, 2)
    assert said.verdict == "identified"
    assert said.low < 2e6 < said.high
    assert said.high / said.low < 1.07


def test_record_that_ends_before_the_plateau_shows_none() -> None:
    solid = Viscoelastic((Element(3e6, 5.0, 0.6),), 2e6, 0.5)
    said = told(solid, 3, longest=3.0)
    assert said.verdict == "bounded from above"
    assert said.low == 0.0
    assert said.high > 2e6

"""What a record of ten minutes says of the modulus that is left for good."""

from typing import Any

import numpy as np
import pytest

from labpipe.identification import (
    LongTimeModulus,
    Parameter,
    Problem,
    SmoothSpectrum,
    force_evidence,
    infer,
    lee_radok_basis,
    long_time_modulus,
    relaxation_times,
)
from pipelines.rig.solids import Element, Viscoelastic

_RAMP, _AREA, _GAIN, _NOISE = 0.1, 1.6e-6, 2e-3, 1e-3


def told(solid: Viscoelastic, seed: int, longest: float = 600.0) -> LongTimeModulus:
    """A hold, read to 0.1 %, of a fractional solid that no series equals."""
    rng = np.random.default_rng(seed)
    lag = np.geomspace(0.2, longest, 42)
    end = lag + _RAMP
    clean = (end * solid.mean_relaxation(end) - lag * solid.mean_relaxation(lag)) / _RAMP
    clean *= _AREA / (1.0 - solid.nu**2)
    force = clean * (1.0 + _GAIN * rng.standard_normal() + _NOISE * rng.standard_normal(lag.size))
    time = np.concatenate([np.linspace(0.0, _RAMP, 41), end])
    area = _AREA * np.minimum(time / _RAMP, 1.0)

    def rebuilt(rho: np.ndarray) -> Any:
        basis = lee_radok_basis(time, area, rho, solid.nu)[41:]
        return (force_evidence("hold", lag, force, _NOISE * clean, basis, factors=("gain",)),)

    spectrum = SmoothSpectrum(relaxation_times(0.2, longest), solid.nu)
    gain = Parameter("gain", 1.0, _GAIN, "1", "gain", is_nuisance=True)
    return long_time_modulus(infer(Problem(spectrum, rebuilt(spectrum.rho), (gain,)), rebuilt))


@pytest.mark.parametrize("order", [0.08, 0.15, 0.3])
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

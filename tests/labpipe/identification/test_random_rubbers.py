"""Intervals of identified rubbers hold truths that the method was not made on, at the Cramér–Rao bound."""

import numpy as np
import pytest

from tests.labpipe.identification.random_rubbers import FREQUENCIES, hold_trial, random_rubber


@pytest.mark.slow
def test_intervals_hold_the_truth_and_reach_the_bound() -> None:
    trials = [hold_trial(4000 + i) for i in range(8)]
    deviations = np.array([t.deviations for t in trials])
    assert np.mean(np.abs(deviations) < 1.96) >= 0.9
    assert np.all(np.sqrt(np.mean(deviations**2, axis=0)) < 1.8)
    # over several structures of the spectrum an answer may be a little surer than the bound of one
    widths = np.median([t.widths for t in trials], axis=0)
    assert np.all((widths > 0.9) & (widths < 2.0))
    assert np.mean([t.holds_long_time_modulus for t in trials]) >= 0.85


def test_rubbers_differ_and_lose_energy() -> None:
    rubbers = [random_rubber(seed) for seed in range(5)]
    moduli = [complex(r.modulus(FREQUENCIES[1])) for r in rubbers]
    assert all(0.0 < m.imag < m.real for m in moduli)
    assert len({round(r.relaxed) for r in rubbers}) == 5

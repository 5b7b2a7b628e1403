"""Stated uncertainties against the truth of every kind."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.pipelines.coverage import KINDS, share, swept

FEW = {
    "ball_drop": 6,
    "plate_vibration": 8,
    "static_loading": 6,
    "relaxation": 5,
    "harmonic": 6,
    "dma": 8,
    "contact_area": 2,
    "dic_validation": 3,
}
"""Experiments of each kind in every run; those of the nightly run stand in ``KINDS``."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_stated_intervals_hold_the_truth_of_the_rig(kind: str, tmp_path: Path) -> None:
    """With few experiments errors of twice their uncertainty are no rule; with many, 5 %."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        scores = swept(kind, FEW[kind], tmp_path)
    everything = [z for part in scores.values() for z in part]
    assert share(everything) >= 0.88, kind
    for name, z in scores.items():
        assert np.sqrt(np.mean(np.square(z))) < 1.7, name
        assert abs(np.median(z)) < 1.6, name


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_coverage_of_whole_sweeps(kind: str, tmp_path: Path) -> None:
    """Nine in ten at least: three standard deviations of the count are left for chance."""
    seeds = KINDS[kind][1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        scores = swept(kind, seeds, tmp_path)
    for name, z in scores.items():
        # What one recording tells many times over counts as one.
        chance = 3 * np.sqrt(0.05 * 0.95 / min(len(z), 2 * seeds))
        assert share(z) >= 0.95 - max(chance, 0.05), name

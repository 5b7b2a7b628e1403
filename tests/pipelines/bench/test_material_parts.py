"""The benchmarks of materials: their truths are true, and ours stays within its goals."""

import numpy as np
import pytest

from pipelines.bench import master_curve, rheology_peers
from pipelines.bench.rheology_scenes import scenes
from pipelines.bench.rheology_truth import FRACTIONAL, MAXWELL, measured


@pytest.mark.parametrize("truth", [MAXWELL, FRACTIONAL])
def test_readings_differ_from_the_truth_by_the_noise(truth) -> None:
    made = measured(truth, 1, temperatures=40, points=40)
    for name, exact in (("storage", made.exact.real), ("loss", made.exact.imag)):
        ratio = made.sweeps[name].values / exact - 1
        assert np.std(ratio) == pytest.approx(0.02, rel=0.1)
    assert made.error(made.log10_aT + 3.0) < 1e-12
    assert np.all(np.diff(made.log10_aT) < 0)


def test_true_moduli_superpose_by_the_true_shifts() -> None:
    made = measured(MAXWELL, 1)
    omega = 2 * np.pi * made.sweeps["frequency"].values * 10.0 ** made.log10_aT[:, None]
    at = MAXWELL.shift(np.array([made.reference, MAXWELL.T_ref]))
    np.testing.assert_allclose(MAXWELL.modulus(omega * 10.0 ** (at[0] - at[1])), made.exact)


@pytest.mark.slow
def test_ten_scenes_are_recovered_where_superposition_is_true() -> None:
    found = {p.setting: p for p in master_curve._ten_scenes(quick=True).points}
    for scene in scenes():
        point = found[scene.name]
        if scene.superposes:
            assert point.error < 0.06, point
        else:
            assert point.extra["verdicts"] == "1 fail"


def test_the_pairwise_procedure_recovers_overlapping_sweeps_without_noise() -> None:
    made = measured(FRACTIONAL, 1, temperatures=25, noise=1e-6, points=21)
    for is_vertical in (False, True):
        assert made.error(rheology_peers.pairwise_shifts(made, is_vertical)) < 0.02


@pytest.mark.slow
def test_default_shifts_meet_their_goal_on_both_truths(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(master_curve, "_QUICK_SEEDS", 1)
    for suite, goal in zip(master_curve.run(quick=True)[:4], (0.034, 0.04, 0.034, 0.034), strict=True):
        (default,) = [p for p in suite.points if p.is_default]
        assert default.error < goal

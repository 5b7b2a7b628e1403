"""The parts of the benchmark: their truths are true, and the better method comes out better."""

import importlib.util

import numpy as np
import pytest

from pipelines.bench import dic, drop, line, master_curve, velocity
from pipelines.bench.master_curve import MAXWELL, measured
from pipelines.bench.measure import OURS, THESIS, Suite
from tests.pipelines.readme import ADVICE, stale


def by_name(suite: Suite) -> dict[str, float]:
    return {point.setting: point.error for point in suite.points}


def test_the_true_velocity_is_that_of_free_fall_and_the_readings_differ_by_the_noise() -> None:
    made = velocity.record("acrylic", 0.12)
    time, height = made.displacement.time.values, made.displacement.values
    falling = (time > made.events[0] - 0.01) & (time < made.events[0] - 0.001)
    assert np.polyfit(time[falling], made.velocity[falling], 1)[0] == pytest.approx(-9.81, abs=0.01)
    integral = np.concatenate([[0], np.cumsum((made.velocity[1:] + made.velocity[:-1]) / 2 * np.diff(time))])
    assert np.std(height - integral) == pytest.approx(1e-6, rel=0.3)


def test_the_film_is_shifted_exactly_and_the_emulation_of_dice_errs_as_its_interpolation_does() -> None:
    film, shifts = dic.make_film(96, 21, 0.0)
    assert shifts[20].tolist() == pytest.approx([2.0, 1.0])
    inside = np.s_[12:-12, 12:-12]
    assert np.abs(film[20].astype(int) - np.roll(film[0], (1, 2), (0, 1)))[inside].max() <= 1
    points = np.array([(x, y) for x in (36.0, 58.0) for y in (36.0, 58.0)])
    bias = np.abs((dic.keys_correlation(film[:11], points, 31) - shifts[:11, None]).mean(axis=1)).max()
    assert 0.001 < bias < 0.02


@pytest.mark.slow
def test_default_settings_beat_moving_averages_and_meet_the_goals_of_shift_factors() -> None:
    (suite,) = velocity.run(quick=True)
    assert stale([suite]) == [], ADVICE
    (ours,) = [p.error for p in suite.points if p.is_default]
    assert ours < min(p.error for p in suite.points if p.group)
    for suite, goal in zip(master_curve.run(quick=True), (0.034, 0.04), strict=True):
        assert [p.error < goal for p in suite.points if p.is_default] == [True]


@pytest.mark.slow
def test_every_setting_of_the_correlation_beats_lucas_kanade_and_nears_the_bound() -> None:
    (suite,) = dic.run(quick=True)
    assert stale([suite]) == [], ADVICE
    peer = next(p for p in suite.points if p.group == "OpenCV")
    ours = [p for p in suite.points if p.group == OURS]
    assert all(p.error < peer.error and p.extra["error / bound"] < 1.3 for p in ours)


def test_sweeps_differ_from_the_truth_by_the_noise_and_superpose_by_the_true_shifts() -> None:
    made = measured(MAXWELL, 1, temperatures=40, points=40)
    truth = MAXWELL.modulus(made.sweeps["frequency"].values, made.sweeps["temperature"].values[:, None])
    for name, exact in (("storage", truth.real), ("loss", truth.imag)):
        assert np.std(made.sweeps[name].values / exact - 1) == pytest.approx(0.02, rel=0.1)
    assert made.error(made.log10_aT + 3.0) < 1e-12
    frequency = made.sweeps["frequency"].values * 10.0 ** made.log10_aT[:, None]
    np.testing.assert_allclose(MAXWELL.modulus(frequency, made.reference), truth)


@pytest.mark.slow
def test_a_drop_follows_its_tolerance_and_beats_the_thesis() -> None:
    first, train = drop.run(True)
    assert stale([first, train]) == [], ADVICE
    errors = by_name(first)
    assert errors["springs, rtol 1e-05"] < errors["springs, rtol 1e-04"] < errors["springs, rtol 1e-03"]
    assert errors["springs, rtol 1e-04"] < 2e-5
    assert errors["rings, rtol 1e-04"] < 5e-5
    theirs = [p.error for p in first.points if p.group == THESIS]
    assert theirs == sorted(theirs, reverse=True)
    assert min(theirs) > 1e-3
    coarse, fine = (p.error for p in first.points if p.group == drop.TING)
    assert fine < 1e-7 < coarse < 5e-5
    assert max(p.error for p in train.points if p.group == OURS) < 3e-3
    assert min(p.error for p in train.points if p.group == THESIS) == 1.0


@pytest.mark.slow
def test_an_indented_line_converges_and_names_a_missing_peer() -> None:
    elastic, *tapping = line.run(True)
    assert stale(tapping) == [], ADVICE
    errors = by_name(elastic)
    assert errors["springs, 1024 strips"] < errors["springs, 256 strips"] < 2e-3
    assert all(by_name(suite)["adaptive, rtol 1e-05"] < 3e-5 for suite in tapping)
    has_peer = importlib.util.find_spec("tamaas") is not None
    assert has_peer != any("tamaas" in note for note in elastic.notes)
    if has_peer:
        assert line.pressure_error(line.tamaas_pressure(256)) < 3e-3

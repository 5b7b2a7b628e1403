"""A curve against its model: what is shared counts once, what is bent is found, chance is chance."""

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.judging import along_curve, stretches

PLACES = np.split(np.arange(1200), 12)
X = np.linspace(0.0, 1.0, 1200)
EFFECTS = np.array([3.0 * np.ones(1200), 5.0 * X, 2.0 * X**2])  # of one standard uncertainty each


def by_stretch(curves: np.ndarray) -> np.ndarray:
    return np.array([[curve[place].mean() for place in PLACES] for curve in curves])


def judged(left: np.ndarray):
    means, own = stretches(left, PLACES)
    found = along_curve(means, own, by_stretch(EFFECTS))
    assert found is not None
    return found


def test_p_is_uniform_when_model_and_uncertainties_are_right() -> None:
    random = np.random.default_rng(20)
    p = np.array([judged(random.standard_normal(3) @ EFFECTS + random.standard_normal(1200)).p for _ in range(400)])
    # 400 draws: shares of 5, 50 and 95 % have standard errors of 1.1, 2.5 and 1.1 %
    for level, u in ((0.05, 0.011), (0.5, 0.025), (0.95, 0.011)):
        assert abs(np.mean(p < level) - level) < 4.0 * u


def test_an_effect_of_all_stretches_counts_once() -> None:
    means, own = stretches(np.random.default_rng(1).standard_normal(1200), PLACES)
    shifted = along_curve(means + 3.0, own, [3.0 * np.ones(12)])
    alone = along_curve(means, own, [3.0 * np.ones(12)])
    assert shifted is not None
    assert alone is not None
    assert shifted.chi2 - alone.chi2 == pytest.approx(1.0, abs=0.4)  # one standard uncertainty of one input


def test_a_bend_that_no_input_explains_is_found_below_the_uncertainty_of_the_inputs() -> None:
    bend = np.sin(6.0 * np.pi * X)
    noise = np.random.default_rng(2).standard_normal(1200)
    assert judged(noise).p > 0.01
    assert judged(noise + bend).p < 1e-6
    assert judged(noise + bend).largest < 2.0  # no single stretch shows it


def test_noise_that_lasts_less_than_a_batch_is_as_uncertain_as_it_scatters() -> None:
    random = np.random.default_rng(3)
    smooth = np.array([np.convolve(random.standard_normal(1209), np.ones(10) / 10, "valid") for _ in range(300)])
    pairs = [stretches(one, [np.arange(1200)]) for one in smooth]
    z = np.array([float(means[0] / own[0]) for means, own in pairs])
    # Student's distribution of 7 degrees of freedom scaled to a variance of one
    assert np.mean(np.abs(z) < 1.96) == pytest.approx(0.95, abs=0.04)


def test_what_cannot_be_told_is_none_and_sizes_are_held() -> None:
    assert along_curve([1.0], [np.nan], []) is None
    means, own = stretches(np.arange(4.0), [np.arange(4)])
    assert np.isnan(means).all()
    assert np.isnan(own).all()
    with pytest.raises(InputError, match="2 stretches of a curve want as many uncertainties, found 1"):
        along_curve([1.0, 2.0], [1.0], [])

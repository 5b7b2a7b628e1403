import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.signals import agreement, independent_count, nrmse

STUDENT = 2.0227  # of 39 degrees of freedom, 95 %


def test_limits_of_agreement_hold_95_percent_of_new_differences():
    random = np.random.default_rng(0)
    held, biases, limits = [], [], []
    for _ in range(400):
        first = random.standard_normal(40)
        difference = 0.3 + 0.5 * random.standard_normal(40)
        found = agreement(first, first - difference)
        new = 0.3 + 0.5 * random.standard_normal(200)
        held.append(np.mean((new > found.low) & (new < found.high)))
        biases.append(abs(found.bias - 0.3) < STUDENT * found.u_bias)
        limits.append(abs(found.high - 0.3 - 1.96 * 0.5) < STUDENT * found.u_limit)
    assert np.mean(held) == pytest.approx(0.95, abs=0.01)
    assert np.mean(biases) == pytest.approx(0.95, abs=0.03)
    assert np.mean(limits) > 0.90


def test_concordance_of_known_cases():
    a = np.arange(10.0)
    assert agreement(a, a).concordance == pytest.approx(1.0)
    assert agreement(a, a[::-1]).concordance == pytest.approx(-1.0)
    # Lin: 2 s12 / (s1^2 + s2^2 + (m1 - m2)^2) with variance 8.25
    assert agreement(a, a + 2).concordance == pytest.approx(2 * 8.25 / (2 * 8.25 + 4))


def test_neighbouring_samples_are_not_independent():
    random = np.random.default_rng(0)
    white = random.standard_normal(4000)
    smooth = np.convolve(white, np.ones(10) / 10, "valid")
    assert independent_count(white) == pytest.approx(4000, rel=0.15)
    assert independent_count(smooth) == pytest.approx(400, rel=0.25)


@pytest.mark.parametrize("function", [nrmse, agreement])
def test_unlike_or_empty_curves_are_refused(function):
    with pytest.raises(InputError, match="of one shape"):
        function([0.0, 1.0, 2.0], [0.0, 1.0])
    with pytest.raises(InputError, match="at least"):
        function([np.nan, np.nan, 1.0], [0.0, 1.0, 2.0])
    with pytest.raises(InputError, match="sample 1 is inf"):
        function([0.0, 1.0, 2.0, 3.0], [0.0, np.inf, 2.0, 3.0])


def test_the_error_is_relative_to_the_range_of_the_model_in_any_unit():
    model = np.array([0.0, 1.0, 3.0, np.nan, 2.0])
    for scale in (1e-6, 1.0, 1e6):
        assert nrmse(scale * (model + 0.1), scale * model) == pytest.approx(0.1 / 3.0, rel=1e-6)
    assert nrmse(10.0 * model, model) == pytest.approx(9.0 * np.sqrt(14 / 4) / 3.0)

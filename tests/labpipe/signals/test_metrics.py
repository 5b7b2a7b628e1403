import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.signals import independent_count, nrmse


def test_neighbouring_samples_are_not_independent():
    random = np.random.default_rng(0)
    white = random.standard_normal(4000)
    smooth = np.convolve(white, np.ones(10) / 10, "valid")
    assert independent_count(white) == pytest.approx(4000, rel=0.15)
    assert independent_count(smooth) == pytest.approx(400, rel=0.25)


def test_unlike_or_empty_curves_are_refused():
    with pytest.raises(InputError, match="of one shape"):
        nrmse([0.0, 1.0, 2.0], [0.0, 1.0])
    with pytest.raises(InputError, match="at least"):
        nrmse([np.nan, np.nan, 1.0], [0.0, 1.0, 2.0])
    with pytest.raises(InputError, match="sample 1 is inf"):
        nrmse([0.0, 1.0, 2.0, 3.0], [0.0, np.inf, 2.0, 3.0])


def test_the_error_is_relative_to_the_range_of_the_model_in_any_unit():
    model = np.array([0.0, 1.0, 3.0, np.nan, 2.0])
    for scale in (1e-6, 1.0, 1e6):
        assert nrmse(scale * (model + 0.1), scale * model) == pytest.approx(0.1 / 3.0, rel=1e-6)
    assert nrmse(10.0 * model, model) == pytest.approx(9.0 * np.sqrt(14 / 4) / 3.0)

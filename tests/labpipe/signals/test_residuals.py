import numpy as np
import pytest
from scipy.signal import lfilter

from labpipe.signals._oscillation import parameter_covariance


@pytest.mark.parametrize("memory", [0.5, 0.9])
def test_mean_of_residuals_with_memory(memory):
    random = np.random.default_rng(1)
    means, stated = [], []
    for _ in range(200):
        noise = lfilter([1], [1, -memory], random.standard_normal(3000))[1000:]
        means.append(noise.mean())
        stated.append(parameter_covariance(np.ones((2000, 1)), noise - noise.mean())[0, 0])
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(means), rel=0.15)

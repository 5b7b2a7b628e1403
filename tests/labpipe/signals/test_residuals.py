import numpy as np
import pytest
from scipy.signal import lfilter

from labpipe.signals._residuals import parameter_covariance


def test_white_residuals_give_the_textbook_covariance():
    random = np.random.default_rng(0)
    time = np.linspace(-1, 1, 4000)
    design = np.column_stack([np.ones(4000), time, np.sin(40 * time)])
    noise = random.standard_normal(4000)
    left = noise - design @ np.linalg.lstsq(design, noise, rcond=None)[0]
    expected = np.diag(np.linalg.inv(design.T @ design))
    found = np.diag(parameter_covariance(design, left))
    np.testing.assert_allclose(found, expected, rtol=0.5)


@pytest.mark.parametrize("memory", [0.5, 0.9])
def test_mean_of_residuals_with_memory(memory):
    random = np.random.default_rng(1)
    means, stated = [], []
    for _ in range(200):
        noise = lfilter([1], [1, -memory], random.standard_normal(3000))[1000:]
        means.append(noise.mean())
        stated.append(parameter_covariance(np.ones((2000, 1)), noise - noise.mean())[0, 0])
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(means), rel=0.15)

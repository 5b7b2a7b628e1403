"""The prefilter against scipy, and the noise factors against simulated noise."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.ndimage import map_coordinates, spline_filter

from labpipe.imaging.dic._film_window import smooth
from labpipe.imaging.dic._spline import LANES, PADDING, noise_gain, prefilter


def prefilter_oracle(image: np.ndarray, order: int) -> np.ndarray:
    """Coefficients that ``prefilter`` approximates in float32, without its border."""
    return np.asarray(spline_filter(image, order, output=np.float64, mode="mirror"))


def inner(coefficients: np.ndarray) -> np.ndarray:
    return coefficients[PADDING : -PADDING - 1, PADDING : -PADDING - LANES]


@settings(deadline=None, max_examples=25)
@given(
    rows=st.integers(9, 90), columns=st.integers(9, 150), order=st.sampled_from([3, 5]), seed=st.integers(0, 2**32 - 1)
)
def test_prefilter_agrees_with_scipy_for_any_size(rows: int, columns: int, order: int, seed: int) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (rows, columns)).astype(np.uint8)
    expected = prefilter_oracle(image, order)
    found = inner(prefilter(image, order))
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max() + 1e-4


@pytest.mark.parametrize("order", [3, 5])
def test_border_is_the_mirror_image(order: int) -> None:
    image = np.random.default_rng(1).normal(100, 30, (20, 31))
    mirrored = np.pad(prefilter_oracle(image, order), PADDING, mode="reflect")
    found = prefilter(image, order)[:-1, :-LANES]
    assert np.abs(found - mirrored).max() < 2e-3


@pytest.mark.parametrize(("order", "blur"), [(3, 0.7), (5, 0.0)])
def test_noise_gain_is_the_variance_of_interpolated_noise(order: int, blur: float) -> None:
    noise = np.random.default_rng(3).normal(0, 1, (600, 600))
    coefficients = prefilter_oracle(smooth(noise, blur), order)
    y, x = np.mgrid[20:580, 20:580].astype(float)
    for fraction_x, fraction_y in ((0.5, 0.0), (0.25, 0.5)):
        values = map_coordinates(coefficients, [y + fraction_y, x + fraction_x], order=order, prefilter=False)
        gain = noise_gain(order, np.array([fraction_x, fraction_y]), blur)
        assert values.var() == pytest.approx(gain[0] * gain[1], rel=0.02)

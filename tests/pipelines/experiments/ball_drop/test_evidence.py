"""What the repeats of a drop tell of their own scatter, for the identification of a material."""

import numpy as np
import pytest

from pipelines.experiments.ball_drop.evidence import _scatter

TOUCHES = np.array([0.05, 0.12, 0.18])  # s after the first contact


def test_repeats_of_other_heights_have_no_scatter() -> None:
    """A flight lasts as the root of its height, so that all touches of a repeat come later alike."""
    repeats = TOUCHES * np.array([[1.0], [1.01], [0.99], [1.002]])
    assert _scatter(repeats).max() < 1e-15


@pytest.mark.parametrize("count", [3, 10])
def test_scatter_is_that_of_the_touches_from_three_repeats_on(count: int) -> None:
    """The common factor takes one of three degrees of freedom of a repeat, most of it from the last touch."""
    random = np.random.default_rng(3)
    draws = 400
    squares = [
        _scatter(TOUCHES * np.linspace(0.99, 1.01, count)[:, None] + 1e-5 * random.standard_normal((count, 3))) ** 2
        for _ in range(draws)
    ]
    left = 1e-5 * np.sqrt(1.0 - TOUCHES**2 / np.sum(TOUCHES**2))
    three_deviations = 3.0 / np.sqrt(2.0 * draws * (count - 1))
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx(left, rel=three_deviations, abs=0.0)

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from labpipe.errors import InputError
from labpipe.imaging.fringes import fit_circle


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(1.0, 1e3), st.floats(0.3, 2.0 * math.pi))
def test_points_on_a_circle_give_it_back(x: float, y: float, radius: float, arc: float) -> None:
    angle = np.linspace(0.2, 0.2 + arc, 40)
    points = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])
    assert fit_circle(points) == pytest.approx((x, y, radius), abs=1e-5 * radius)


def test_noise_on_an_arc_pulls_the_radius_little() -> None:
    rng = np.random.default_rng(1)
    angle = np.linspace(0.0, 1.2, 200)
    circle = np.column_stack([300.0 * np.cos(angle), 300.0 * np.sin(angle)])
    radii = [fit_circle(circle + rng.normal(0.0, 0.5, circle.shape))[2] for _ in range(200)]
    # The simple algebraic (Kasa) fit is 0.9 too small here.
    assert np.mean(radii) == pytest.approx(300.0, abs=0.3)


@pytest.mark.parametrize("points", [np.zeros((2, 2)), np.zeros((5, 2)), np.outer(np.arange(5.0), [1.0, 2.0])])
def test_points_that_make_no_circle_are_refused(points: np.ndarray) -> None:
    with pytest.raises(InputError):
        fit_circle(points)

"""What makes a radius uncertain, part by part."""

import numpy as np
import pytest

from labpipe.imaging.radius_results import FRINGES, _edge_systematic, _static_radius


def test_of_an_edge_only_the_scale_is_uncertain() -> None:
    parts = _edge_systematic(1e-3, None, None, {"pixel_size": 2e-3})  # type: ignore[arg-type]
    assert parts.tolist() == [0.0, 0.0, 2e-6, 0.0]


def test_the_radius_at_rest_is_the_weighted_mean_of_the_last_frames() -> None:
    radius = np.array([5.0, 8.0, *([1.0, 1.001] * 6)])
    deviation = np.array([0.1, 0.1, *([1e-3, 3e-3] * 6)])
    method = np.full(radius.size, FRINGES, np.int8)
    mean, u = _static_radius(radius, deviation, method)
    assert mean == pytest.approx((1.0 + 1.001 / 9.0) / (1.0 + 1.0 / 9.0), rel=1e-12)
    assert 0.0 < u < 1e-2
    radius[-1] = np.nan
    assert np.isnan(_static_radius(radius, deviation, method)).all()

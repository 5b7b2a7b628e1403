"""Spots in a frame: where the reduced frame says they are."""

import numpy as np
import pytest

from labpipe.imaging.fringes._spots import _spots_of_mask, reduce_frame


def test_a_reduced_frame_holds_the_mean_of_every_square() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (250, 377)).astype(np.uint8)
    small, factor = reduce_frame(frame)
    assert factor == 2
    means = frame[:250, :376].reshape(125, 2, 188, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(small, means, atol=0.51)  # the mean of bytes is a byte
    same, one = reduce_frame(frame[:200, :200].astype(float))
    assert one == 1
    np.testing.assert_allclose(same, frame[:200, :200])


def test_the_centre_of_a_spot_is_told_in_pixels_of_the_whole_frame() -> None:
    factor, x, y, radius = 4, 130.5, 90.5, 40.0
    rows, columns = np.mgrid[:240, :320]
    disc = (columns - x) ** 2 + (rows - y) ** 2 < radius**2
    share = disc.reshape(60, 4, 80, 4).mean(axis=(1, 3))
    mask = (share > 0.5).astype(np.uint8)
    (spot,) = _spots_of_mask(mask, factor, 1)
    assert spot.x == pytest.approx(x, abs=0.4)
    assert spot.y == pytest.approx(y, abs=0.4)
    assert spot.radius == pytest.approx(radius, abs=factor)

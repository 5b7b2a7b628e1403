"""Spots in a frame: where the reduced frame says they are."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from labpipe.imaging.fringes._interference import Optics
from labpipe.imaging.fringes._spots import _spots_of_mask, reduce_frame
from labpipe.imaging.fringes._touch import left_by_only_sphere


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


@pytest.mark.parametrize("size", [5.0, 6.0])
def test_a_speck_of_dust_is_no_sphere_whose_rings_are_blurred_away(size: float) -> None:
    """As one it hid clear contacts in 4 of 80 dusty frames; the rings of a sphere that hovers are told beside it."""
    y, x = np.mgrid[:90, :100]
    distance = np.hypot(x - 50.2, y - 44.7)
    noise = 3.5 * np.random.default_rng(4).standard_normal(distance.shape)
    optics = Optics(math.pi / 81.0)
    speck = 110.0 - 90.0 * gaussian_filter(np.exp(-((distance / size) ** 4)), 1.2)
    assert left_by_only_sphere(speck + noise, 50.2, 44.7, optics) is None
    rings = 110.0 - 80.0 * np.cos(0.5 * optics.phase_scale * distance**2 + 0.4)
    assert left_by_only_sphere(gaussian_filter(rings, 1.2) + 0.2 * noise, 50.2, 44.7, optics) is not None

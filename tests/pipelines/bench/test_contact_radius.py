"""The benchmark's images follow from springs, and its rows hold what they promise."""

import numpy as np
import pytest

from pipelines.bench import contact_radius as bench
from tests.labpipe.imaging.fringe_film import gap_of_hertz


def test_gap_from_springs_is_that_of_hertz() -> None:
    r = np.linspace(0.0, 600e-6, 301)
    expected = gap_of_hertz(r, 200e-6, 9.525e-3)
    assert bench.surface_gap(r, 200e-6, 9.525e-3) == pytest.approx(expected, abs=1e-13)


def test_plain_estimates_see_a_disc() -> None:
    y, x = np.mgrid[:200, :240]
    image = np.where(np.hypot(x - 118.0, y - 97.0) < 60.0, 20, 200).astype(np.uint8)
    for method in (bench.area_radius, bench.outline_radius, bench.hough_radius):
        assert method(image) == pytest.approx(60.0, abs=2.5)


def test_bound_of_more_fringes_is_smaller() -> None:
    scene = bench.Scene(rows=120, columns=160, radius=100e-6, centre=(80.3, 60.2))
    assert bench.cramer_rao(scene, 3.0) < bench.cramer_rao(scene, 1.0) < 0.01


@pytest.mark.slow
def test_rows_reach_the_bound_and_beat_the_edge() -> None:
    settings, disturbed = bench.run(quick=True)
    rows = {point.setting: point for point in settings.points}
    bound = min(b.error for b in settings.bounds if b.error is not None)
    default = next(point for point in settings.points if point.is_default)
    assert bound * 0.4 < default.error < 0.01
    assert rows["Otsu's threshold, Taubin's circle"].error > 100.0 * default.error
    # of those that are determined less well, more (µm)
    limits = {"radius moves 20 µm in the exposure": 0.1, "blur of 5 px": 0.2, "ellipse, blur, sloping light": 0.06}
    for point in disturbed.points:
        assert point.error < limits.get(point.setting, 0.02), point.setting
        assert point.extra["largest error / u"] < 3.0, point.setting
    assert {point.group for point in settings.points} >= {"", "thesis"}

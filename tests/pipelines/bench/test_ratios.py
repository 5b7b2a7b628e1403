"""Ratios at equal error: which settings are compared, and the spread of runs made in turn."""

import math

import pytest

from pipelines.bench.measure import Point, Suite
from pipelines.bench.ratios import ratios_of, table

SUITE = Suite(
    "toy",
    "Toy",
    "error (1)",
    (
        Point("fine", 1e-4, 4.0, is_default=True, samples=(4.0, 5.0, 3.0)),
        Point("coarse", 1e-2, 1.0, samples=(1.0, 1.0, 2.0)),
        Point("steps, long", 5e-1, 0.5, "thesis", samples=(0.5, 0.5, 0.5)),
        Point("steps, short", 2e-2, 3.0, "thesis", samples=(3.0, 4.0, 3.0)),
        Point("peer's", 1e-6, 8.0, "peer"),
        Point("not timed", 1e-9, math.nan, "formula"),
    ),
)


def test_the_fastest_of_ours_that_errs_no_more_is_compared_run_by_run() -> None:
    thesis, peer = ratios_of(SUITE)
    assert (thesis.other, thesis.ours) == ("thesis: steps, short", "coarse")
    assert thesis.error == pytest.approx(2.0)
    assert (thesis.lowest, thesis.highest) == pytest.approx((1.5, 4.0))
    assert math.isnan(thesis.time)  # what varies so much from run to run tells of the machine
    assert (peer.other, peer.ours) == ("peer's", "fine")
    assert peer.error == pytest.approx(0.01)
    assert peer.time == pytest.approx(2.0)
    assert math.isnan(peer.lowest)


def test_a_ratio_that_hardly_varies_is_given() -> None:
    ours = Point("ours", 1e-2, 1.0, is_default=True, samples=(1.0, 1.0, 1.1))
    (ratio,) = ratios_of(
        Suite("toy", "Toy", "error (1)", (ours, Point("steps", 2e-2, 3.0, "thesis", samples=(3.0, 3.3, 3.0))))
    )
    assert ratio.time == pytest.approx(3.0)


def test_suites_without_others_have_no_row() -> None:
    alone = Suite("alone", "Alone", "error (1)", SUITE.points[:2])
    assert ratios_of(alone) == []
    assert table([alone]) is None

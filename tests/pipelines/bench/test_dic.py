"""The benchmark of image correlation tells the truth about errors; times are only reported."""

import numpy as np
import pytest

from pipelines.bench.dic import make_film, run
from pipelines.bench.dic_peers import keys_correlation
from pipelines.bench.dic_scenes import disturbances


def test_the_film_is_shifted_exactly() -> None:
    film, shifts = make_film(96, 21, 0.0)
    assert shifts[20].tolist() == pytest.approx([2.0, 1.0])
    assert np.abs(film[20].astype(int) - np.roll(film[0], (1, 2), (0, 1))).max() <= 1


def test_the_emulation_of_dice_has_the_bias_that_dice_has() -> None:
    # 0.0016 px at 31 px, no filter, measured with DICe itself on a pattern like this one
    film, shifts = make_film(96, 11, 0.0)
    points = np.array([(x, y) for x in (36.0, 58.0) for y in (36.0, 58.0)])
    bias = np.abs((keys_correlation(film, points, 31) - shifts[:, None]).mean(axis=1)).max()
    assert 0.0008 < bias < 0.0024


@pytest.mark.slow
def test_scenes_in_which_more_changes_than_the_place() -> None:
    points = {point.setting: point for point in disturbances(quick=True).points}
    covered = points.pop("a wire before the specimen")
    assert covered.extra["off by more than 5 u"] < 40
    assert points["bare edge blurred after sampling"].extra["lost (%)"] == 100.0
    assert all(point.extra["off by more than 5 u"] == 0 for point in points.values())
    clean = points["nothing changes"]
    assert clean.error == pytest.approx(clean.extra["error, change not solved for (px)"], rel=0.02)
    changed = {name: point for name, point in points.items() if point.extra["of what the change costs, recovered (%)"]}
    assert len(changed) == 9
    for point in changed.values():
        assert point.extra["of what the change costs, recovered (%)"] > 75.0
        assert 0.85 < point.extra["u / scatter"] < 1.8  # of few frames; bricks are edges without a lens
        assert point.extra["lost (%)"] < 5.0


@pytest.mark.slow
def test_every_setting_beats_lucas_kanade_and_nears_the_bound() -> None:
    suite, scenes = run(quick=True)
    assert sum(p.is_default for p in scenes.points) == 1
    assert sum(p.is_default for p in suite.points) == 1
    by_window = {(p.group, w): p for p in suite.points for w in (21, 31) if f"{w} px" in p.setting}
    for point in suite.points:
        assert point.seconds > 0
        if point.group == "":
            window = 31 if "31 px" in point.setting else 21
            peer = by_window["OpenCV Lucas–Kanade", window]
            assert point.error < peer.error
            assert point.extra["error / bound"] < 1.12
            assert point.extra["bias (px)"] < 0.1 * peer.extra["bias (px)"]

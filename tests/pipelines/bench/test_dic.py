"""The benchmark of image correlation: true errors; times are only reported."""

import numpy as np
import pytest

from pipelines.bench.dic import make_film, run
from pipelines.bench.dic_peers import keys_correlation


def test_the_film_is_shifted_exactly() -> None:
    film, shifts = make_film(96, 21, 0.0)
    assert shifts[20].tolist() == pytest.approx([2.0, 1.0])
    inside = np.s_[12:-12, 12:-12]
    assert np.abs(film[20].astype(int) - np.roll(film[0], (1, 2), (0, 1)))[inside].max() <= 1


def test_the_emulation_of_dice_errs_as_its_interpolation_does() -> None:
    film, shifts = make_film(96, 11, 0.0)
    points = np.array([(x, y) for x in (36.0, 58.0) for y in (36.0, 58.0)])
    bias = np.abs((keys_correlation(film, points, 31) - shifts[:, None]).mean(axis=1)).max()
    assert 0.001 < bias < 0.02


@pytest.mark.slow
def test_every_setting_beats_lucas_kanade_and_nears_the_bound() -> None:
    suite = run(quick=True)
    assert sum(p.is_default for p in suite.points) == 1
    peer = next(p for p in suite.points if p.group == "OpenCV")
    for point in suite.points:
        assert point.seconds > 0
        if point.group == "":
            assert point.error < peer.error
            assert point.extra["error / bound"] < 1.3

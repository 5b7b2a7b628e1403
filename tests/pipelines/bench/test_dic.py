"""The benchmark of image correlation tells the truth about errors; times are only reported."""

import numpy as np
import pytest

from pipelines.bench.dic import make_film, run


def test_the_film_is_shifted_exactly() -> None:
    film, shifts = make_film(96, 21, 0.0)
    assert shifts[20].tolist() == pytest.approx([2.0, 1.0])
    assert np.abs(film[20].astype(int) - np.roll(film[0], (1, 2), (0, 1))).max() <= 1


@pytest.mark.slow
def test_every_setting_beats_lucas_kanade_and_nears_the_bound() -> None:
    rows = {row["setting"]: row for row in run(quick=True)}
    assert sum(bool(row["is_default"]) for row in rows.values()) == 1
    for name, row in rows.items():
        assert row["seconds"] > 0
        if not name.startswith("Lucas"):
            peer = rows[f"Lucas–Kanade, 3 levels, {name.split(', ')[2]}"]
            assert row["error"] < min(peer["error"], 1.12 * row["bound"])
            assert row["bias"] < 0.1 * peer["bias"]

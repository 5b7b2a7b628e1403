"""Clean sessions of all kinds are believed, and no model differs.

All that a session states lies off the truth by its stated uncertainty. At most 2 % of the experiments may be doubtful.
"""

from collections.abc import Sequence
from pathlib import Path

import pytest

from pipelines.session import verdict
from tests.pipelines.deviations import write_specimens


@pytest.mark.parametrize(
    "seeds", [pytest.param(range(3), marks=pytest.mark.slow), pytest.param(range(3, 20), marks=pytest.mark.nightly)]
)
@pytest.mark.filterwarnings("ignore")
def test_clean_sessions_are_believed(seeds: Sequence[int], tmp_path: Path) -> None:
    found = []
    for seed in seeds:
        folder = tmp_path / str(seed)
        write_specimens(folder, seed)
        found += [(seed, one) for one in verdict(folder, ("judgement",), jobs=0).experiments]
    assert len(found) > 6 * len(seeds)
    wrong = [(seed, one) for seed, one in found if one.believable != "yes"]
    assert [each for each in found if each[1].believable == "impossible" or each[1].model == "differs"] == []
    assert len(wrong) <= 0.02 * len(found), wrong

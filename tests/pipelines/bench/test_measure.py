"""Timing in turn, and what a point may be."""

import pytest

from labpipe.errors import InputError
from pipelines.bench.measure import OURS, THESIS, Extra, paired, race


def test_contenders_run_in_turn_after_one_cold_run_each() -> None:
    calls: list[str] = []
    timings = paired({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 3)
    assert calls == ["a", "b"] * 4
    assert [len(t.samples) for t in timings.values()] == [3, 3]
    count = iter(range(9))
    assert paired({"a": lambda: next(count)}, 2)["a"].value == 0  # of the first run
    assert len(paired({"a": lambda: sum(range(1000))}, 50, budget=0.0)["a"].samples) == 1  # a spent budget
    with pytest.raises(InputError, match="0 repeats"):
        paired({"a": int}, 0)


def test_a_race_makes_a_point_of_every_contender() -> None:
    def judge(name: str, value: int) -> tuple[float, Extra]:
        return abs(value - 3.0), {"letters": len(name)}

    calls = {"exact": (OURS, lambda: 3), "coarse": (THESIS, lambda: 2)}
    exact, coarse = race(calls, 3, judge, "exact", per=10.0)
    assert (exact.setting, exact.error, exact.group, exact.is_default) == ("exact", 0.0, OURS, True)
    assert (coarse.error, coarse.group, coarse.is_default, coarse.extra) == (1.0, THESIS, False, {"letters": 6})
    assert exact.seconds == sorted(exact.samples)[1] / 10.0

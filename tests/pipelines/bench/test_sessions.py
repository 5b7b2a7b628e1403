"""The benchmark of whole sessions: what is processed is right, and all ways agree."""

import pytest

from pipelines.bench.sessions import run


@pytest.mark.slow
def test_a_session_is_right_and_nothing_runs_twice() -> None:
    suite = run(quick=True)
    errors = {point.error for point in suite.points}
    assert len(errors) == 1
    assert errors.pop() < 2.0  # of six impacts; 0.6 is usual
    (cold,) = [p.seconds for p in suite.points if p.is_default]
    (again,) = [p.seconds for p in suite.points if p.setting == "nothing changed"]
    assert again < cold

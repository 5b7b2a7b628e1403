"""Mistakes of a laboratory with a static loading are noticed and named; clean ones are believed."""

from pathlib import Path

import pytest

from pipelines.session import Verdict
from tests.mistakes.rows import Mistake, by_day, hold, judged
from tests.mistakes.static_rows import ROWS, drawn, write


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean session, processed."""
    folder = write(tmp_path_factory.mktemp("clean"))
    _judged(folder)
    return folder


def _judged(folder: Path) -> Verdict:
    return judged(folder, "comparison")


def test_clean_session_is_believed_and_agrees(clean: Path) -> None:
    found = _judged(clean)
    assert (found.believable, found.model, found.findings) == ("yes", "agrees", ())
    assert 6 < found.checks <= 12


@pytest.mark.parametrize("mistake", by_day(ROWS, 6))
def test_mistake_is_noticed_and_named(clean: Path, tmp_path: Path, mistake: Mistake) -> None:
    hold(clean, tmp_path / "session", mistake, "approach", otherwise="comparison")


@pytest.mark.parametrize(
    "sessions", [pytest.param(6, marks=pytest.mark.slow), pytest.param(200, marks=pytest.mark.nightly)]
)
def test_clean_sessions_are_believed(tmp_path: Path, sessions: int) -> None:
    """What is stated is drawn from its uncertainty; at most 2 % of sessions may be doubtful."""
    said = {number: _judged(drawn(tmp_path / str(number), number)) for number in range(sessions)}
    off = {n: [f.message for f in v.findings if f.level != "note"] for n, v in said.items() if v.believable != "yes"}
    assert [n for n in off if said[n].believable != "doubtful"] == [], off
    assert len(off) <= 0.02 * sessions, off

"""Mistakes of a laboratory with a plate under drops are noticed and named; a clean one is believed."""

from pathlib import Path

import pytest

from pipelines.session import Verdict
from tests.mistakes.plate_rows import ROWS, write
from tests.mistakes.rows import Mistake, by_day, hold, judged


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean session, processed."""
    folder = write(tmp_path_factory.mktemp("clean"))
    _judged(folder)
    return folder


def _judged(folder: Path) -> Verdict:
    return judged(folder, "comparison", experiment="plate")


def test_clean_session_is_believed_and_agrees(clean: Path) -> None:
    found = _judged(clean)
    assert (found.believable, found.model, found.findings) == ("yes", "agrees", ())
    assert 8 < found.checks <= 12


@pytest.mark.parametrize("mistake", by_day(ROWS, 12))
def test_mistake_is_noticed_and_named(clean: Path, tmp_path: Path, mistake: Mistake) -> None:
    hold(clean, tmp_path / "session", mistake, "table", otherwise="comparison", experiment="plate")

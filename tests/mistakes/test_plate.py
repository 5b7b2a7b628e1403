"""Mistakes of a laboratory with a plate under drops are noticed and named; a clean one is believed."""

import shutil
from pathlib import Path

import pytest

from pipelines.session import Verdict, verdict
from tests.mistakes.drop_rows import Mistake
from tests.mistakes.outcome import assert_said
from tests.mistakes.plate_rows import ROWS, write


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean session, processed."""
    folder = write(tmp_path_factory.mktemp("clean"))
    _judged(folder)
    return folder


def _judged(folder: Path) -> Verdict:
    return next(v for v in verdict(folder, ["comparison"], jobs=0).experiments if v.experiment == "plate")


def test_clean_session_is_believed_and_agrees(clean: Path) -> None:
    found = _judged(clean)
    assert (found.believable, found.model, found.findings) == ("yes", "agrees", ())
    assert found.checks > 40


@pytest.mark.parametrize("mistake", ROWS, ids=lambda row: row.name)
def test_mistake_is_noticed_and_named(clean: Path, tmp_path: Path, mistake: Mistake) -> None:
    folder = tmp_path / "session"
    shutil.copytree(clean, folder)
    mistake.edit(folder)
    assert_said(mistake, _judged(folder))

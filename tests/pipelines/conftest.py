"""A small synthetic session, written once and copied for every test that changes it."""

import contextlib
import os
import shutil
from pathlib import Path

import pytest

from tests.pipelines.small import write_small


@pytest.fixture(scope="session")
def small_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two drops of acrylic over 0.15 s and a short indentation of NBR; not processed."""
    return write_small(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="session")
def pristine_session(small_session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small session as `process` leaves it: to be copied, never given to a verb."""
    folder = tmp_path_factory.mktemp("pristine") / "session"
    # What one worker of a run has processed serves those that come later.
    of_all = tmp_path_factory.getbasetemp().parent / "pristine" if "PYTEST_XDIST_WORKER" in os.environ else folder
    if of_all.is_dir():
        return Path(shutil.copytree(of_all, folder))
    from pipelines.session import process

    shutil.copytree(small_session, folder)
    outcome = process(folder, jobs=0)
    assert outcome.exit_code == 0, [o.message for o in outcome.failures]
    if of_all != folder:
        whole = Path(shutil.copytree(folder, folder.parent / "whole"))
        with contextlib.suppress(OSError):  # another worker came first
            whole.rename(of_all)
    return folder


@pytest.fixture(scope="session")
def processed_session(pristine_session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small session, processed, for tests that change no result; comparisons may have added their pages."""
    folder = tmp_path_factory.mktemp("processed") / "session"
    shutil.copytree(pristine_session, folder)
    return folder


@pytest.fixture
def session_copy(pristine_session: Path, tmp_path: Path) -> Path:
    """A processed session that a test may change."""
    folder = tmp_path / "session"
    shutil.copytree(pristine_session, folder)
    return folder

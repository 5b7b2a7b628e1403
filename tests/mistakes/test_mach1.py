"""Mistakes of a laboratory with a Mach-1 tester are noticed and named."""

from pathlib import Path

import pytest

from tests.mistakes.mach1_rows import HOLD_ROWS, WAVE_ROWS, write_holds, write_waves
from tests.mistakes.rows import Mistake, by_day, hold, judged

WAVES, HOLDS = ("hold", "oscillations"), ("ramps",)  # without the model, which these rows do not need


@pytest.fixture(scope="module")
def waves(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean oscillation, read and measured."""
    folder = write_waves(tmp_path_factory.mktemp("waves"))
    judged(folder, *WAVES)
    return folder


@pytest.fixture(scope="module")
def holds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean relaxation tests, read and measured."""
    folder = write_holds(tmp_path_factory.mktemp("holds"))
    judged(folder, *HOLDS)
    return folder


def test_clean_sessions_are_believed(waves: Path, holds: Path) -> None:
    for folder, targets in ((waves, WAVES), (holds, HOLDS)):
        found = judged(folder, *targets)
        assert (found.believable, found.findings) == ("yes", ())
        assert 8 < found.checks <= 14


@pytest.mark.parametrize("mistake", by_day(WAVE_ROWS, 6))
def test_mistake_with_an_oscillation_is_noticed_and_named(waves: Path, tmp_path: Path, mistake: Mistake) -> None:
    hold(waves, tmp_path / "session", mistake, *WAVES)


@pytest.mark.parametrize("mistake", by_day(HOLD_ROWS, 10))
def test_mistake_with_a_relaxation_is_noticed_and_named(holds: Path, tmp_path: Path, mistake: Mistake) -> None:
    hold(holds, tmp_path / "session", mistake, *HOLDS, otherwise="comparison")

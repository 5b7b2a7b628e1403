"""Numbers of whole sessions stay what they were, unless a reason was recorded."""

import shutil
from pathlib import Path

import pytest

from tests.pipelines.golden import SESSIONS, changes, numbers, processed, recorded

ADVICE = "record the reason: python -m tests.pipelines.golden SESSION 'why they changed'"


def test_the_numbers_of_the_small_session_are_the_recorded_ones(processed_session: Path) -> None:
    now = numbers(processed_session)
    assert len(now) > 60
    assert changes(recorded()["numbers"]["small"], now) == [], ADVICE


@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name in SESSIONS if name != "small"])
def test_the_numbers_of_the_sample_sessions_are_the_recorded_ones(tmp_path: Path, name: str) -> None:
    now = numbers(processed(name, tmp_path))
    shutil.rmtree(tmp_path)
    assert changes(recorded()["numbers"][name], now) == [], ADVICE


def test_every_record_has_a_reason() -> None:
    found = recorded()
    assert sum(map(len, found["numbers"].values())) >= 200
    assert {entry["session"] for entry in found["history"]} == set(found["numbers"])
    assert all(len(entry["reason"].split()) >= 3 for entry in found["history"])

"""What a killed recording leaves: readable, whole, and refused where it is damaged."""

from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import pytest

import instruments
from instruments.keyence import _journal as journals
from instruments.keyence._live import Reading
from instruments.keyence._markers import Status
from instruments.keyence._recorder import Sample, Setup, Tally, Trigger
from labpipe.errors import SourceError

HEAD = journals.Head(
    Setup((1, 3), (4, 2), ("mm", "um"), 0.01, "LK-G5001"),
    datetime(2026, 5, 14, 12, tzinfo=UTC),
    2.5,
    Trigger(3, -1.5e-3, False, 0.1),
)
SAMPLES = [
    Sample(slot, slot * 0.01 + 1e-4 / 3, 1e-3 / 7, Reading((slot, -slot), (Status.VALID, Status.ALARM)))
    for slot in (4, 5, 9)
]


def text() -> str:
    tally = Tally(2, 3, 'said "no"\nand hung up', 1)
    return journals.first_line(HEAD) + journals.lines(SAMPLES, tally)


def test_a_journal_gives_back_what_was_written_to_the_last_digit(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.recording"
    path.write_text(text())
    found = journals.read(path)
    assert found is not None
    assert found.head == HEAD
    assert list(found.samples) == SAMPLES
    assert asdict(found.tally)["last_error"] == 'said "no"\nand hung up'
    assert not found.torn


def test_a_journal_cut_anywhere_gives_every_whole_line(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.recording"
    whole = text().encode()
    head = len(journals.first_line(HEAD))
    for end in range(len(whole)):
        path.write_bytes(whole[:end])
        found = journals.read(path)
        lines = max(0, whole[:end].count(b"\n") - 1)
        if not lines:
            assert found is None
        else:
            assert found is not None
            assert list(found.samples) == SAMPLES[:lines]
            assert found.torn == (not whole[:end].endswith(b"\n"))
    assert head > 100


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('"recording":1', '"recording":2', 1, "version 2"),
        ('"outputs":[1,3]', '"outputs":[1]', 1, "expected a line of an unfinished recording"),
        ("[4, 0.04", "[-4, 0.04", 2, "expected a slot and 2 numbers"),
        ("[5, 0.05", "[4, 0.05", 3, "slot 4 cannot follow slot 4"),
        ("[9, 0.09", "[900000000, 0.09", 4, "cannot follow slot 5"),
        ("[9, -9]", "[9, -9, 1]", 4, "expected a slot and 2 numbers"),
        ("[9, -9]", "[9, -99999999999999999999]", 4, "expected a"),
        ("[5, -5], [0, 4]", "[5, -5], [0, 99]", 3, "one does not exist"),
        ('{"reconnections": 2', '{"reconnections": "two"', 5, "expected a line"),
        ("[9, 0.09", "\0", 4, "expected a line"),
    ],
)
def test_a_damaged_line_is_named(old: str, new: str, line: int, words: str, tmp_path: Path) -> None:
    assert old in text()
    path = tmp_path / "a.csv.recording"
    path.write_text(text().replace(old, new))
    with pytest.raises(SourceError, match=words) as error:
        journals.read(path)
    assert f":{line}" in str(error.value)


def test_an_unfinished_recording_is_no_file_of_an_instrument(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.recording"
    path.write_text(text())
    with pytest.raises(SourceError, match="labpipe acquire recover"):
        instruments.identify(path)
    with pytest.raises(SourceError, match="cannot be read"):
        journals.read(tmp_path / "absent.recording")

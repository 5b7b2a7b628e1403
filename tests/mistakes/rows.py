"""A mistake of a laboratory as a row of a corpus, and the one way in which all rows are held."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pipelines.session import Verdict, verdict
from tests.mistakes.recordings import Edit


@dataclass(frozen=True, slots=True)
class Mistake:
    """One edit of the clean session and what its verdict must hold.

    Attributes
    ----------
    name : str
    edit : callable
        Takes the session's folder.
    level : str
        The verdict; "note" stands for "yes" with a sentence.
    words : tuple of str
        Words of the findings' messages and causes, case aside.
    file : str
        File that a finding must name; empty for any.
    line : int, str or None
        Line of that file that it must name, by number or by a part of it.
    """

    name: str
    edit: Edit
    level: str
    words: tuple[str, ...] = ()
    file: str = ""
    line: int | str | None = None


def judged(folder: Path, *targets: str) -> Verdict:
    """Return the verdict on the one experiment of a session, from what some stages make."""
    return verdict(folder, targets or None, jobs=0).experiments[0]


def hold(clean: Path, folder: Path, mistake: Mistake, *targets: str) -> None:
    """Edit a copy of the clean session; nothing may go through without a word."""
    shutil.copytree(clean, folder)
    mistake.edit(folder)
    found = judged(folder, *targets)
    said = " ".join(f"{f.message} {f.cause}" for f in found.findings).lower()
    assert found.believable == ("yes" if mistake.level == "note" else mistake.level), said
    assert any(f.level == mistake.level for f in found.findings)
    assert [word for word in mistake.words if word.lower() not in said] == [], said
    if not mistake.file:
        return
    places = {(f.file, f.line) for f in found.findings}
    if mistake.line is None:
        assert mistake.file in {file for file, _ in places}
    elif isinstance(mistake.line, int):
        assert (mistake.file, mistake.line) in places
    else:
        lines = (folder / mistake.file).read_text("utf-8").splitlines()
        named = [lines[line - 1] for file, line in places if file == mistake.file and line]
        assert any(mistake.line in line for line in named), places


def by_day(rows: Sequence[Mistake], every: int) -> list[Any]:
    """Return a corpus as parameters of a test: by day one row of so many, all of them at night."""
    return [
        pytest.param(row, id=row.name, marks=() if number % every == 0 else pytest.mark.nightly)
        for number, row in enumerate(rows)
    ]

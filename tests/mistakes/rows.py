"""A mistake of a laboratory as a row of a corpus, and the one way in which all rows are held."""

import re
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

    ``level`` is the verdict, "note" for "yes" with a sentence; ``words`` stand in messages and causes, case aside; a
    finding names ``file`` and its ``line``, by number or a part of it; ``check`` of the session's audit tells it.
    """

    name: str
    edit: Edit
    level: str
    words: tuple[str, ...] = ()
    file: str = ""
    line: int | str | None = None
    check: str = ""


def judged(folder: Path, *targets: str, experiment: str = "") -> Verdict:
    """Return the verdict on one experiment of a session, by default the first, from what some stages make."""
    found = verdict(folder, targets or None, experiment or None, jobs=0).experiments
    return next(one for one in found if experiment in ("", one.experiment))


def hold(clean: Path, folder: Path, mistake: Mistake, *targets: str, otherwise: str = "", experiment: str = "") -> None:
    """Edit a copy of the clean session and hold its verdict; what the targets do not tell is asked of ``otherwise``."""
    shutil.copytree(clean, folder)
    mistake.edit(folder)
    lacking = _lacking(mistake, folder, judged(folder, *targets, experiment=experiment))
    if lacking and otherwise:
        lacking = _lacking(mistake, folder, judged(folder, otherwise, experiment=experiment))
    assert not lacking, "; ".join(lacking)


def _lacking(mistake: Mistake, folder: Path, found: Verdict) -> list[str]:
    """Say what a verdict lacks of what it must hold."""
    said = " ".join(f"{f.message} {f.cause}" for f in found.findings).lower()
    lacking = [f"not said: {word}" for word in mistake.words if word.lower() not in said]
    lacking += misspelt(said)
    lacking += [f"no text of {f.file}:{f.line}" for f in found.findings if f.line and (not f.value or "\0" in f.value)]
    if found.believable != ("yes" if mistake.level == "note" else mistake.level):
        lacking.append(f"the verdict is {found.believable}")
    if not any(f.level == mistake.level for f in found.findings):
        lacking.append(f"no finding is {mistake.level}")
    places = {(f.file, f.line) for f in found.findings if f.file == mistake.file}
    if mistake.file and not places:
        lacking.append(f"{mistake.file} is not named")
    elif isinstance(mistake.line, int) and (mistake.file, mistake.line) not in places:
        lacking.append(f"line {mistake.line} is not named, but {places}")
    elif isinstance(mistake.line, str):
        lines = (folder / mistake.file).read_text("utf-8").splitlines()
        if not any(mistake.line in lines[line - 1] for _, line in places if line):
            lacking.append(f"no line with {mistake.line} is named, but {places}")
    return [*lacking, f"said: {said}"] if lacking else []


def misspelt(said: str) -> list[str]:
    """Name numbers that are not written as the house writes them: "6 %" with a space, factors without an exponent."""
    return [f"not so: {found}" for found in re.findall(r"\d%|\de\+\d", said)]


def by_day(rows: Sequence[Any], every: int) -> list[Any]:
    """Return a corpus as parameters of a test: by day one row of ``every``, the others with the slow tests."""
    return [
        pytest.param(row, id=row.name, marks=pytest.mark.slow if number % every else ())
        for number, row in enumerate(rows)
    ]

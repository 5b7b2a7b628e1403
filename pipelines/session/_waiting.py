"""Experiments that wait for lines of their settings, as findings that name each line and what is to be done."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from labpipe.workflow.document import parse
from labpipe.workflow.session import FILE_NAME, Session

if TYPE_CHECKING:
    from labpipe.judging import Finding

WAITING = "waiting"
"""State of such an experiment."""
_LINE = re.compile(r"(?P<file>[^:]+):(?P<line>\d+): (?P<text>.*)", re.DOTALL)
_CHECK = "settings"


def that_wait(session: Session) -> Iterator[tuple[str, str, tuple[Finding, ...]]]:
    """Yield name, kind as it is written, and findings of every experiment that waits."""
    tables = parse(session.root / FILE_NAME).tree.get("experiments", {}) if session.waiting else {}
    for name, lines in session.waiting.items():
        yield name, str(tables.get(name, {}).get("kind", "")), tuple(map(_finding, lines))


def _finding(problem: str) -> Finding:
    from labpipe.judging import Finding

    place = _LINE.fullmatch(problem)
    if place is None:
        return Finding(_CHECK, "note", problem, f"correct {FILE_NAME}", FILE_NAME)
    file, line, text = place["file"], int(place["line"]), place["text"]
    if text.endswith("which waits"):
        remedy = "it runs as soon as that one does: see there"
    else:
        what = "fill in" if "to be filled in" in text else "correct"
        remedy = f"{what} line {line} of {file}, then process again"
    return Finding(_CHECK, "note", text, remedy, file, line)

"""Files of a session that no experiment uses: recordings and records that may have been forgotten."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from labpipe.workflow.session import Session
from labpipe.workflow.store import Store
from pipelines.session._proposal import recognised_below
from pipelines.session._session_checks import Named, named_files

if TYPE_CHECKING:
    from labpipe.judging import Finding

_MOST_NAMES = 3
"""Names in a sentence; more of them are counted."""


def unused_files(session: Session) -> list[Finding]:
    """Find files of known instruments, and records, that no experiment names; one that waits may name any.

    They are notes, one for what is alike in one folder.
    """
    from labpipe.judging import Finding

    if session.waiting:
        return []
    named = named_files(session)
    used = {n.path.resolve() for n in named}
    groups: dict[tuple[str, str], list[str]] = {}
    for name, title in recognised_below(session.root, used):
        groups.setdefault((title, Path(name).parent.as_posix()), []).append(name)
    found = []
    for (title, _), names in groups.items():
        twins, n = _twins(session, named, names), len(names)
        shown = ", ".join(names[:_MOST_NAMES]) + (f" and {n - _MOST_NAMES} more" if n > _MOST_NAMES else "")
        what = f"{shown} ({title}{f', {n} files' if n > 1 else ''})"
        cause = f"{twins}: a copy that can go" if twins else "an experiment lacks a recording, or the file can go"
        found.append(Finding("files that no experiment uses", "note", f"no experiment uses {what}", cause, names[0]))
    return found


def _twins(session: Session, named: Sequence[Named], names: Sequence[str]) -> str:
    """Say which used file an unused one repeats."""
    index = Store(session.folder).index
    sizes: dict[int, list[Named]] = {}
    for one in named:
        if one.path.is_file():
            sizes.setdefault(one.path.stat().st_size, []).append(one)
    for name in names:
        path = session.root / name
        for twin in sizes.get(path.stat().st_size, ()):  # others are not read for it
            if index.digest(twin.path) == index.digest(path):
                return f"{name} holds the same bytes as {twin.name}"
    return ""

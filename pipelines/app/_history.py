"""Versions of the set-up: the difference of two in words and lines, the writing of one, and those before it."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from labpipe import files
from labpipe.errors import InputError
from labpipe.workflow.session import FILE_NAME
from pipelines.app._edits import EXPERIMENTS, inline, tree_of
from pipelines.experiments import KINDS

_FOLDER = "labpipe/history"


def difference(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Return the lines that a change takes out and puts in, as a unified difference."""
    lines: list[str] = []
    for name in dict.fromkeys((*new, *old)):
        before, after = (texts.get(name, "").splitlines() for texts in (old, new))
        lines += difflib.unified_diff(before, after, name, f"{name}, changed", lineterm="", n=2)
    return lines


def in_words(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Say in a sentence each which files, experiments and values come, go, or change."""
    said = []
    for name in dict.fromkeys((*new, *old)):
        before, after = (tree_of(texts.get(name, "")) for texts in (old, new))
        of_before, of_after = (tree.pop(EXPERIMENTS, {}) for tree in (before, after))
        if name not in new or name not in old:
            said.append(f"{name} is {'new' if name in new else 'removed'}")
        else:
            said += [f"{name}: {line}" for line in _values(before, after)]
        gone = {one: table for one, table in of_before.items() if one not in of_after}
        for one, table in of_after.items():
            former = next((old for old, its in gone.items() if its == table), None) if one not in of_before else one
            if former is None:
                kind = KINDS.get(str(table.get("kind")))
                said.append(f"{one}: new{f', {kind.title}' if kind else ''}")
            elif former != one:
                del gone[former]
                said.append(f"{former}: is called {one} now")
            else:
                said += [f"{one}: {line}" for line in _values(of_before[one], table)]
        said += [f"{one}: left out" for one in gone]
    return said


def _values(before: Any, after: Any, place: str = "") -> Iterator[str]:
    """Say which values differ between two tables."""
    items = [*(before if isinstance(before, list) else ()), *(after if isinstance(after, list) else ())]
    if isinstance(before, dict | None) and isinstance(after, dict):
        before = before or {}
        for key in dict.fromkeys((*after, *before)):
            yield from _values(before.get(key), after.get(key), f"{place} {key.replace('_', ' ')}".strip())
    elif items and all(isinstance(item, dict) for item in items):
        for number, (old, new) in enumerate(itertools.zip_longest(before or (), after or ()), 1):
            yield from _values(old, new, f"{place} {number}")
    elif isinstance(before, list) and isinstance(after, list) and all(isinstance(item, str) for item in items):
        yield from (f"{place}: {item} is added" for item in after if item not in before)
        yield from (f"{place}: {item} is taken out" for item in before if item not in after)
    elif before != after:
        yield f"{place}: {_shown(before)} → {_shown(after)}"


def _shown(value: Any) -> str:
    """Return a value as a reader writes it."""
    if isinstance(value, str):
        return "to be filled in" if value.startswith("FILL") else value.replace("degC", "°C")
    return "–" if value is None else inline(value) if isinstance(value, list) else str(value)


def write(folder: Path, old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Write the changed files, session.toml last, and return the names.

    The version before is kept first, in a folder of ``labpipe/history`` named by the time; an empty file stands for one
    that was not there.
    """
    changed = [name for name in dict.fromkeys((*new, *old)) if new.get(name) != old.get(name)]
    names = sorted(changed, key=lambda name: name == FILE_NAME)
    when = f"{datetime.now(UTC):%Y-%m-%d %H.%M.%S.%f}"
    for name in names:
        files.write_text(files.safe_join(folder, f"{_FOLDER}/{when}/{name}"), old.get(name, ""))
    for name in names:
        if name in new:
            files.write_text(files.safe_join(folder, name), new[name])
        else:
            files.safe_join(folder, name).unlink()
    return names


def versions(folder: Path) -> list[str]:
    """Return the names of the versions that were kept, the latest first."""
    kept = files.safe_join(folder, _FOLDER)
    return sorted((place.name for place in kept.iterdir() if place.is_dir()), reverse=True) if kept.is_dir() else []


def version(folder: Path, name: str) -> dict[str, str]:
    """Return the texts of a version by file; an empty one was not there."""
    if name not in versions(folder):
        raise InputError(f'there is no version "{name}" of the set-up')
    kept = files.safe_join(folder, f"{_FOLDER}/{name}")
    return {p.relative_to(kept).as_posix(): p.read_bytes().decode("utf-8-sig") for p in files.files_below(kept)}

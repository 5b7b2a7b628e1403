"""Synthetic sessions: written, processed without a failure, read, and copied with one text changed."""

import json
import shutil
from collections.abc import Collection
from pathlib import Path
from typing import Any

from labpipe import files
from pipelines.rig.session_text import session_head
from pipelines.session import open_session, process


def begun(folder: Path, sections: str, **records: str) -> Path:
    """Write the records and session.toml."""
    for name, text in records.items():
        files.write_text(folder / f"calibration/{name}.toml", text)
    files.write_text(folder / "session.toml", session_head("Of a test (synthetic)") + sections)
    return folder


def processed(folder: Path, targets: Collection[str] | None = None, only: Collection[str] | None = None) -> Path:
    outcome = process(folder, targets, only, jobs=0)
    assert outcome.exit_code == 0, [o.message for o in outcome.failures]
    return folder


def truth(folder: Path, name: str) -> dict[str, Any]:
    known: dict[str, Any] = json.loads((folder / f"truth/{name}.json").read_text("utf-8"))
    return known


def settings_of(folder: Path, name: str) -> Any:
    return open_session(folder).experiments[name].settings


def page_of(folder: Path, name: str) -> str:
    return (folder / f"labpipe/reports/{name}.html").read_text("utf-8")


def replaced(folder: Path, old: str, new: str, file: str = "session.toml") -> None:
    """Replace the first occurrence of a text in a file of a session."""
    text = (folder / file).read_text("utf-8")
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1), "utf-8")


def copied(session: Path, room: Path, old: str, new: str, file: str = "session.toml", ignored: str = "") -> Path:
    """Copy a session, without the files of a name, and replace a text in it."""
    folder = Path(shutil.copytree(session, room / "session", ignore=shutil.ignore_patterns(ignored)))
    replaced(folder, old, new, file)
    return folder

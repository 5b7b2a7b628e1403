"""Every file of a folder: what it is, why it is used or not, and by what."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import instruments
from labpipe.errors import InputError
from labpipe.files import printable, safe_join
from labpipe.workflow.document import nodes
from labpipe.workflow.session import FILE_NAME
from pipelines.session._proposal import PICTURE, recognise, wholes, why_unknown

_MOST = 5000
"""Entries; more would be nobody's list."""
_BY_CONTENT = "recognised by its content"


@dataclass(frozen=True, slots=True)
class Surveyed:
    """One file, or a folder that is one recording.

    Attributes
    ----------
    name : str
        Relative to the folder; characters that are not seen by their codes.
    kind : str
        What wrote it, in words; empty when nothing is known.
    content : str
        One of :data:`instruments.CONTENTS`, ``"record"``, ``"picture"``, or empty.
    reason : str
        Why it is recognised, or of no use.
    copy_of : str
        The file with the same bytes that counts as the first; empty where there is none.
    used_by : tuple of str
        Experiments of session.toml that name it.
    size : int [byte]
    modified : str
        Day and time, UTC.
    """

    name: str
    kind: str
    content: str
    reason: str
    copy_of: str
    used_by: tuple[str, ...]
    size: int
    modified: str

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        return asdict(self) | {"used_by": list(self.used_by)}


def survey(folder: Path) -> list[Surveyed]:
    """Look at every file of a folder, in the order of their names, the first 5000.

    Hidden files, session.toml and what labpipe writes are left out.
    """
    found = recognise(folder)
    titles = {each.name: each for each in instruments.known()}
    of_instrument = {name: titles[key] for key, names in found.names.items() if key in titles for name in names}
    whole = {place.relative_to(folder).as_posix(): each for place, each in wholes(folder).items()}
    used = _users(folder)
    has_session = (folder / FILE_NAME).is_file()
    entries = []
    for name, (title, reason) in found.owners.items():
        if Path(name).parent.as_posix() in whole:
            continue
        copy_of = found.copies.get(name, "")
        instrument = of_instrument.get(copy_of or name)
        content: str = instrument.content if instrument else "record" if name.endswith(".toml") else ""
        why = reason
        if name in used or (not has_session and not copy_of and not (instrument and instrument.unproposed)):
            why = _BY_CONTENT if has_session else f"{_BY_CONTENT}; no session is proposed yet"
        is_record = title.startswith("record:")
        kind = f"calibration record of a {title.partition(':')[2]}" if is_record else title
        entries.append(_entry(folder, name, kind, content, why, copy_of, used))
    for name, each in whole.items():
        reason = "recognised by its images" if name in used else each.unproposed
        entries.append(_entry(folder, name, each.title, each.content, reason, "", used))
    for name in found.unknown:
        if Path(name).parent.as_posix() not in whole:
            reason = why_unknown(folder, name)
            content = "picture" if reason == PICTURE else ""
            entries.append(_entry(folder, name, "picture" if content else "", content, reason, "", used))
    return sorted(entries, key=lambda entry: entry.name)[:_MOST]


def _entry(
    folder: Path, name: str, kind: str, content: str, reason: str, copy_of: str, used: dict[str, list[str]]
) -> Surveyed:
    status = (folder / name).lstat()
    when = datetime.fromtimestamp(status.st_mtime, UTC).isoformat(timespec="minutes")[:16].replace("T", " ")
    return Surveyed(printable(name), kind, content, reason, copy_of, tuple(used.get(name, ())), status.st_size, when)


def _users(folder: Path) -> dict[str, list[str]]:
    """Return every text of an experiment that names a file, with the experiments that do."""
    try:
        tree = tomllib.loads(safe_join(folder, FILE_NAME).read_text("utf-8-sig"))
    except (OSError, ValueError, RecursionError, InputError):
        return {}
    experiments = tree.get("experiments", {})
    users: dict[str, list[str]] = {}
    for experiment, table in experiments.items() if isinstance(experiments, dict) else ():
        for text in {node for node in nodes(table) if isinstance(node, str)}:
            users.setdefault(text, []).append(experiment)
    return users

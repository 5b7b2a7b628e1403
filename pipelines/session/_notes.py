"""The verb note: a dated note on an experiment, appended to session.toml."""

from __future__ import annotations

import datetime
import tomllib
from pathlib import Path

import tomlkit
import tomlkit.items

from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.workflow import session as sessions
from labpipe.workflow.document import dotted
from labpipe.workflow.exclusions import Note
from labpipe.workflow.fields import suggest
from pipelines.session._results import load, reopen_session


def note(folder: str | Path, experiment: str, text: str, *, who: str = "") -> Note:
    """Append a note of today to an experiment in session.toml; remarks and order of the file stay.

    Parameters
    ----------
    folder : path-like
        The session folder.
    experiment : str
        Its name.
    text : str
        The note.
    who : str, optional
        Whose note it is; by default the operator of the session.

    Returns
    -------
    Note

    Examples
    --------
    >>> note("my-session", "acrylic_7mm", "sphere cleaned with ethanol")  # doctest: +SKIP
    """
    session = reopen_session(folder)
    known = [*session.experiments, *session.waiting]
    if experiment not in known:
        raise UsageError(f'no experiment "{experiment}"{suggest(experiment, known)}')
    made = Note(on=datetime.datetime.now().astimezone().date(), text=text.strip(), who=who or session.operator)
    path = Path(folder) / sessions.FILE_NAME
    changed = with_note(path.read_bytes().decode(), experiment, made)
    load(path, text=changed.removeprefix("\ufeff"), may_lack=known)
    files.write_text(path, changed)
    return made


def with_note(text: str, experiment: str, made: Note) -> str:
    """Return the text of session.toml with a note appended to an experiment; InputError where none can be."""
    if not made.text:
        raise InputError("the note is empty")
    values = {"on": made.on} | ({"who": made.who} if made.who else {}) | {"text": made.text}
    try:
        meant, document = tomllib.loads(text.removeprefix("\ufeff")), tomlkit.parse(text.removeprefix("\ufeff"))
        place = ("variants" if experiment in meant.get("variants", {}) else "experiments", experiment, "notes")
        meant[place[0]][experiment].setdefault("notes", []).append(values)
        written = document[place[0]][experiment].get("notes")
        if isinstance(written, tomlkit.items.Array):
            entry = tomlkit.inline_table()
            entry.update(values)
            written.append(entry)
            changed = "\ufeff" * text.startswith("\ufeff") + tomlkit.dumps(document)
        else:
            block = f"[[{dotted(place)}]]\n{tomlkit.dumps(values)}"
            changed = text + "\n" * (not text.endswith("\n")) + "\n" + block
        is_meant = tomllib.loads(changed.removeprefix("\ufeff")) == meant
    except (ValueError, KeyError, TypeError, AttributeError):
        is_meant = False
    if not is_meant:
        raise InputError(f"{sessions.FILE_NAME}: no note can be appended to {experiment}; write it by hand")
    return changed

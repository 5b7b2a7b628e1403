"""The verb note: a dated note on an experiment, appended to session.toml."""

from __future__ import annotations

import datetime
import json
import tomllib
from pathlib import Path

from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.workflow import session as sessions
from labpipe.workflow.document import dotted, end_of_list
from labpipe.workflow.exclusions import Note
from labpipe.workflow.fields import suggest
from pipelines.session._results import SETTINGS, reopen_session


def note(folder: str | Path, experiment: str, text: str, *, who: str = "", on: datetime.date | None = None) -> Note:
    """Append a dated note to an experiment in session.toml; the rest of the file stays byte for byte.

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
    on : date, optional
        By default today.

    Returns
    -------
    Note

    Raises
    ------
    UsageError
        There is no such experiment.
    InputError
        The note is empty, or the file is written so that nothing can be appended.

    Examples
    --------
    >>> note("my-session", "acrylic_7mm", "sphere cleaned with ethanol")  # doctest: +SKIP
    """
    session = reopen_session(folder)
    known = [*session.experiments, *session.waiting]
    if experiment not in known:
        raise UsageError(f'no experiment "{experiment}"{suggest(experiment, known)}')
    made = Note(on=on or datetime.datetime.now().astimezone().date(), text=text.strip(), who=who or session.operator)
    path = Path(folder) / sessions.FILE_NAME
    changed = with_note(path.read_bytes().decode(), experiment, made)
    sessions.load(path, SETTINGS, text=changed.removeprefix("\ufeff"), may_lack=known)
    files.write_text(path, changed)
    return made


def with_note(text: str, experiment: str, made: Note) -> str:
    """Return the text of session.toml with a note appended to an experiment.

    Raises
    ------
    InputError
        The note is empty, the text is not TOML, or the table of the experiment takes no note.
    """
    if not made.text:
        raise InputError("the note is empty")
    values = {"on": made.on} | ({"who": made.who} if made.who else {}) | {"text": made.text}
    lines = [f"{k} = {json.dumps(v, ensure_ascii=False) if isinstance(v, str) else v}" for k, v in values.items()]
    try:
        meant = tomllib.loads(text.removeprefix("\ufeff"))
        place = ("variants" if experiment in meant.get("variants", {}) else "experiments", experiment, "notes")
        meant[place[0]][experiment].setdefault("notes", []).append(values)
        end, is_first = end_of_list(text, place)
        entry = f"{{ {', '.join(lines)} }}"
        block = "\n".join(["", f"[[{dotted(place)}]]", *lines, ""])
        changed = text + "\n" * (not text.endswith("\n")) + block
        changed = changed if end is None else f"{text[:end]}{'' if is_first else ', '}{entry}{text[end:]}"
        is_meant = tomllib.loads(changed.removeprefix("\ufeff")) == meant
    except (ValueError, KeyError, TypeError, AttributeError):
        is_meant = False
    if not is_meant:
        raise InputError(f"{sessions.FILE_NAME}: no note can be appended to {experiment}; write it by hand")
    return changed

"""The set-up of a session as the page shows it, and changes to it: checked, compared, written."""

from __future__ import annotations

import difflib
import hashlib
import itertools
import re
import typing
from collections.abc import Mapping
from datetime import date
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import msgspec

from calibration import KINDS as RECORDS
from labpipe import files
from labpipe.errors import ConfigError, InputError, LabpipeError
from labpipe.files import safe_join
from labpipe.workflow import config, session as sessions
from labpipe.workflow.document import dotted, nodes, parse
from labpipe.workflow.fields import GAP, FileMark, ReferenceMark, describe, is_gap, mark, split
from labpipe.workflow.session import FILE_NAME
from pipelines.app import _edits as edits
from pipelines.experiments import KINDS
from pipelines.session import COLUMNS, SETTINGS, bare_type, gap_for, in_unit, library_names, remedy

Told = dict[str, Any]
_PROBLEM = re.compile(r'^([^:\n]+):(\d+)(?::\d+)?: (?:((?:"(?:[^"\\]|\\.)*"|[^\s:"])+): )?(.*)$', re.DOTALL)


def read(folder: Path) -> dict[str, str]:
    """Return the texts of session.toml and of every calibration record, by name.

    Raises
    ------
    LabpipeError
        session.toml is not there, or a link that leads out of the folder.
    """
    path = safe_join(folder, FILE_NAME)
    if not path.is_file():
        raise InputError("there is no session.toml yet; propose a session from the files first")
    texts = {FILE_NAME: _text(path)}
    for each in files.files_below(folder):
        name = each.relative_to(folder).as_posix()
        if each.suffix == ".toml" and name != FILE_NAME and not name.startswith((".", "labpipe/", "truth/")):
            try:
                if parse(safe_join(folder, name)).tree.get("kind") in RECORDS:
                    texts[name] = _text(each)
            except LabpipeError:
                continue  # no record that could be shown
    return texts


def _text(path: Path) -> str:
    return path.read_bytes().decode("utf-8-sig")


def digest(texts: Mapping[str, str]) -> str:
    """Return a digest that shows whether somebody else has changed the files meanwhile."""
    return hashlib.sha256(files.canonical(dict(texts)).encode()).hexdigest()


def changed(texts: Mapping[str, str], asked: Any) -> dict[str, str]:
    """Apply changes one after the other.

    ``texts``: of :func:`read`; ``asked``: ``{"op": "set", "file", "place", "text"}``, ``rename`` (``name``, ``to``),
    ``remove`` (``name``), ``merge`` (``name``, ``other``, ``key``), ``split`` (``name``, ``to``, ``key``, ``names``),
    ``add`` (``name``, ``key``, ``names``). Raises InputError: a change cannot be made.
    """
    new = dict(texts)
    if not isinstance(asked, list):
        raise InputError("expected a list of changes")
    try:
        for file, edits_of in itertools.groupby(asked, key=_file_set):
            if file is None:
                for edit in edits_of:
                    _restructure(new, edit)
            else:
                _set(new, file, list(edits_of))
    except (KeyError, TypeError, AttributeError):
        raise InputError(f"a change that is not understood: {asked!r}"[:300]) from None
    return new


def _file_set(edit: Any) -> str | None:
    """Return the file in which an edit sets a value; None for an edit that moves experiments."""
    return str(edit["file"]) if edit["op"] == "set" else None


def _set(texts: dict[str, str], name: str, edits_of: list[Any]) -> None:
    if name not in texts:
        raise InputError(f'"{name}" is not part of the set-up')
    changes = []
    for edit in edits_of:
        place, typed = tuple(edit["place"]), str(edit["text"]).strip()
        if len(typed) > _LONGEST or not typed.isprintable():
            raise InputError(f"{place[-1]}: a value is one line of at most {_LONGEST} characters")
        kind, required = _type_at(texts[name], name, place)
        value = _as_value(kind, typed, _at(texts[name], place)) if typed else gap_for(kind) if required else None
        changes.append((place, value))
    texts[name] = edits.set_values(texts[name], changes)


def _restructure(texts: dict[str, str], edit: Any) -> None:
    op = edit["op"]
    text, name = texts[FILE_NAME], str(edit["name"])
    if op == "rename":
        text = edits.rename(text, name, str(edit["to"]).strip(), SETTINGS)
    elif op == "remove":
        text = edits.remove(text, name)
    elif op == "merge":
        text = edits.join(text, name, str(edit["other"]), str(edit["key"]))
    elif op == "split":
        text = edits.separate(text, name, str(edit["to"]).strip(), str(edit["key"]), list(edit["names"]))
    elif op == "add":
        text = edits.add(text, name, str(edit["key"]), [str(file) for file in edit["names"]])
    else:
        raise KeyError(op)
    texts[FILE_NAME] = text


_LONGEST = 2000


def _as_value(kind: Any, typed: str, before: Any) -> Any:
    """Return the value written for a typed text; a bare number gets the previous unit, or the usual one."""
    usual = gap_for(kind).removeprefix(GAP).strip()
    stood = before.rpartition(" ")[2] if usual and isinstance(before, str) else usual
    return edits.as_value(kind, in_unit(typed, usual if any(c.isdigit() for c in stood) else stood))


def _at(text: str, place: edits.Place) -> Any:
    node: Any = _tree(text)
    try:
        for key in place:
            node = node[key]
    except (KeyError, IndexError, TypeError):
        return None
    return node


def _type_at(text: str, name: str, place: edits.Place) -> tuple[Any, bool]:
    """Return the type of a field, and whether it must be there."""
    tree = _tree(text)
    if name == FILE_NAME:
        if place[:1] == ("session",) and place[1:] in (("title",), ("operator",), ("notes",)):
            return str, False
        kind = SETTINGS.get(str(tree["experiments"][place[1]].get("kind"))) if place[0] == edits.EXPERIMENTS else None
        node: Any = tree["experiments"][place[1]] if kind is not None else {}
        prefix: edits.Place = place[:2]
    else:
        kind, node, prefix = RECORDS.get(str(tree.get("kind"))), tree, ()
    for at, of, _ in () if kind is None else edits.values(kind, node, prefix):
        if at == place:
            return of, _is_required(kind, place[len(prefix) :])
    raise InputError(f"{'.'.join(map(str, place))}: there is no such setting")


def _is_required(kind: Any, path: edits.Place) -> bool:
    """Return whether a field and all tables around it must be there."""
    for key in path:
        if isinstance(key, int):
            continue
        info = next(f for f in msgspec.structs.fields(kind) if f.encode_name == key)
        if not info.required:
            return False
        bare = split(bare_type(info.type))[0]
        kind = typing.get_args(bare)[0] if typing.get_origin(bare) is list else bare
    return True


def _tree(text: str) -> dict[str, Any]:
    import tomllib

    try:
        return tomllib.loads(text.replace("\r\n", "\n"))
    except (ValueError, RecursionError):
        return {}


# --- what the page shows -------------------------------------------------------------------------


def state(folder: Path, texts: Mapping[str, str]) -> Told:
    """Return the set-up as texts give it: experiments, records, with their errors and missing values."""
    problems, waiting = _problems(folder, texts)
    tree = _tree(texts[FILE_NAME])
    records = [name for name in texts if name != FILE_NAME]
    tables = tree.get(edits.EXPERIMENTS, {})
    names = list(tables) if isinstance(tables, dict) else []
    experiments, remarks = [], edits.remarks(texts[FILE_NAME])
    for name in names:
        table = tables[name] if isinstance(tables[name], dict) else {}
        kind = KINDS.get(str(table.get("kind")))
        place: edits.Place = (edits.EXPERIMENTS, name)
        experiments.append(
            {
                "name": name,
                "kind": "" if kind is None else kind.name,
                "title": "no known kind" if kind is None else kind.title,
                "fields": []
                if kind is None
                else _fields(folder, kind.settings, table, place, FILE_NAME, names, records, remarks),
                "waits": name in waiting or _has_problem(name, table, problems),
            }
        )
    shown: list[Told] = []
    for name in records:
        record = _tree(texts[name])
        kind_of = RECORDS.get(str(record.get("kind")))
        if kind_of is not None:
            fields = _fields(folder, kind_of, record, (), name, names, records, edits.remarks(texts[name]))
            users = [
                one["name"] for one in experiments if any(f["text"] == name and not f["files"] for f in one["fields"])
            ]
            shown.append({"name": name, "kind": record["kind"], "fields": fields, "used_by": users})
    return {"experiments": experiments, "records": shown, "problems": problems}


def _fields(
    folder: Path,
    kind: Any,
    table: Any,
    prefix: edits.Place,
    file: str,
    names: list[str],
    records: list[str],
    remarks: Mapping[edits.Place, str],
) -> list[Told]:
    found = []
    for place, of, value in edits.values(kind, table, prefix):
        path = place[len(prefix) :]
        if path in (("kind",), ("version",)):
            continue
        bare, marks = split(bare_type(of))
        is_list = typing.get_origin(bare) is list
        choices: list[str] = []
        if typing.get_origin(bare) is Literal:
            choices = [str(a).lower() if isinstance(a, bool) else str(a) for a in typing.get_args(bare)]
        suggestions = list(library_names()) if path[-1] == "material" else []
        suggestions += records if mark(marks, FileMark) is not None and path[-1] in _RECORD_FIELDS else []
        suggestions += names if mark(marks, ReferenceMark) is not None else []
        for option in typing.get_args(bare):  # a word or a table
            suggestions += map(str, typing.get_args(option)) if typing.get_origin(option) is Literal else []
        suggestions += _columns_of(folder, table) if path[-1] == "columns" else []
        is_files = is_list and mark(split(typing.get_args(bare)[0])[1], FileMark) is not None
        found.append(
            {
                "file": file,
                "place": list(place),
                "dotted": dotted(place),
                "label": _label(path),
                "text": "" if value is None or is_gap(value) else _as_text(value),
                "files": value if is_files and isinstance(value, list) else None,
                "expected": _expected(of, path),
                "remark": remarks.get(place, ""),
                "required": _is_required(kind, path),
                "gap": is_gap(value),
                "choices": choices,
                "suggestions": suggestions,
            }
        )
    return found


def _has_problem(name: str, table: Mapping[str, Any], problems: list[Told]) -> bool:
    """Return whether something is wrong or missing in an experiment, or in a record that it names."""
    place = dotted((edits.EXPERIMENTS, name))
    inside, records = (f"{place}.", f"{place}["), [table.get(key) for key in _RECORD_FIELDS]
    return any(p["place"] == place or p["place"].startswith(inside) or p["file"] in records for p in problems)


_RECORD_FIELDS = ("calibration", "camera", "record")


_SYMBOLS = {"nu": "Poisson's ratio ν", "T_ref": "reference temperature"}


def _label(path: edits.Place) -> str:
    words = (
        f"{key + 1}" if isinstance(key, int) else _SYMBOLS.get(key, key.replace("_", " "))
        for key in path
        if key != "values"
    )
    return " ".join(words)


def _expected(kind: Any, path: edits.Place) -> str:
    """Describe the values of a field as typed here, where texts need no quotation marks."""
    if path[-1] == "material":
        return f"one of {', '.join(library_names())}"
    return describe(kind).replace("text in quotation marks", "a text").replace(" (without quotation marks)", "")


def _as_text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, dict):
        return edits.inline(value)
    return files.canonical(value) if isinstance(value, list) else str(value)


def _columns_of(folder: Path, table: Any) -> list[str]:
    """Propose the columns of the recordings that no instrument recognises, as far as their headings tell."""
    proposed = []
    for name in dict.fromkeys(node for node in nodes(table) if isinstance(node, str)):
        try:
            path = safe_join(folder, name)
            status = path.stat()
        except (InputError, OSError):  # not the name of a file
            continue
        if path.is_file() and path.suffix != ".toml":
            proposed.append(_proposed_columns(path, status.st_size, status.st_mtime_ns))
    return list(dict.fromkeys(filter(None, proposed)))


@lru_cache(1024)  # the page asks after every change
def _proposed_columns(path: Path, size: int, modified: int) -> str:
    del size, modified
    return remedy(path).partition(COLUMNS)[2]


def _problems(folder: Path, texts: Mapping[str, str]) -> tuple[list[Told], Mapping[str, Any]]:
    """Check every text by the code that reads it; return errors, and the waiting experiments."""
    told: list[str] = []
    waiting: Mapping[str, Any] = {}
    try:
        session = sessions.load(folder / FILE_NAME, SETTINGS, text=texts[FILE_NAME])
        waiting = session.waiting
        told += [line for lines in waiting.values() for line in lines]
    except ConfigError as error:
        told += error.problems
    except LabpipeError as error:
        told.append(f"{FILE_NAME}:1: {error}")
    told = [line for line in told if line.startswith(f"{FILE_NAME}:")]  # records are told by themselves
    for name, text in texts.items():
        kind = RECORDS.get(str(_tree(text).get("kind"))) if name != FILE_NAME else None
        if kind is not None:
            told += [f"{name}:{line.partition(':')[2]}" for line in _record_problems(folder / name, kind, text)]
    problems: dict[tuple[str, ...], Told] = {}
    for line in told:
        match = _PROBLEM.match(line)
        file, number, place, message = match.groups() if match is not None else (FILE_NAME, "1", "", line)
        if place and message.startswith("columns"):  # refused with the table around them
            place += ".columns"
        told_before = (file, place) if place else (file, "", message)
        problems.setdefault(told_before, {"file": file, "line": int(number), "place": place or "", "message": message})
    return list(problems.values()), waiting


def _record_problems(path: Path, kind: Any, text: str) -> list[str]:
    """Return the errors and missing values of a record."""
    gaps: list[str] = []
    try:
        document = parse(path, text)
        config.Checker(document, path.parent, gaps=gaps).structure(kind, document.tree, ())
        document.finish()
    except ConfigError as error:
        return [*error.problems, *gaps]
    except LabpipeError as error:
        return [f"{path.name}:1: {error}"]
    return gaps


def difference(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Return the lines that a change takes out and puts in, as a unified difference."""
    lines: list[str] = []
    for name, text in new.items():
        before = old.get(name, "").splitlines()
        lines += difflib.unified_diff(before, text.splitlines(), name, f"{name}, changed", lineterm="", n=2)
    return lines


def write(folder: Path, old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Write the changed files, session.toml last, and return the names."""
    names = sorted((name for name in new if new[name] != old.get(name)), key=lambda name: name == FILE_NAME)
    for name in names:
        files.write_text(safe_join(folder, name), new[name])
    return names

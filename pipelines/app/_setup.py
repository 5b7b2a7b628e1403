"""The set-up of a session as the page shows it, and changes to it: checked, compared, written."""

from __future__ import annotations

import contextlib
import getpass
import hashlib
import itertools
import re
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import msgspec

from calibration import KINDS as RECORDS
from labpipe import files
from labpipe.errors import ConfigError, InputError, LabpipeError
from labpipe.files import safe_join
from labpipe.workflow import config
from labpipe.workflow.document import counted, dotted, parse, texts_in
from labpipe.workflow.exclusions import Note
from labpipe.workflow.fields import GAP, FileMark, describe, is_gap, mark, split
from labpipe.workflow.graph import OTHER
from labpipe.workflow.session import FILE_NAME
from pipelines.app import _edits as edits, _history as history
from pipelines.app._edits import tree_of
from pipelines.experiments import JUDGEMENT, KINDS, Kind
from pipelines.experiments.shared.proposals import material_word
from pipelines.experiments.shared.record_templates import blank_record
from pipelines.session import COLUMNS, SETTINGS, gap_for, in_unit, library_names, load, remedy, template_of, with_note

Told = dict[str, Any]
_LONGEST = 2000  # characters of a value
_RECORD_FIELDS = ("calibration", "camera", "record")
_SYMBOLS = {"nu": "Poisson's ratio ν", "T_ref": "reference temperature"}
_PROBLEM = re.compile(r'(?s)^([^:\n]+):(\d+)(?::\d+)?: (?:((?:"(?:[^"\\]|\\.)*"| no\. \d+(?:, )?|[^\s:"])+): )?(.*)$')


def read(folder: Path) -> dict[str, str]:
    """Return the texts of session.toml, if it is there, and of every calibration record, by name.

    Raises
    ------
    LabpipeError
        session.toml is a link that leads out of the folder.
    """
    path = safe_join(folder, FILE_NAME)
    texts = {FILE_NAME: _text(path)} if path.is_file() else {}
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


def changed(
    folder: Path, texts: Mapping[str, str], asked: Any, proposed: Callable[[], dict[str, str]]
) -> dict[str, str]:
    """Apply changes one after the other.

    ``texts``: of :func:`read`; ``asked``: ``{"op": "set", "file", "place", "text"}``, ``rename`` (``name``, ``to``),
    ``remove`` (``name``), ``merge`` (``name``, ``other``, ``key``), ``split`` (``name``, ``to``, ``key``, ``names``),
    ``add`` (``name``, ``key``, ``names``), ``kind`` (``name``, ``to``), ``note`` (``name``, ``who``, ``text``),
    ``record`` (``kind``, ``view``, ``names``: of the experiments that take it), ``propose`` (by
    :func:`pipelines.session.draft`, where there is no session), and ``restore`` (``version``). Raises InputError: a
    change cannot be made.
    """
    new = dict(texts)
    if not isinstance(asked, list):
        raise InputError("expected a list of changes")
    try:
        for file, edits_of in itertools.groupby(asked, lambda one: str(one["file"]) if one["op"] == "set" else None):
            for edit in edits_of if file is None else ():
                if edit["op"] == "restore":
                    new |= history.version(folder, str(edit["version"]))
                    new = {name: text for name, text in new.items() if text}
                elif edit["op"] == "propose" and FILE_NAME not in new:
                    new |= proposed()
                elif FILE_NAME not in new:
                    raise InputError("there is no session.toml yet; propose a session from the files first")
                else:
                    _restructure(folder, new, edit)
            if file is not None:
                _set(new, file, list(edits_of))
    except (LookupError, TypeError, AttributeError):
        raise InputError(f"a change that is not understood: {asked!r}"[:300]) from None
    return new


def _set(texts: dict[str, str], name: str, edits_of: list[Any]) -> None:
    if name not in texts:
        raise InputError(f'"{name}" is not part of the set-up')
    changes = []
    for edit in edits_of:
        place = tuple(edit["place"])
        typed = _one_line(place[-1], edit["text"])
        kind, required = _type_at(texts[name], name, place)
        gap, before = gap_for(kind), _at(texts[name], place)
        # a bare number gets the previous unit, or the usual one
        usual = gap.removeprefix(GAP).strip()
        unit = before.rpartition(" ")[2] if usual and isinstance(before, str) else usual
        stated = in_unit(typed, usual if any(map(str.isdigit, unit)) else unit)
        changes.append((place, edits.as_value(kind, stated) if typed else gap if required else None))
    texts[name] = edits.set_values(texts[name], changes)


def _one_line(key: str | int, typed: Any) -> str:
    text = str(typed).strip()
    if len(text) > _LONGEST or not text.isprintable():
        raise InputError(f"{key}: a value is one line of at most {_LONGEST} characters")
    return text


def _restructure(folder: Path, texts: dict[str, str], edit: Any) -> None:
    op = edit["op"]
    if op == "record":
        _new_record(folder, texts, str(edit["kind"]), str(edit["view"]), list(map(str, edit["names"])))
        return
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
    elif op == "note":
        said = {key: _one_line(key, edit[key]) for key in ("who", "text")}
        text = with_note(text, name, Note(on=datetime.now().astimezone().date(), **said))
    elif op == "kind":
        text = _of_kind(texts, name, str(edit["to"]))
    else:
        raise KeyError(op)
    texts[FILE_NAME] = text
    if op == "kind" and GAP in str(_at(text, (edits.EXPERIMENTS, name, "camera"))):  # no record of this view yet
        _new_record(folder, texts, "camera", "", [name])


def _of_kind(texts: Mapping[str, str], name: str, to: str) -> str:
    """Write an experiment as one of another kind: its recordings and all values that both kinds have are kept."""
    ((template,), _), old = template_of([to]), tree_of(texts[FILE_NAME])[edits.EXPERIMENTS][name]
    lines = "\n".join(line for line in template.splitlines() if not line.startswith("# "))
    had = {place: value for place, _, value, _ in edits.values(SETTINGS[old["kind"]], old, ()) if GAP not in str(value)}
    changes = []
    for place, of, before, _ in list(edits.values(SETTINGS[to], tree_of(lines)[edits.EXPERIMENTS][to], ())):
        key = place[-1]
        value = had.get(place)
        if value is None and before is not None:  # at the top in one kind, in a table of each drop in another
            value = next((v for at, v in had.items() if at[-1] == key and 1 in (len(at), len(place))), None)
        if key == "camera":  # of the view that the new kind is seen in
            view = _default(SETTINGS[to], "view")
            value = next((n for n, text in texts.items() if n != FILE_NAME and tree_of(text).get("view") == view), None)
        if value is None or key in ("kind", "view"):
            continue
        is_list = typing.get_origin(split(of)[0]) in (list, tuple)
        if is_list != isinstance(value, list):
            value = [value] if is_list else value[0]
        changes.append(((edits.EXPERIMENTS, to, *place), value))
    own = {f.encode_name for f in msgspec.structs.fields(SETTINGS[to])} - set(tree_of(lines)[edits.EXPERIMENTS][to])
    lists = ((key, value) for key, value in old.items() if key in own and isinstance(value, list))  # such as notes
    changes += [((edits.EXPERIMENTS, to, key), value) for key, value in lists]
    tables = edits.set_values(lines, changes)
    return edits.replaced(texts[FILE_NAME], name, tables if name == to else edits.rename(tables, to, name, SETTINGS))


def _default(kind: type[msgspec.Struct], key: str) -> Any:
    """Return the default of a field of a structure; None where there is no such field or default."""
    return next((f.default for f in msgspec.structs.fields(kind) if f.encode_name == key and not f.required), None)


def _new_record(folder: Path, texts: dict[str, str], kind: str, view: str, names: list[str]) -> None:
    """Add a calibration record that is to be filled in, and name it in experiments."""
    tree = tree_of(texts[FILE_NAME])[edits.EXPERIMENTS]
    recordings = [text for name in names for text in texts_in(tree[name])]
    taken = [name for name in recordings if name.rpartition(".")[2] != "toml" and safe_join(folder, name).exists()]
    for name in names:
        view = view or str(tree[name].get("view") or _default(SETTINGS[tree[name]["kind"]], "view"))
    made, text = blank_record(folder, kind, view, taken, texts)
    texts[made] = text
    key = {"camera": "camera", "load_cell": "record"}.get(kind, "calibration")
    texts[FILE_NAME] = edits.set_values(texts[FILE_NAME], [((edits.EXPERIMENTS, name, key), made) for name in names])


def _at(text: str, place: edits.Place) -> Any:
    node: Any = tree_of(text)
    try:
        for key in place:
            node = node[key]
    except (KeyError, IndexError, TypeError):
        return None
    return node


def _type_at(text: str, name: str, place: edits.Place) -> tuple[Any, bool]:
    """Return the type of a field, and whether it must be there."""
    tree = tree_of(text)
    if name == FILE_NAME:
        if place[:1] == ("session",) and place[1:] in (("title",), ("operator",), ("notes",)):
            return str, False
        kind = SETTINGS.get(str(tree["experiments"][place[1]].get("kind"))) if place[0] == edits.EXPERIMENTS else None
        node: Any = tree["experiments"][place[1]] if kind is not None else {}
        prefix: edits.Place = place[:2]
    else:
        kind, node, prefix = RECORDS.get(str(tree.get("kind"))), tree, ()
    for at, of, _, is_required in () if kind is None else edits.values(kind, node, prefix):
        if at == place:
            return of, is_required
    raise InputError(f"{'.'.join(map(str, place))}: there is no such setting")


# --- what the page shows -------------------------------------------------------------------------


def state(folder: Path, texts: Mapping[str, str]) -> Told:
    """Return the set-up as texts give it: experiments, records, with their errors and missing values."""
    problems, waiting = _problems(folder, texts)
    tree = tree_of(texts[FILE_NAME])
    records = {name: tree_of(text) for name, text in texts.items() if name != FILE_NAME}
    tables = tree.get(edits.EXPERIMENTS, {})
    tables = tables if isinstance(tables, dict) else {}
    experiments, remarks = [], edits.remarks(texts[FILE_NAME])
    for name, table in tables.items():
        kind = KINDS.get(str(table.get("kind"))) if isinstance(table, dict) else None
        place: edits.Place = (edits.EXPERIMENTS, name)
        told: Told = {"name": name, "kind": "", "title": "no known kind", "why": "", "kinds": [], "fields": []}
        if kind is not None:
            fields = list(_fields(folder, kind.settings, table, place, FILE_NAME, remarks))
            for field in fields:
                field["suggestions"] += _suggestions(folder, name, kind, field, tables, records)
                field["record"] = _record_of(kind, field["place"])
            told["view"] = str(table.get("view") or _default(kind.settings, "view") or "")
            told |= {"kind": kind.name, "title": kind.title, "why": remarks.get((*place, "kind"), ""), "fields": fields}
            told["takes_notes"] = any(f.encode_name == "notes" for f in msgspec.structs.fields(kind.settings))
            own = set(kind.proposal.contents) if kind.proposal else set()
            able = [k for k in KINDS.values() if k is kind or (k.proposal and own & set(k.proposal.contents))]
            told["kinds"] = [[each.name, each.title] for each in able]
        # something is wrong or missing in it, or in a record that it names
        at, named = dotted(place), [table.get(key) for key in _RECORD_FIELDS] if isinstance(table, dict) else []
        own_problems = (p for p in problems if re.match(rf"{re.escape(at)}($|[.[])", p["place"]) or p["file"] in named)
        waits = name in waiting or any(own_problems)
        experiments.append(told | {"waits": waits})
    shown: list[Told] = []
    for name, record in records.items():
        kind_of = RECORDS.get(str(record.get("kind")))
        if kind_of is not None:
            fields = list(_fields(folder, kind_of, record, (), name, edits.remarks(texts[name])))
            users = [
                one["name"] for one in experiments if any(f["text"] == name and not f["files"] for f in one["fields"])
            ]
            told = {"name": name, "kind": record["kind"], "view": record.get("view", "")}
            shown.append(told | {"fields": fields, "used_by": users})
    session = tree.get("session")
    person = session.get("operator") if isinstance(session, dict) else ""
    with contextlib.suppress(KeyError, OSError):
        person = person or getpass.getuser()
    return {"experiments": experiments, "records": shown, "problems": problems, "person": person}


def _fields(
    folder: Path, kind: Any, table: Any, prefix: edits.Place, file: str, remarks: Mapping[edits.Place, str]
) -> Iterator[Told]:
    for place, of, value, is_required in edits.values(kind, table, prefix):
        path = place[len(prefix) :]
        words = (str(k + 1) if isinstance(k, int) else _SYMBOLS.get(k, k.replace("_", " ")) for k in path)
        if path in (("kind",), ("version",)):
            continue
        bare = split(of)[0]
        choices: list[str] = []
        if typing.get_origin(bare) is Literal:
            choices = [str(a).lower() if isinstance(a, bool) else str(a) for a in typing.get_args(bare)]
        # texts need no quotation marks here
        expected = describe(of).replace("text in quotation marks", "a text").replace(" (without quotation marks)", "")
        options = [typing.get_args(o) for o in typing.get_args(bare) if typing.get_origin(o) is Literal]
        text = "" if value is None or is_gap(value) else str(value)
        if text and isinstance(value, bool | list | dict):
            text = edits.inline(value) if isinstance(value, dict) else files.canonical(value)
        is_list = typing.get_origin(bare) is list
        is_files = is_list and mark(typing.get_args(bare)[0], FileMark) is not None
        yield {
            "file": file,
            "place": list(place),
            "dotted": counted(dotted(place)),
            "label": " ".join(word for word in words if word != "values"),
            "text": text,
            "files": value if is_files and isinstance(value, list) else None,
            "expected": f"one of {', '.join(library_names())}" if path[-1] == "material" else expected,
            "remark": remarks.get(place, ""),
            "required": is_required,
            "gap": is_gap(value),
            "choices": choices,
            "suggestions": [str(word) for words in options for word in words],  # where a word or a table is taken
            "record": "",
        }


def _record_of(kind: Kind, place: Sequence[str | int]) -> str:
    """Return the kind of calibration record that a field of an experiment names; "" of other fields."""
    if len(place) != 3 or place[-1] not in _RECORD_FIELDS:
        return ""
    content = kind.proposal.contents[0] if kind.proposal else ""
    return {"displacement": "laser", "film": "camera"}.get(content, "load_cell")


def _suggestions(
    folder: Path, name: str, kind: Kind, field: Told, tables: Mapping[str, Any], records: Mapping[str, Any]
) -> list[str]:
    """Return what fits a field: materials, records of its instrument, or experiments that have the result it needs."""
    key = field["place"][-1]
    if key == "material":
        return list(library_names())
    if key == "columns":  # of recordings that no instrument recognises, as far as their headings tell
        proposed = []
        for text in dict.fromkeys(texts_in(tables[name])):
            with contextlib.suppress(InputError, OSError):  # not the name of a file
                path = safe_join(folder, text)
                status = path.stat()
                if path.is_file() and path.suffix != ".toml":
                    proposed.append(_proposed_columns(path, status.st_size, status.st_mtime_ns))
        return list(dict.fromkeys(filter(None, proposed)))
    if sort := _record_of(kind, field["place"]):
        return [record for record, tree in records.items() if tree.get("kind") == sort]
    inputs = [text.split("/") for stage in kind.stages for text in stage.inputs if text.startswith(OTHER)]
    stages = {name for at, name in inputs if at.rpartition(".")[2].removeprefix(OTHER) == key} - {JUDGEMENT}
    able = [k.name for k in KINDS.values() if stages & {stage.name for stage in k.stages}]
    fits = [other for other, table in tables.items() if other != name and table.get("kind") in able]
    polymer = material_word(name)
    own = [other for other in fits if polymer is not None and material_word(other) == polymer]
    return own or fits


@lru_cache(1024)  # the page asks after every change
def _proposed_columns(path: Path, size: int, modified: int) -> str:
    del size, modified
    return remedy(path).partition(COLUMNS)[2]


def _problems(folder: Path, texts: Mapping[str, str]) -> tuple[list[Told], Mapping[str, Any]]:
    """Check every text by the code that reads it; return errors, and the waiting experiments."""
    told: list[str] = []
    waiting: Mapping[str, Any] = {}
    try:
        session = load(folder / FILE_NAME, text=texts[FILE_NAME])
        waiting = session.waiting
        told += [line for lines in waiting.values() for line in lines]
    except ConfigError as error:
        told += error.problems
    except LabpipeError as error:
        told.append(f"{FILE_NAME}:1: {error}")
    new = [f'there is no file "{name}"' for name in texts if not (folder / name).exists()]  # it will be written too

    def counts(line: str) -> bool:
        return not any(missing in line for missing in new)

    waiting = {name: lines for name, lines in waiting.items() if any(map(counts, lines))}
    told = list(filter(counts, told))
    told = [line for line in told if line.startswith(f"{FILE_NAME}:")]  # records are told by themselves
    for name, text in texts.items():
        kind = RECORDS.get(str(tree_of(text).get("kind"))) if name != FILE_NAME else None
        try:
            if kind is not None:
                document = parse(folder / name, text)
                config.Checker(document, document.path.parent, may_fill=True).value(kind, document.tree, ())
                document.finish()
        except ConfigError as error:
            told += [f"{name}:{line.partition(':')[2]}" for line in error.problems]
        except LabpipeError as error:
            told.append(f"{name}:1: {error}")
    problems: dict[tuple[str, ...], Told] = {}
    for line in told:
        match = _PROBLEM.match(line)
        file, number, place, message = match.groups() if match is not None else (FILE_NAME, "1", "", line)
        if place and message.startswith("columns"):  # refused with the table around them
            place += ".columns"
        told_before = (file, place) if place else (file, "", message)
        problems.setdefault(told_before, {"file": file, "line": int(number), "place": place or "", "message": message})
    return list(problems.values()), waiting

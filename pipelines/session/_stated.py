"""Values of experiments from the laboratory's workbook: masses, heights and others, mapped by ``stated`` in [session].

``stated = { file = "masses.xlsx", row = "specimen", columns = { mass = "m / g", height = "h / mm" } }`` takes from the
row of each experiment (its name in the column "specimen") the values that session.toml leaves out or marks FILL.
``sheet`` names one of several sheets, ``rows = { acrylic_7mm = "A3" }`` experiments that the workbook calls otherwise;
a column ``u_mass`` holds standard uncertainties, and so does a cell such as 505.2 ± 0.5.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import msgspec

from labpipe.errors import InputError, LabpipeError
from labpipe.units import quantity
from labpipe.workflow.config import Checker
from labpipe.workflow.document import Document, Place
from labpipe.workflow.fields import File, fields_of, is_gap, suggest
from pipelines.experiments import KINDS

_PLACE: Place = ("session", "stated")


class Stated(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The table ``stated``: the file, the heading of the column of names, and headings by setting."""

    file: File
    row: str
    columns: dict[str, str]
    sheet: str = ""
    rows: dict[str, str] = {}


def fill(document: Document, root: Path) -> None:
    """Put the values of a workbook into the tables of the experiments, each with a note that says where it is from.

    Mistakes are reported at the line of ``stated``, with file, sheet, row and remedy.
    """
    head, tables = document.tree.get("session"), document.tree.get("experiments")
    if not isinstance(head, dict) or not isinstance(tables, dict) or (given := head.pop("stated", None)) is None:
        return
    folder = (root / str(head.get("files", ""))).resolve()
    if not isinstance(stated := Checker(document, folder).value(Stated, given, _PLACE), Stated):
        return
    try:
        where, rows = _rows(folder / stated.file, stated)
    except LabpipeError as error:
        document.report(_PLACE, str(error))
        return
    for name in stated.rows.keys() - tables.keys():
        document.report((*_PLACE, "rows", name), f'there is no experiment "{name}"{suggest(name, tables)}')
    day = datetime.datetime.fromtimestamp((folder / stated.file).stat().st_mtime, datetime.UTC).date()
    for name, own in tables.items():
        called = str(stated.rows.get(name, name))
        found = [one for one in rows if _folded(one[1][stated.row]) == _folded(called)]
        if len(found) > 1 or (name in stated.rows and not found):
            said = f"rows {', '.join(str(n) for n, _ in found)} are all" if found else "no row is"
            document.report(_PLACE, f'{where}: {said} "{called}" in column "{stated.row}"; name each once')
        elif found and isinstance(own, dict) and own.get("kind") in KINDS:
            place = f"{where}, row {found[0][0]}"
            taken = _taken(document, stated, name, place, found[0][1])
            if taken and isinstance(notes := own.setdefault("notes", []), list):
                notes.append({"on": day, "text": f"{', '.join(taken)}: from {place} ({called})"})


def _taken(document: Document, stated: Stated, name: str, where: str, cells: dict[str, str]) -> list[str]:
    """Put the cells of one row into the table of an experiment where it has no value; return them in words."""
    own, taken = document.tree["experiments"][name], list[str]()
    kind = KINDS[own["kind"]]
    for key, heading in stated.columns.items():
        is_own = "." in key or key in {info.encode_name for info in fields_of(kind.settings)}
        path = tuple(key.split(".")) if is_own else (kind.body, key)
        table: Any = own
        for part in path[:-1]:
            table = table.setdefault(part, {}) if isinstance(table, dict) else None
        is_wanted = isinstance(table, dict) and (path[-1] not in table or is_gap(table[path[-1]]))
        if key.startswith("u_") or not cells[heading] or not is_wanted:
            continue  # session.toml has the last word
        u = cells.get(stated.columns.get(f"u_{key}", ""), "")
        # the unit ends the heading: "m / g", "m in g", "m (g)", "m [g]"
        words = heading.replace("[", "/").replace("(", "/").replace(" in ", "/").rstrip(" ])").rpartition("/")
        text = f"{cells[heading]}{f' ± {u}' if u else ''} {words[2].strip() if words[1] else ''}".strip()
        try:
            quantity(text)
        except InputError as error:
            remedy = f'correct the cell in column "{heading}", or write {".".join(path)} in session.toml'
            document.report((*_PLACE, "columns", key), f"{where}: {error}; {remedy}")
            continue
        table[path[-1]] = text
        taken.append(f"{key.replace('_', ' ').replace('.', ' ')} {text}")
        for end in range(1, len(path) + 1):
            line = document.line((*_PLACE, "columns", key))
            document.lines.setdefault(("experiments", name, *path[:end]), line)
    return taken


def _rows(path: Path, stated: Stated) -> tuple[str, list[tuple[int, dict[str, str]]]]:
    """Return file and sheet in words, and of every row below the headings its number and its cells by heading."""
    import instruments

    wanted = (stated.row, *stated.columns.values())
    missing: list[str] = []
    book = [(title, rows) for title, rows in instruments.sheets(path) if stated.sheet in ("", title)]
    for title, rows in book:
        for number, row in enumerate(rows, 1):
            folded = [_folded(cell) for cell in row]
            lost = [heading for heading in wanted if _folded(heading) not in folded]
            if not lost:
                places = {heading: folded.index(_folded(heading)) for heading in wanted}
                below = enumerate(rows[number:], number + 1)
                found = [(n, {h: cells[i] if i < len(cells) else "" for h, i in places.items()}) for n, cells in below]
                return f"{stated.file}, sheet {title}", found
            missing = lost if stated.row not in lost else missing
    if not book:
        raise InputError(f'{stated.file} has no sheet "{stated.sheet}"; correct its name')
    names = " and ".join(f'"{heading}"' for heading in missing or wanted)
    raise InputError(f"{stated.file}, sheet {book[0][0]}: no row of headings has {names}; correct the headings here")


def _folded(text: str) -> str:
    return " ".join(text.replace("_", " ").replace("-", " ").casefold().split())

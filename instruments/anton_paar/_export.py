"""Anton Paar rheometer exports (RheoCompass CSV, TXT and XLSX; RheoPlus), read.

Columns, units, language and decimal sign are the user's choice in the software, so all of them come from the file:
the decimal sign by the evidence of its cells, quantities by their headings. Invalid points are NaN.
"""

import json
import os
import re
from pathlib import Path

import numpy as np
import xarray as xr

from instruments._instrument import HEAD_LINES
from instruments._intervals import Column, Interval, assemble
from instruments._layout import COMMA, SEMICOLON, TAB, Lines, cells, is_numeric, signs_of
from instruments._quantities import TEXT, TIMES, fold, quantity, repaired
from instruments._readings import converted, numbers, settled_units, short_rows
from instruments._sheets import Notes, open_sheets
from instruments.anton_paar._table import Export, Table
from labpipe.errors import SourceError
from labpipe.text import Separators, check_decimal, shorten

_INVALID = ("invalid", "invalide", "ungultig", "invalido")
_POINT = re.compile(r"\s*(\d{1,9})(?:\.0*)?\s*(?:\(\s*(.+?)\s*\))?\s*")


def read(
    path: str | os.PathLike[str],
    *,
    encoding: str | None = None,
    decimal: str | None = None,
    allow_incomplete: bool = False,
) -> xr.Dataset:
    """Read an export of RheoCompass or RheoPlus; SourceError names file, line and column of a fault.

    Warns of fewer points than declared, a joined file and repaired words.

    Parameters
    ----------
    path : path-like
        The file: text of any delimiter, or a workbook.
    encoding, decimal : str, optional
        By default decided from the file.
    allow_incomplete : bool
        Drop a last row that has no line end, with a warning; by default such a file is refused.

    Returns
    -------
    Dataset
        Over ``sample``, with the coordinates ``test``, ``result``, ``interval`` and ``point``.
        Variables in SI by their canonical names, where the file has them: ``time`` [s],
        ``temperature`` [degC], ``angular_frequency`` [rad/s] and ``frequency`` [Hz] (either from
        the other), ``storage_modulus``, ``loss_modulus``, ``stress``, ``relaxation_modulus``
        [Pa], ``loss_factor``, ``strain`` [1], ``torque`` [N m], ``normal_force`` [N], ``status``
        (text), … NaN where there is no reading; ``is_valid`` 0 where the instrument said so.
        Attributes: ``tests`` (JSON, one entry per interval: names, declared and found points), ``cut`` (JSON, line
        and note of tables that lack points), ``header``, ``project``, ``encoding``, ``decimal``, ``layout``, ``work``.
    """
    check_decimal(decimal)
    notes = Notes(Path(path))
    path, (sheets, codec, open_line) = notes.path, open_sheets(notes, encoding, allow_incomplete=allow_incomplete)
    export, how = Export(notes), {"encoding": codec}
    if [title for title, _ in sheets] == [""]:  # a text
        how["delimiter"] = _delimiter_of(path, sheets[0][1])
    for title, lines in sheets:
        export.read(title, lines, how.get("delimiter", TAB))
    if export.dangling:
        notes.add("the file ends after a label, before its table: it is cut", export.dangling)
    if not any(table.rows for table in export.tables):
        hint = "Export the table of the measurement from RheoCompass as CSV or XLSX."
        raise SourceError(path, "found no table with rows of data", hint=hint)
    if open_line:  # the last point may be whole: it ends with a status seen above
        last = export.tables[-1]
        *ends, end = ["".join(row[-1:]) for _, row in last.rows] or [""]
        is_last = last.rows[-1:] and last.rows[-1][0] == open_line and last.declared == len(last.rows)
        if not (is_last and quantity(last.headings[-1].text) == "status" and end and end in ends):
            text, hint = "the last line is cut, it has no line end", "Export the file again, or drop this line with "
            raise SourceError(path, text, line=open_line, hint=hint + "allow_incomplete=True.")
        notes.add("the last line has no line end; its table is complete, but further ones may be lost")
    signs = signs_of(path, export.tables, decimal)
    intervals = [_interval(table, signs, notes) for table in export.tables if table.unit_line and table.rows]
    counts = {"rows_read": sum(len(t.rows) for t in export.tables), "intervals_read": len(export.tables)}
    how |= {"project": "".join(export.header[:1]).partition("\t")[2], "header": "\n".join(export.header)}
    how |= {"decimal": signs.decimal, "cut": json.dumps(export.cut, ensure_ascii=False)}
    how["clock"] = "relative to the test; it may run on over intervals or begin anew"
    how["work"] = json.dumps({"bytes_read": path.stat().st_size, **counts})
    return assemble(intervals, path, **how)


def _delimiter_of(path: Path, lines: Lines) -> str:
    """Return TAB, semicolon or comma, as the line that begins a table shows it; SourceError where none does."""
    head = [line for _, line in lines[:HEAD_LINES]]
    if head and head[0].startswith("<"):
        text = "this XML file holds the layout of a table window, not a measurement"
        hint = "In RheoCompass, export the table itself as CSV or XLSX."
        raise SourceError(path, text, line=1, hint=hint)
    for delimiter in (TAB, SEMICOLON, COMMA):
        begins = re.compile(rf'"?[^{delimiter}]+:"?{delimiter}+"?[0-9]+"?(?:{delimiter}+"?[0-9]+"?)?{delimiter}*\s*')
        if any(begins.fullmatch(line) or quantity("".join(cells(line, delimiter)[:1])) == "point" for line in head):
            return delimiter
    if any(TAB in line for line in head):
        return TAB
    text = f"no line such as 'Interval and data points: 1 11' in the first {HEAD_LINES} lines"
    raise SourceError(path, text, line=1, hint="Is this an Anton Paar export? If so, export it again as CSV.")


def _interval(table: Table, signs: Separators, notes: Notes) -> Interval:
    """Turn one table into numbers and texts."""
    texts: dict[int, Column] = {}
    for k, heading in enumerate(table.headings):
        words = [row[k] if k < len(row) else "" for _, row in table.rows]
        if not heading.text and (heading.unit or any(words)):
            text, hint = f"column {k + 1} has no name", "Its name was deleted; export the file again."
            raise SourceError(table.place(notes.path), text, line=table.line, hint=hint)
        is_word = not heading.is_known and not heading.unit.strip("[] ") and not quantity(heading.text)
        if heading.name in TEXT or (is_word and heading.text and any(c and not is_numeric(c) for c in words)):
            texts[k] = Column(heading.name, heading.text, heading.unit, "", list(map(repaired, words)))
    wanted = settled_units(notes, table)
    count = len(table.rows)
    point, valid, before = np.zeros(count, dtype=np.int64), np.ones(count, dtype=bool), 0
    place = next((k for k, heading in enumerate(table.headings) if heading.name == "point"), None)
    point = np.arange(1, count + 1) if place is None else point
    for i, (line, row) in enumerate(table.rows if place is not None else ()):
        if not (text := "".join(row[place:][:1])):
            continue  # raw waveforms have no number
        match = _POINT.fullmatch(repaired(text))
        is_number = match is not None and (match[2] is None or fold(match[2]) in _INVALID)
        if match is None or not is_number or int(match[1]) <= before:
            message = f"found {shorten(text)}, expected {f'a number above {before}' if is_number else 'a point number'}"
            hint = "Rows are missing, repeated or moved; export the file again."
            raise SourceError(table.place(notes.path), message, line=line, hint=hint)
        point[i] = before = int(match[1])
        valid[i] = match[2] is None
    short = short_rows(notes, table, wanted)
    values = numbers(notes, table, signs, wanted)
    named = [k for k, h in enumerate(table.headings) if h.text and h.name != "point" and k not in texts]
    pairs = [(table.headings[k], values[:, k]) for k in named]
    for heading, column in pairs:
        column[short if heading.name in TIMES else short | ~valid] = np.nan
    columns = (*converted(notes, table, pairs, wanted).values(), *texts.values())
    name = (table.test, table.result, table.number, table.declared)
    return Interval(*name, point, valid & ~short, columns, table.sheet)

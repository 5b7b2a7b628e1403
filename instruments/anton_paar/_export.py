"""Anton Paar rheometer exports (RheoCompass CSV, TXT and XLSX; RheoPlus), read.

Columns, units, language and decimal sign are the user's choice in the software, so all of them come from the file:
the decimal sign by the evidence of its cells, quantities by their headings. Invalid points are NaN.
"""

import csv
import json
import os
import re
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from instruments._intervals import Column, Interval, assemble, in_one_unit
from instruments._quantities import TEXT, TIMES, fold, quantity, repaired, signs_of
from instruments._workbook import is_workbook, sheets
from instruments.anton_paar._table import Export, Parser, Table
from instruments.tables import Notes, converted, is_numeric, numbers, settled_units, short_rows
from labpipe.arrays import Flags, Integers
from labpipe.errors import SourceError
from labpipe.text import Limits, Separators, TextFile, check_decimal, first_bytes, shorten, survey

# Real exports have below 1 MB; the lines are kept while the decimal sign is being decided.
_LIMITS = Limits(max_bytes=128 << 20)
_CODECS = ("cp1252", "cp932")
_LOOKED_AT = 200  # lines in which the delimiter must show
_INVALID = ("invalid", "invalide", "ungultig", "invalido")
_POINT = re.compile(r"\s*(\d{1,9})(?:\.0*)?\s*(?:\(\s*(.+?)\s*\))?\s*")


def read(
    path: str | os.PathLike[str],
    *,
    encoding: str | None = None,
    decimal: str | None = None,
    allow_incomplete: bool = False,
) -> xr.Dataset:
    """Read an export of RheoCompass or RheoPlus.

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
        Attributes: ``tests`` (JSON, one entry per interval: names, declared and found points,
        columns), ``cut`` (JSON, line and note of tables that lack points), ``header``, ``project``,
        ``encoding``, ``decimal``, ``layout``, ``work``.

    Raises
    ------
    SourceError
        With file, line and column of the fault.

    Warns
    -----
    UserWarning
        Fewer points than declared, a joined file, repaired words.

    Examples
    --------
    >>> readings = read("sweep.csv")  # doctest: +SKIP
    >>> readings.storage_modulus.where(readings.interval == 2)  # doctest: +SKIP
    """
    check_decimal(decimal)
    path = Path(path)
    notes = Notes(path)
    parser, how = Parser(notes), {"encoding": "xlsx"}
    if is_workbook(first_bytes(path)):
        for title, rows in sheets(path):
            for number, row in enumerate(rows, 1):
                parser.take(number, title, row)
        export = parser.finished()
    else:
        source = survey(path, declared=(encoding,) if encoding else _CODECS, limits=_LIMITS)
        if next(iter(source.lines()), "").lstrip("\ufeff ").startswith("<"):
            text = "this XML file holds the layout of a table window, not a measurement"
            hint = "In RheoCompass, export the table itself as CSV or XLSX."
            raise SourceError(path, text, line=1, hint=hint)
        how = {"encoding": source.encoding, "delimiter": _delimiter_of(source)}
        for number, line in enumerate(source.lines(), 1):
            if number == source.n_lines and not source.is_ended and allow_incomplete:
                notes.add("the last line is cut, it has no line end; it is dropped", number)
                break
            parser.take(number, "", _cells(line, how["delimiter"]))
        export = parser.finished()
        if not source.is_ended and not allow_incomplete:
            _check_last(source, export, notes)
    evidence = [
        cell
        for table in export.tables
        for _, row in table.block.rows
        for heading, cell in zip(table.block.headings, row, strict=False)
        if heading.unit
    ]
    signs = signs_of(path, evidence, decimal)
    made = [_interval(table, signs, notes) for table in export.tables if table.block.unit_line]
    intervals, several = in_one_unit([interval for interval, _ in made])
    for note in several:
        notes.add(note)
    counts = {"rows_read": sum(len(t.block.rows) for t in export.tables), "intervals_read": len(export.tables)}
    attrs: dict[str, Any] = {
        "source": path.name,
        "project": "".join(export.header[:1]).partition("\t")[2],
        "header": "\n".join(export.header),
        "decimal": signs.decimal,
        **how,
        "empty_cells": sum(empty for _, empty in made),
        "invalid_points": sum(int((~interval.is_valid).sum()) for interval in intervals),
        "cut": json.dumps(export.cut, ensure_ascii=False),
        "clock": "relative to the test; it may run on over intervals or begin anew",
        "work": json.dumps({"bytes_read": path.stat().st_size, **counts}),
    }
    return assemble(intervals, **attrs)


def _delimiter_of(source: TextFile) -> str:
    """Return TAB, semicolon or comma, as the line that begins a table shows it.

    Raises
    ------
    SourceError
        None of them separates a label from its numbers, or the names of the columns.
    """
    head = list(islice(source.lines(), _LOOKED_AT))
    for delimiter in ("\t", ";", ","):
        sign = re.escape(delimiter)
        begins = re.compile(rf'"?[^{sign}]+:"?{sign}+"?[0-9]+"?(?:{sign}+"?[0-9]+"?)?{sign}*\s*')
        if any(begins.fullmatch(line) or quantity("".join(_cells(line, delimiter)[:1])) == "point" for line in head):
            return delimiter
    if any("\t" in line for line in head):
        return "\t"
    text = f"no line such as 'Interval and data points: 1 11' in the first {_LOOKED_AT} lines"
    raise SourceError(source.path, text, line=1, hint="Is this an Anton Paar export? If so, export it again as CSV.")


def _cells(line: str, delimiter: str) -> list[str]:
    """Split one line; quotes are those of an edited file."""
    if delimiter != "\t":
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [""])]
    cells = (cell.strip() for cell in line.split("\t"))
    return [c[1:-1].replace('""', '"') if len(c) > 1 and c[0] == c[-1] == '"' else c for c in cells]


def _check_last(source: TextFile, export: Export, notes: Notes) -> None:
    """Refuse a last line without line end, unless it is the last point and ends with a status seen above."""
    last = export.tables[-1]
    rows, headings = last.block.rows, last.block.headings
    if rows and rows[-1][0] == source.n_lines and last.declared == len(rows):
        *ends, end = ["".join(row[-1:]) for _, row in rows]
        if quantity(headings[-1].text) == "status" and end and end in ends:
            notes.add("the last line has no line end; its table is complete, but further ones may be lost")
            return
    hint = "Export the file again, or drop this line with allow_incomplete=True."
    raise SourceError(source.path, "the last line is cut, it has no line end", line=source.n_lines, hint=hint)


def _interval(table: Table, signs: Separators, notes: Notes) -> tuple[Interval, int]:
    """Turn one table into numbers and texts; return it with the number of cells without a reading."""
    block, texts = table.block, dict[int, Column]()
    for k, heading in enumerate(block.headings):
        cells = [row[k] if k < len(row) else "" for _, row in block.rows]
        if not heading.text and (heading.unit or any(cells)):
            text, hint = f"column {k + 1} has no name", "Its name was deleted; export the file again."
            raise SourceError(block.place(notes.path), text, line=block.line, hint=hint)
        is_word = not heading.is_known and not heading.unit.strip("[] ") and not quantity(heading.text)
        if heading.name in TEXT or (is_word and heading.text and any(c and not is_numeric(c) for c in cells)):
            words = [repaired(cell) for cell in cells]
            texts[k] = Column(heading.name, heading.text, heading.unit, "", words, table.sub_labels[k])
    wanted = settled_units(notes, block)
    point, valid = _points(table, notes)
    short = short_rows(notes, block, wanted)
    values = numbers(notes, block, signs, wanted)
    pairs = [
        (heading, column)
        for k, (heading, column) in enumerate(zip(block.headings, values.T, strict=True))
        if heading.text and heading.name != "point" and k not in texts
    ]
    empty = sum(int(np.isnan(column).sum()) for _, column in pairs)
    for heading, column in pairs:
        column[short if heading.name in TIMES else short | ~valid] = np.nan
    found = converted(notes, block, pairs, wanted)
    places = {heading.name: k for k, heading in enumerate(block.headings)}
    columns = [replace(c, sub_label=table.sub_labels[places[n]]) if n in places else c for n, c in found.items()]
    every = sorted([*columns, *texts.values()], key=lambda c: places.get(c.name, len(places)))
    sheet = block.sheet
    return Interval(
        table.test, table.result, table.number, table.declared, point, valid & ~short, tuple(every), sheet=sheet
    ), empty


def _points(table: Table, notes: Notes) -> tuple[Integers, Flags]:
    """Return the numbers of the points, which go up, and which of them are valid; raw waveforms have no number."""
    names = [heading.name for heading in table.block.headings]
    count = len(table.block.rows)
    if "point" not in names:
        return np.arange(1, count + 1), np.ones(count, dtype=bool)
    point, valid, before = np.zeros(count, dtype=np.int64), np.ones(count, dtype=bool), 0
    for i, (line, row) in enumerate(table.block.rows):
        text = "".join(row[names.index("point") :][:1])
        if not text:
            continue
        match = _POINT.fullmatch(repaired(text))
        is_number = match is not None and (match[2] is None or fold(match[2]) in _INVALID)
        if match is None or not is_number or int(match[1]) <= before:
            message = f"found {shorten(text)}, expected {f'a number above {before}' if is_number else 'a point number'}"
            hint = "Rows are missing, repeated or moved; export the file again."
            raise SourceError(table.block.place(notes.path), message, line=line, hint=hint)
        point[i] = before = int(match[1])
        valid[i] = match[2] is None
    return point, valid

"""Anton Paar rheometer exports (RheoCompass CSV, TXT and XLSX; RheoPlus), read.

Columns, units, language and decimal sign are the user's choice in the software, so all of them come from the file:
the decimal sign by the evidence of its cells, quantities by their headings. Invalid points are NaN.
"""

import csv
import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from instruments._moduli import celsius, needed, with_moduli
from instruments._quantities import (
    FREQUENCIES,
    SI_OF,
    TEMPERATURES,
    TEXT,
    TIMES,
    quantity,
    repaired,
    signs_of,
    slug,
    unit_of,
)
from instruments._workbook import Cell, is_workbook, sheets, text_of
from instruments.anton_paar._dataset import Column, Interval, assemble, in_one_unit
from instruments.anton_paar._table import Export, RawInterval, Row, point_number, read_table
from labpipe.arrays import Flags, Floats, Integers
from labpipe.errors import InputError, SourceError, warn_of
from labpipe.text import (
    DOT,
    Limits,
    Separators,
    TextFile,
    check_decimal,
    first_bytes,
    listed,
    not_a_number,
    plain_number,
    shorten,
    survey,
)

# Real exports have below 1 MB; the lines are kept while the decimal sign is being decided.
_LIMITS = Limits(max_bytes=128 << 20)
_CODECS = ("cp1252", "cp932")
_LOOKED_AT = 200  # lines in which the delimiter must show
_ABSENT = ("", "-", "--", "---", "*")  # cells without a reading


@dataclass(slots=True)
class _Findings:
    """Notes and counts from the reading of the values."""

    notes: list[str] = field(default_factory=list)
    absent: int = 0
    invalid: int = 0
    is_contradicted: bool = False

    def note(self, text: str) -> None:
        """Keep a note once; further intervals say the same."""
        if text not in self.notes:
            self.notes.append(text)


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
        columns), ``header``, ``project``, ``encoding``, ``decimal``, ``layout``, ``work``.

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
    if is_workbook(first_bytes(path)):
        cells = (Row(number, row, title) for title, rows in sheets(path) for number, row in enumerate(rows, 1))
        export, how = read_table(path, cells), {"encoding": "xlsx"}
        if export.projects > 1:
            export.notes.append("more than one project in the workbook; exports were joined")
    else:
        source = survey(path, declared=(encoding,) if encoding else _CODECS, limits=_LIMITS)
        if next(iter(source.lines()), "").lstrip("\ufeff ").startswith("<"):
            text = "this XML file holds the layout of a table window, not a measurement"
            hint = "In RheoCompass, export the table itself as CSV or XLSX."
            raise SourceError(path, text, line=1, hint=hint)
        delimiter = _delimiter_of(source)
        export = read_table(path, _complete(source, delimiter, allow_incomplete))
        how = {"encoding": source.encoding, "delimiter": delimiter}
        if not source.is_ended and not allow_incomplete:
            _check_last(source, export)
    wanted = [(raw.rows, [k for k, unit in enumerate(raw.units) if unit]) for raw in export.intervals]
    evidence = [cell for rows, own in wanted for row in rows for k in own if isinstance(cell := row.cells[k], str)]
    signs = signs_of(path, evidence, decimal)
    findings = _Findings(notes=list(export.notes))
    intervals, notes = in_one_unit([_interval(raw, signs, path, findings) for raw in export.intervals if raw.units])
    findings.notes += notes
    counts = {"rows_read": sum(len(i.rows) for i in export.intervals), "intervals_read": len(export.intervals)}
    attrs: dict[str, Any] = {
        "source": path.name,
        "project": "".join(export.header[:1]).partition("\t")[2],
        "header": "\n".join(export.header),
        "decimal": signs.decimal,
        **how,
        "empty_cells": findings.absent,
        "invalid_points": findings.invalid,
        "notes": json.dumps(findings.notes, ensure_ascii=False),
        "cut": json.dumps(export.cut, ensure_ascii=False),
        "clock": "relative to the test; it may run on over intervals or begin anew",
        "work": json.dumps({"bytes_read": path.stat().st_size, **counts}),
    }
    dataset = assemble(intervals, **attrs)
    for note in findings.notes:
        warn_of(path, note)
    return dataset


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
        return next(csv.reader([line], delimiter=delimiter), [""])
    quoted = (len(cell) > 1 and cell[0] == cell[-1] == '"' for cell in line.split("\t"))
    return [c[1:-1].replace('""', '"') if q else c for c, q in zip(line.split("\t"), quoted, strict=True)]


def _complete(source: TextFile, delimiter: str, allow: bool) -> Iterator[Row]:
    """Split the lines into cells; leave out a last line that is not ended, when that is allowed."""
    for number, line in enumerate(source.lines(), 1):
        if number == source.n_lines and not source.is_ended and allow:
            warn_of(source.path, "the last line is cut, it has no line end; it is dropped", line=number)
            return
        yield Row(number, list(_cells(line, delimiter)))


def _check_last(source: TextFile, export: Export) -> None:
    """Refuse a last line without line end, unless it is the last point and ends with a status seen above."""
    last = export.intervals[-1]
    if last.rows and last.rows[-1].line == source.n_lines and last.declared == len(last.rows):
        ends = [text_of(row.cells[-1]) for row in last.rows]
        if quantity(last.headers[-1]) == "status" and ends[-1] and ends[-1] in ends[:-1]:
            export.notes.append("the last line has no line end; its table is complete, but further ones may be lost")
            return
    hint = "Export the file again, or drop this line with allow_incomplete=True."
    raise SourceError(source.path, "the last line is cut, it has no line end", line=source.n_lines, hint=hint)


def _interval(raw: RawInterval, signs: Separators, path: Path, findings: _Findings) -> Interval:
    """Turn one table into numbers.

    A column that no sweep and no response is made of is left out, with a note, where its unit is none of its
    quantity; a cell of it that is no number is no reading. A needed column is refused for either.
    """
    names = _names(raw, path, findings)
    wanted = needed({name for header in raw.headers if (name := quantity(header))})
    point, valid = _points(raw, next((k for k, name in names.items() if name == "point"), None), path)
    findings.invalid += int((~valid).sum())
    columns = []
    for index, name in names.items():
        header, unit = raw.headers[index], raw.units[index]
        sub = raw.sub_labels[index] if index < len(raw.sub_labels) else ""
        is_needed = name in wanted and name == quantity(header)
        cells = [row.cells[index] for row in raw.rows]
        if name == "point":
            continue
        is_unknown = not unit.strip("[] ") and not quantity(header)
        if name in TEXT or (is_unknown and any(_number(c, (signs,)) is None for c in cells)):
            columns.append(Column(name, header, unit, "", [repaired(text_of(cell)) for cell in cells], sub))
            continue
        found = _unit(raw, header, unit, is_needed, path, findings)
        if found is None:
            continue
        values, si = _numbers(raw, index, is_needed, signs, path, findings) * found[0], found[1]
        if name in TEMPERATURES:
            values = celsius(values, si, path=path, line=raw.line + 1, header=header, stated=unit)
            si = "degC"
        if name not in TIMES:
            values[~valid] = np.nan
        of_si = "angular_frequency" if si == "rad/s" else "frequency"  # the unit decides, whatever the heading says
        columns.append(Column(of_si if name in FREQUENCIES else name, header, unit, si, values, sub))
    made, contradictions = with_moduli({column.name: column for column in columns if column.si})
    if not findings.is_contradicted:  # further intervals would say the same
        findings.notes += [f"line {raw.line}: {said}" for said in contradictions]
    findings.is_contradicted |= bool(contradictions)
    columns += [made[name] for name in sorted(made.keys() - {column.name for column in columns})]
    return Interval(raw.test, raw.result, raw.number, raw.declared, point, valid, tuple(columns), sheet=raw.sheet)


def _names(raw: RawInterval, path: Path, findings: _Findings) -> dict[int, str]:
    """Name the columns by their places; of those with one heading the further ones by their sub-label or a number."""
    names: dict[int, str] = {}
    for index, header in enumerate(raw.headers):
        if not header:
            if raw.units[index] or any(text_of(r.cells[index]) for r in raw.rows):
                text, hint = f"column {index + 1} has no name", "Its name was deleted; export the file again."
                raise SourceError(path, text, line=raw.line + 1, hint=hint)
            continue
        first = quantity(header) or slug(header)
        if header.endswith(","):
            findings.note(f'"{header}" is taken as the column {first}: a dot was replaced by a comma')
        sub = raw.sub_labels[index] if index < len(raw.sub_labels) else ""
        others = [name for name in (f"{first}_{slug(sub)}" if sub else "", slug(header)) if name]
        numbered = [f"{others[-1]}_{serial}" for serial in range(2, len(raw.headers) + 2)]
        names[index] = next(one for one in (first, *others, *numbered) if one not in names.values())
    return names


def _points(raw: RawInterval, index: int | None, path: Path) -> tuple[Integers, Flags]:
    """Return the numbers of the points, which go up, and which of them are valid."""
    valid = np.array([not row.is_short for row in raw.rows], dtype=bool)
    if index is None:
        return np.arange(1, valid.size + 1), valid
    point = np.zeros(valid.size, dtype=np.int64)
    before = 0
    for i, row in enumerate(raw.rows):
        text = text_of(row.cells[index])
        if not text:
            continue  # raw waveforms have no number
        found = point_number(repaired(text))
        if found is None or found[0] <= before:
            expected = f"a number above {before}" if found else "a point number"
            message = f"found {shorten(text)}, expected {expected}"
            hint = "Rows are missing, repeated or moved; export the file again."
            raise SourceError(path, message, line=row.line, hint=hint)
        point[i] = before = found[0]
        valid[i] &= found[1]
    return point, valid


def _unit(
    raw: RawInterval, header: str, unit: str, is_needed: bool, path: Path, findings: _Findings
) -> tuple[float, str] | None:
    """Return factor and SI unit of a column; None of one that is left out."""
    name = quantity(header)
    known = SI_OF.get(name or "")
    try:
        found = unit_of(unit)
    except InputError:
        found = None
        if known is None:
            return 1.0, unit.strip("[] ")  # an unknown quantity keeps its own unit
    if found is not None and (known is None or found.si in known):
        # The radian is often left out; "angular" in the heading says it.
        is_angular = found.si == "1/s" and name == "angular_frequency"
        return found.factor, "rad/s" if is_angular else found.si
    spelled = " or ".join(si for si in known or () if si != "degF")
    text = f'{header} is in "{unit}", expected a unit of {spelled}'
    if not is_needed:
        findings.note(f"line {raw.line + 1}: {text}; the column is left out, nothing is made of it")
        return None
    raise SourceError(path, text, line=raw.line + 1, hint="Correct the row of units, or export again.")


def _numbers(
    raw: RawInterval, index: int, is_needed: bool, signs: Separators, path: Path, findings: _Findings
) -> Floats:
    values, strange = np.full(len(raw.rows), np.nan), []
    for i, row in enumerate(raw.rows):
        # A workbook may hold numbers as text, with a dot whatever the country.
        value = _number(row.cells[index], (DOT, signs) if row.sheet else (signs,))
        if value is None and is_needed:
            column = sum(len(text_of(c)) + 1 for c in row.cells[:index]) + raw.first + 1
            raise not_a_number(text_of(row.cells[index]), path=path, line_number=row.line, column=column)
        if value is None:
            strange.append(row.line)
        values[i] = np.nan if value is None else value
    findings.absent += int(np.isnan(values).sum())
    if strange:
        findings.note(f"{listed(strange)}: {raw.headers[index]} holds cells that are no numbers; they are no readings")
    return values


def _number(cell: Cell, signs: Sequence[Separators]) -> float | None:
    """Return a number, NaN for an absent one, None for anything else."""
    if isinstance(cell, float):
        return cell
    text = (cell or "").strip()
    if text in _ABSENT:
        return float("nan")
    return next((v for s in signs if (v := plain_number(text, s)) is not None), None)

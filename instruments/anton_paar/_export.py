"""Anton Paar rheometer exports (RheoCompass CSV, TXT and XLSX; RheoPlus), read and written.

Columns, units, language and decimal sign are the user's choice in the software, so all of them
come from the file. Layouts not seen in a real file are marked in the result's ``layout``.
"""

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import xarray as xr

from instruments._quantities import quantity
from instruments._workbook import is_workbook, text_of
from instruments.anton_paar._dataset import assemble, in_one_unit
from instruments.anton_paar._sources import delimiter_of, text_rows, workbook_rows
from instruments.anton_paar._table import Export, RawInterval, Row, read_table
from instruments.anton_paar._values import Findings, interpret, signs_of
from labpipe.errors import SourceError, warn_of
from labpipe.text import Limits, TextFile, check_decimal, first_bytes, survey

# Real exports have below 1 MB; the lines are kept while the decimal sign is being decided.
_LIMITS = Limits(max_bytes=128 << 20)
_CODECS = ("cp1252", "cp932")


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
        export, how = read_table(path, workbook_rows(path)), {"encoding": "xlsx"}
        if export.projects > 1:
            export.notes.append("more than one project in the workbook; exports were joined")
    else:
        source = survey(path, declared=(encoding,) if encoding else _CODECS, limits=_LIMITS)
        _refuse_window_definition(source)
        sign = delimiter_of(source)
        rows = _complete(source, text_rows(source, sign), allow_incomplete)
        export, how = read_table(path, rows), {"encoding": source.encoding, "delimiter": sign}
        _check_last(source, export, allow_incomplete)
    return _dataset(path, export, how, decimal)


def _refuse_window_definition(source: TextFile) -> None:
    first = next(iter(source.lines()), "").lstrip("\N{ZERO WIDTH NO-BREAK SPACE} ")
    if first.startswith("<"):
        text = "this XML file holds the layout of a table window, not a measurement"
        raise SourceError(source.path, text, line=1, hint="In RheoCompass, export the table itself as CSV or XLSX.")


def _complete(source: TextFile, rows: Iterable[Row], allow: bool) -> Iterable[Row]:
    """Leave out a last line that is not ended, when that is allowed."""
    for row in rows:
        if row.line == source.n_lines and not source.is_ended and allow:
            warn_of(source.path, "the last line is cut, it has no line end; it is dropped", line=row.line)
            return
        yield row


def _check_last(source: TextFile, export: Export, allow: bool) -> None:
    """Refuse a last line without line end, unless it is the last point and all its cells show."""
    if source.is_ended or allow:
        return
    last = export.intervals[-1]
    if last.rows and last.rows[-1].line == source.n_lines and _is_whole(last):
        export.notes.append("the last line has no line end; its table is complete, but further ones may be lost")
        return
    hint = "Export the file again, or drop this line with allow_incomplete=True."
    raise SourceError(source.path, "the last line is cut, it has no line end", line=source.n_lines, hint=hint)


def _is_whole(interval: RawInterval) -> bool:
    """Recognise a whole last row: it ends with a status seen above. A number may have lost digits."""
    above = {text_of(row.cells[-1]) for row in interval.rows[:-1]} - {""}
    return (
        interval.declared == len(interval.rows)
        and quantity(interval.headers[-1]) == "status"
        and text_of(interval.rows[-1].cells[-1]) in above
    )


def _dataset(path: Path, export: Export, how: dict[str, str], decimal: str | None) -> xr.Dataset:
    signs = signs_of(export.intervals, decimal, path)
    findings = Findings(notes=list(export.notes))
    intervals, notes = in_one_unit([interpret(raw, signs, path, findings) for raw in export.intervals if raw.units])
    findings.notes += notes
    first = export.header[0] if export.header else ""
    attrs: dict[str, Any] = {
        "source": path.name,
        "project": first.partition("\t")[2],
        "header": "\n".join(export.header),
        "decimal": signs.decimal,
        **how,
        "empty_cells": findings.absent,
        "invalid_points": findings.invalid,
        "notes": json.dumps(findings.notes, ensure_ascii=False),
        "cut": json.dumps(export.cut, ensure_ascii=False),
        "clock": "relative to the test; it may run on over intervals or begin anew",
        "work": json.dumps(
            {
                "bytes_read": path.stat().st_size,
                "rows_read": sum(len(i.rows) for i in export.intervals),
                "intervals_read": len(export.intervals),
            }
        ),
    }
    dataset = assemble(intervals, **attrs)
    for note in findings.notes:
        warn_of(path, note)
    return dataset

"""Tables of sweeps, of responses over time and of shift factors, and tables whose columns the user names."""

import json
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from instruments._quantities import SHIFTS, signs_of
from instruments._workbook import is_workbook, sheets, text_of
from instruments.anton_paar import Interval, assemble, in_one_unit
from instruments.tables import _traces
from instruments.tables._headings import stated_in_title
from instruments.tables._layout import COMMA, TAB, Block, blocks, plain_lines
from instruments.tables._mapping import Chosen, Columns, chosen, line_to_copy, located, suggestion, time_step
from instruments.tables._readings import intervals, lacking
from labpipe.errors import SourceError, warn_of
from labpipe.text import DOT, Limits, Separators, check_decimal, first_bytes, survey
from labpipe.units import Measure

DEVICE = "plain table of a dynamic mechanical analysis"
CODECS = ("cp1252", "cp932")
_HEADER = 100  # lines in which a file states how it is written
_LIMITS = Limits(max_bytes=128 << 20)
_DECIMAL = re.compile(r"#DE[CZ]IMAL:\s*(\w+)")
_SIGNS = {"point": ".", "punkt": ".", "comma": ",", "komma": ","}

Lines = Sequence[tuple[int, str]]


class _Found(NamedTuple):
    """The lines of a file by sheet, its codec, and a last line without an end (0: none)."""

    sheets: Sequence[tuple[str, Lines]]
    encoding: str
    open_line: int = 0


def read(
    path: str | os.PathLike[str],
    *,
    columns: Columns | None = None,
    cycle: Measure | None = None,
    encoding: str | None = None,
    decimal: str | None = None,
    allow_incomplete: bool = False,
) -> xr.Dataset:
    """Read sweeps, responses over time or shift factors from a table, or the columns of any table that are named.

    Parameters
    ----------
    path : path-like
        Text with TAB, semicolon, comma or blanks between the columns, or a workbook (.xlsx, .xls, .ods).
    columns : mapping or str, optional
        Quantity to the heading of its column, ``{"time": "Time (s)", "displacement": "Position (m)"}``, to its
        number from 1, or to both with a unit, ``{"column": "Position", "unit": "m"}``; the same as text, as in
        session.toml. Or all columns in their order with their units, ``"f (Hz), E' (MPa), E'' (MPa), T (degC)"``.
        By default the quantities are recognised by their headings.
    cycle : str or float or Quantity, optional
        Time between the rows of a displacement without a column of times, ``"50 us"``; that of a LabVIEW
        header (``Delta_X``) needs not be given.
    encoding, decimal : str, optional
        By default decided from the file.
    allow_incomplete : bool
        Drop a last row that has no line end, with a warning; by default it is kept, with a
        warning, if it is whole, and the file is refused if cells are missing in it.

    Returns
    -------
    Dataset
        Over ``sample``, as :func:`instruments.anton_paar.read`: ``frequency`` [Hz],
        ``storage_modulus``, ``loss_modulus`` [Pa], ``temperature`` [degC] where the file gives
        it; ``interval`` counts the sets and tables. Of responses ``time`` [s] and
        ``relaxation_modulus`` [Pa] or ``creep_compliance`` [1/Pa]; of a table of shifts
        ``temperature`` and ``log10_aT`` (from ``a_T`` or its natural logarithm, if need be).
        Of a named displacement as :func:`instruments.keyence.read`, of position and force (compression
        positive) as :func:`instruments.mach1.read`.

    Raises
    ------
    SourceError
        With file, line and column of the fault.

    Warns
    -----
    UserWarning
        Columns, rows or tables that nothing is made of are left out; a last line has no end.

    Examples
    --------
    >>> sweeps = read("sweeps.csv")  # doctest: +SKIP
    >>> fall = read("run.csv", columns={"time": "Time (s)", "displacement": "Position (m)"})  # doctest: +SKIP
    """
    check_decimal(decimal)
    path = Path(path)
    named = None if columns is None else chosen(columns)
    if is_workbook(first_bytes(path)):
        found = _in_sheets(path)
    else:
        source = survey(path, declared=(encoding,) if encoding else CODECS, limits=_LIMITS)
        open_line = 0 if source.is_ended else source.n_lines
        found = _Found([("", plain_lines(source.lines()))], source.encoding, open_line)
    if found.open_line and allow_incomplete:
        title, lines = found.sheets[-1]
        if lines and lines[-1][0] == found.open_line:
            warn_of(path, "the last line is cut, it has no line end; it is dropped", line=found.open_line)
            found = _Found([*found.sheets[:-1], (title, lines[:-1])], found.encoding)
    if named is None:
        return _sweeps(path, found, _blocks(path, found), decimal)
    block, lines = _located(path, found, named)
    if not {each.name for each in named} & {"displacement", "force"}:
        return _sweeps(path, found, [block], decimal)
    if found.open_line == block.rows[-1][0]:
        message = "the last line has no line end; if the file was cut, its last number is wrong"
        warn_of(path, message, line=found.open_line)
    cells = [cell for _, row in block.rows for cell in row]
    signs = DOT if block.separator == COMMA else _signs(path, found, cells, decimal)
    made = _traces.trace(path, block, signs, cycle, time_step(lines, block.line))
    return made.assign_attrs(source=path.name, encoding=found.encoding, decimal=signs.decimal)


def _in_sheets(path: Path) -> _Found:
    """Return the sheets of a workbook as lines with TABs; a title that states a temperature is a line."""
    found = []
    for title, rows in sheets(path):
        lines = plain_lines(TAB.join(" ".join(text_of(cell).split()) for cell in row) for row in rows)
        if lines and stated_in_title(title):
            lines = [(1, title), *lines]
        found.append((title, lines))
    return _Found(found, path.suffix.lstrip(".").lower() if path.suffix else "xlsx")


def _blocks(path: Path, found: _Found) -> list[Block]:
    """Find the tables; sheets and lines without any, such as remarks, are passed over."""
    tables = [replace(block, sheet=title) for title, lines in found.sheets for block in blocks(lines)]
    whole = [block for block in tables if block.rows]
    if whole:
        return whole
    if tables:
        raise SourceError(
            _place(path, tables[0]),
            "found no row of numbers below the headings",
            line=tables[0].line,
            hint="Cells hold numbers alone; the units stand in the headings or in a row below them.",
        )
    hint = next((text for _, lines in found.sheets if (text := suggestion(lines))), "")
    hint = hint or """columns = "f (Hz), E' (MPa), E'' (MPa), T (degC)\""""
    raise SourceError(
        path,
        "no line names the columns: expected frequency, temperature, storage and loss modulus (or tan δ, phase), or "
        "temperature and log_aT",
        line=next((lines[0][0] for _, lines in found.sheets if lines), 1),
        hint=f"Name the columns in a first line, or say which they are: {hint}",
    )


def _place(path: Path, block: Block) -> Path:
    """Name the sheet of a table with its file, for messages."""
    return path.with_name(f"{path.name}, sheet {block.sheet}") if block.sheet else path


def _located(path: Path, found: _Found, named: tuple[Chosen, ...]) -> tuple[Block, Lines]:
    """Find the named columns in the first sheet that has them; return its lines too."""
    first: SourceError | None = None
    for _, lines in found.sheets:
        try:
            return located(path, lines, named), lines
        except SourceError as error:
            first = first if first is not None and (first.line or error.line is None) else error
    raise first or SourceError(path, "the file holds no line")


def _sweeps(path: Path, found: _Found, tables: Sequence[Block], decimal: str | None) -> xr.Dataset:
    """Convert the tables that can be used to one Dataset."""
    last = tables[-1]
    if found.open_line and last.rows and last.rows[-1][0] == found.open_line:
        if len(last.rows[-1][1]) < max(len(row) for _, row in last.rows):
            text = "the last line has no line end and fewer cells than the others; it is cut"
            hint = "Complete the line, or drop it with allow_incomplete=True."
            raise SourceError(path, text, line=found.open_line, hint=hint)
        message = "the last line has no line end; it is kept, as no cell is missing, but if the file was cut, its last "
        warn_of(path, message + "number is wrong", line=found.open_line)
    evidence = [
        cell
        for block in tables
        for _, row in block.rows
        for heading, cell in zip(block.headings, row, strict=False)
        if heading.is_known and heading.name != "point"
    ]
    signs = _signs(path, found, evidence, decimal)
    made: list[Interval] = []
    whole = _complete(path, tables)
    for block in whole:
        made += intervals(_place(path, block), block, signs, len(made) + 1)
    made, notes = in_one_unit(made)
    sizes = [interval.point.size for interval in made]
    is_cut = len(sizes) > 2 and len(set(sizes[:-1])) == 1 and sizes[-1] < sizes[0]
    if is_cut:
        notes.append(f"the last set holds {sizes[-1]} rows, all others {sizes[0]}; the file may be cut")
    for note in notes:
        warn_of(path, note)
    numbers = [np.asarray(column.values, dtype=float) for interval in made for column in interval.columns]
    dataset = assemble(
        made,
        source=path.name,
        encoding=found.encoding,
        header="",
        empty_cells=int(sum(np.isnan(values).sum() for values in numbers)),
        work=json.dumps({"bytes_read": path.stat().st_size, "rows_read": sum(sizes), "intervals_read": len(made)}),
        delimiter=whole[0].separator,
        decimal=signs.decimal,
    )
    dataset.attrs |= {"instrument": DEVICE, "layout": "plain table"} | ({"incomplete": 1} if is_cut else {})
    return dataset


def _signs(path: Path, found: _Found, cells: Sequence[str], decimal: str | None) -> Separators:
    """Decide the decimal sign, by the option, a header that states it (of Netzsch), or the cells."""
    stated = {word for _, lines in found.sheets for _, line in lines[:_HEADER] if (word := _DECIMAL.match(line))}
    return signs_of(path, cells, decimal or next((_SIGNS.get(word[1].casefold()) for word in stated), None))


def _complete(path: Path, tables: Sequence[Block]) -> list[Block]:
    """Return the tables that can be used; refuse a file that has none, naming the missing quantity."""
    whole = [block for block in tables if not lacking(block)]
    if not whole:
        block = tables[0]
        names = dict.fromkeys(
            h.name.replace("_", " ") for h in block.headings if h.is_known and h.name not in ("point", "set")
        )
        raise SourceError(
            _place(path, block),
            f"found {', '.join(names)}; no {lacking(block)}",
            line=block.line,
            hint="Export the table again with it; if a column is there under another name, name all that are needed: "
            + line_to_copy(block.headings),
        )
    sweeps = [block for block in whole if not block.names() & SHIFTS]
    if sweeps and len(sweeps) < len(whole):
        warn_of(path, "a table of shift factors among the readings is left out; give it as a file of its own")
        whole = sweeps
    for block in tables:
        if lacking(block):
            title = f' "{block.title or block.sheet}"' if block.title or block.sheet else ""
            warn_of(path, f"the table{title} is left out: it has no {lacking(block)}", line=block.line)
    return whole

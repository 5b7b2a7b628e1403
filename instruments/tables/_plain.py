"""Tables of a dynamic mechanical analysis, text or workbook: headings, units, numbers, once or many times.

This is how analysers, programs and supplements of papers hand sweeps on::

    f,E_stor,E_loss,T,Set
    Hz, MPa, MPa, C, -
    0.1,8097.175545,93.07449045,-49.9612,0

and shift factors, ``T,log_aT``, and responses over time, ``t (s), E(t) (MPa)``. Columns are found
by name (:mod:`instruments.tables._words`), wherever the table stands
(:mod:`instruments.tables._layout`), units by a row of their own or by the headings; nothing is
guessed. A column ``Set`` numbers the isotherms. Of E″ and tan δ, of |E*| and δ, of compliances and
of complex viscosities the moduli are made (:mod:`instruments._moduli`). The result has the
form of :func:`instruments.anton_paar.read`.
"""

import json
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from instruments._instrument import HEAD_BYTES
from instruments._moduli import missing, with_moduli
from instruments._symbols import FREQUENCIES, SHIFTS
from instruments.anton_paar import Column, Interval, assemble
from instruments.tables import CODECS, _layout, _words, workbook_hint
from instruments.tables._columns import (
    UNITLESS,
    Pair,
    example,
    name_the_temperature,
    of_their_unit,
    parted,
    without_clocks,
)
from instruments.tables._layout import ABSENT, Block, is_of_parameters
from instruments.tables._words import Heading
from labpipe.arrays import Floats
from labpipe.errors import InputError, SourceError
from labpipe.numbers import listed
from labpipe.text import Limits, Separators, TextFile, not_a_number, plain_number, separators, shorten, survey

DEVICE = "plain table of a dynamic mechanical analysis"

_HEADER = 100  # lines in which a file says how it is written
_LIMITS = Limits(max_bytes=128 << 20)
_ZERO_CELSIUS = 273.15
_NO_READING = 9.9e37  # by which instruments of the SCPI standard say that there is none, or that it overflowed
_VAGUE = ("modulus", "module", "modul", "modulo", "e", "g", "e_modulus", "youngs_modulus", "young_s_modulus", "e_modul")
_ALONE = "Cells hold numbers alone; the units stand in the headings or in a row below them."
_WITH_UNIT = re.compile(r"[+-]?\d[\d.,]*(?:[eE][+-]?\d+)?\s*(?:°\s?[CF]|[A-Za-z%][\w/°]*)")
_SPECIMEN = (
    "sample",
    "specimen",
    "material",
    "probe",
    "sample_name",
    "sample_id",
    "specimen_id",
    "echantillon",
    "name",
)
# What names a row of statistics below readings, in the languages of exports.
_STATISTICS = (
    "mean", "average", "avg", "median", "min", "max", "minimum", "maximum", "std", "stdev", "std.dev", "std dev",
    "standard deviation", "sd", "s.d", "cv", "rsd", "variance", "mittelwert", "standardabweichung", "moyenne",
    "écart-type", "ecart type", "media", "promedio", "desviación estándar",
)  # fmt: skip
_DECIMAL = re.compile(r"#DE[CZ]IMAL:\s*(\w+)")  # of Netzsch
_OWN = ("point", "test", "result", "interval", "is_valid", "sample")  # names of the Dataset itself


def read(
    path: str | os.PathLike[str],
    *,
    encoding: str | None = None,
    decimal: str | None = None,
    columns: str | None = None,
    allow_incomplete: bool = False,
) -> xr.Dataset:
    """Read sweeps, responses over time or shift factors from a table.

    Parameters
    ----------
    path : path-like
        Text with TAB, semicolon, comma or blanks between the columns, or a workbook (.xlsx).
    encoding, decimal : str, optional
        By default decided from the file.
    columns : str, optional
        The columns in order with their units, ``"f (Hz), E' (MPa), E'' (MPa), T (degC)"``, of a
        table that does not name them, or not so that it is understood.
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

    Raises
    ------
    SourceError
        With file, line and column of what is wrong.

    Examples
    --------
    >>> sweeps = read("sweeps.csv")  # doctest: +SKIP
    """
    if decimal not in (None, ".", ","):
        message = f'decimal must be "." or ",", found "{decimal}"'
        raise InputError(message)
    path = Path(path)
    named = None if columns is None else _named(columns)
    found = _in_sheets(path, named) if _is_workbook(path) else _in_text(path, encoding, allow_incomplete, named)
    signs = _signs(path, found.blocks, decimal or found.decimal)
    if found.open_line and not allow_incomplete:
        _check_last_row(path, found.open_line, found.blocks[-1])
    whole = _complete(path, [_Table(_place(path, block), block, signs) for block in found.blocks])
    return _assembled(path, found.encoding, whole, signs)


class _Found(NamedTuple):
    """The tables of a file, the decimal sign that it states, and a last line without an end (0: none)."""

    blocks: list[Block]
    encoding: str
    decimal: str | None = None
    open_line: int = 0


def _in_text(path: Path, encoding: str | None, allow_incomplete: bool, named: list[Heading] | None) -> _Found:
    """Find the tables of a text, in the first codec in which there are any."""
    first: SourceError | None = None
    for codec in (encoding,) if encoding else ("cp1252", *CODECS):
        try:
            source = survey(path, declared=(codec,), limits=_LIMITS)
            lines = _lines(source, allow_incomplete)
            blocks = _layout.blocks(lines, named)
        except SourceError as error:
            first = first or error
            continue
        if blocks:
            return _Found(blocks, source.encoding, _stated_decimal(lines), 0 if source.is_ended else source.n_lines)
        first = first or _without_headings(path, lines)
        if source.encoding != codec:  # it says itself what it is
            break
    raise first or SourceError(path, "no codec was given")


def _stated_decimal(lines: Sequence[tuple[int, str]]) -> str | None:
    """Return the decimal sign that a header states, None where it does not."""
    found = (_DECIMAL.match(line) for _, line in lines[:_HEADER])
    stated = next((match[1] for match in found if match is not None), "").casefold()
    return {"point": ".", "punkt": ".", "comma": ",", "komma": ","}.get(stated)


def _is_workbook(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
    except OSError as error:
        raise SourceError(path, f"cannot be opened: {error.strerror}") from None
    is_one = head.startswith(b"PK\x03\x04") and b"opendocument" not in head
    if not is_one and workbook_hint(head):
        raise SourceError(path, "this is no table of text and no .xlsx", hint=workbook_hint(head))
    return is_one


def _in_sheets(path: Path, named: list[Heading] | None) -> _Found:
    """Find the tables of a workbook; sheets without any, such as remarks, are left aside."""
    from instruments.tables._workbook import sheets

    found: list[Block] = []
    lines: list[tuple[int, str]] = []
    for title, of_sheet in sheets(path):
        blocks = _layout.blocks(of_sheet, named)
        found += [replace(block, sheet=title) for block in blocks if block.rows or named is None]
        lines += of_sheet
    if not found:
        raise _without_headings(path, lines)
    return _Found(found, "xlsx")


def _place(path: Path, block: Block) -> Path:
    """Name the sheet of a table beside its file, for messages."""
    return path.with_name(f"{path.name}, sheet {block.sheet}") if block.sheet else path


def _named(columns: str) -> list[Heading]:
    """Read the columns that a user names."""
    found = [_words.parsed(text) for text in columns.split(";" if ";" in columns else ",")]
    if not _words.is_table({heading.name for heading in found if heading.is_known}):
        message = (
            f'columns="{columns}" names {_spoken(found)}; expected frequency and two of storage modulus, loss modulus, '
            "tan δ and so on, for example \"f (Hz), E' (MPa), E'' (MPa), T (degC)\""
        )
        raise InputError(message)
    return found


def _lines(source: TextFile, allow_incomplete: bool) -> list[tuple[int, str]]:
    """Return the lines that are not empty with their numbers; without a cut one, if that is asked for."""
    found = [(number, line) for number, line in _layout.joined(source.lines()) if line.strip("\t;,| ")]
    if source.is_ended or not found or not allow_incomplete:
        return found
    warnings.warn(
        f"{source.path}:{source.n_lines}: the last line is cut, it has no line end; it is dropped", stacklevel=3
    )
    return found[:-1]


def _check_last_row(path: Path, line: int, block: Block) -> None:
    """Refuse a last line that lost cells; of a whole one, say that its number may be short."""
    if not block.rows or block.rows[-1][0] != line:
        return
    if len(block.rows[-1][1]) < max(map(len, (cells for _, cells in block.rows))):
        raise SourceError(
            path,
            "the last line has no line end and fewer cells than the others; it is cut",
            line=line,
            hint="Complete the line, or drop it with allow_incomplete=True.",
        )
    warnings.warn(
        f"{path}:{line}: the last line has no line end; it is kept, as no cell is missing, "
        "but if the file was cut, its last number is wrong",
        stacklevel=3,
    )


def _without_headings(path: Path, lines: Sequence[tuple[int, str]]) -> SourceError:
    """Say what was found in place of headings, and how to name the columns."""
    width = next((len(found) for _, line in lines[:200] if len(found := _layout.numbers_of(line)) > 2), 0)
    rows = f"; there are rows of {width} numbers" if width else ""
    example = ["f (Hz)", "E' (MPa)", "E'' (MPa)", "T (degC)"][: max(width, 3)] + ["-"] * max(width - 4, 0)
    return SourceError(
        path,
        "no line names the columns: expected frequency, temperature, storage and loss modulus (or tan δ, phase), or "
        f"temperature and log_aT{rows}",
        line=lines[0][0] if lines else 1,
        hint=f'Name the columns in a first line, or in order with their units: columns="{", ".join(example)}".',
    )


def _spoken(headings: Sequence[Heading]) -> str:
    """List the quantities of headings for a message."""
    names = dict.fromkeys(_words.SPOKEN[h.name] for h in headings if h.is_known and h.name in _words.SPOKEN)
    return ", ".join(names) or "no quantity that is known"


def _signs(path: Path, blocks: Sequence[Block], decimal: str | None) -> Separators:
    """Decide the decimal sign; between commas it can only be the dot, unless cells are quoted."""
    found = [
        _layout.plain(cell)
        for block in blocks
        for _, cells in block.rows
        for heading, cell in zip(block.headings, cells, strict=False)
        if heading.is_known
    ]
    if decimal is not None:
        other = "." if decimal == "," else ","
        grouped = any(other in cell and decimal in cell for cell in found)
        return Separators(decimal, other if grouped else "")
    if not any("," in cell for cell in found):
        return Separators(".", "")
    try:
        # A power of ten says nothing, but its mantissa does.
        return separators(re.split(r"[eEdD]", cell)[0] for cell in found)
    except InputError as error:
        raise SourceError(path, str(error)) from None


class _Table:
    """One table of the file, converted to SI.

    Attributes
    ----------
    block : Block
    columns : dict of str to Column
        With storage and loss modulus, where they can be made.
    is_whole : array of bool
        False of rows that lost cells.
    missing : str
        What is missing in it, in words; "" of a complete table.
    """

    def __init__(self, path: Path, block: Block, signs: Separators) -> None:
        self.block = block
        if not block.rows:
            raise SourceError(path, "found no row of numbers below the headings", line=block.line, hint=_ALONE)
        self.missing = missing(block.names())
        self.columns: dict[str, Column] = {}
        self.is_whole = np.ones(len(block.rows), dtype=bool)
        if self.missing:
            return
        block.headings = without_clocks(block, of_their_unit(block.headings))
        name_the_temperature(path, block)
        _leave_out_statistics(path, block)
        short = _short_rows(path, block)
        values = _values(path, block, signs)
        values[short] = np.nan
        _tell_of_specimens(path, block)
        _fill_merged(block, values)
        parts = list(parted(path, block, values))
        self.is_whole = np.tile(~short, len(parts))
        self.columns = _joined([_converted(path, block, part) for part in parts])
        self._leave_out_marks(path)

    def _leave_out_marks(self, path: Path) -> None:
        """Mark rows of frequency zero invalid, with which analysers mark the steps of a procedure."""
        for name in ("frequency", "angular_frequency"):
            if name in self.columns:
                is_none = np.asarray(self.columns[name].values) <= 0.0
                if is_none.any():
                    warnings.warn(
                        f"{path}: {int(is_none.sum())} of {is_none.size} rows have a frequency of zero or below; "
                        "they are no readings and are marked invalid",
                        stacklevel=4,
                    )
                self.is_whole &= ~is_none


def _leave_out_statistics(path: Path, block: Block) -> None:
    """Take rows of means and deviations, which programs and people put below readings, out of a table."""
    kept = [not any(cell.casefold().strip(" .:") in _STATISTICS for cell in cells) for _, cells in block.rows]
    if not all(kept) and any(kept):
        left_out = [number for (number, _), is_kept in zip(block.rows, kept, strict=True) if not is_kept]
        warnings.warn(
            f"{path}: {listed(left_out)}: rows of means or deviations are no readings; left out", stacklevel=4
        )
        block.rows = [row for row, is_kept in zip(block.rows, kept, strict=True) if is_kept]
        block.widths = [width for width, is_kept in zip(block.widths, kept, strict=True) if is_kept]


def _short_rows(path: Path, block: Block) -> NDArray[np.bool_]:
    """Find rows that lost cells, in a table whose other rows are whole.

    Which cell was lost is not known: two numbers may have become one, and those behind it stand in
    the wrong columns. An empty cell is no lost one; nor are those that every row lacks alike.
    """
    width = max((k + 1 for k, heading in enumerate(block.headings) if heading.text), default=0)
    is_short = np.array(block.widths) < width
    if is_short.all() and block.separator == _layout.BLANKS:
        message = f"the headings name {width} columns, the rows hold {max(block.widths)} numbers between blanks"
        hint = f'Name the columns in order: columns="{example(block)}", without those that hold no numbers.'
        raise SourceError(path, message, line=block.line, hint=hint)
    if is_short.all() and len(set(block.widths)) <= 1:
        return np.zeros(len(block.rows), dtype=bool)
    short = [number for (number, _), is_one in zip(block.rows, is_short, strict=True) if is_one]
    if short:
        warnings.warn(
            f"{path}: {listed(short)}: {len(short)} of {len(block.rows)} rows hold fewer than "
            f"{width} cells; it is unknown which are missing, so these rows are marked invalid",
            stacklevel=3,
        )
    return is_short


def _values(path: Path, block: Block, signs: Separators) -> Floats:
    """Return the numbers of the known columns, NaN for an absent one; text of others is no number."""
    width = len(block.headings)
    table = np.full((len(block.rows), width), np.nan)
    for i, (number, cells) in enumerate(block.rows):
        if len(cells) > width:
            raise SourceError(
                path,
                f"found {len(cells)} cells, expected {width}",
                line=number,
                hint="A cell was added; compare the row with its neighbours.",
            )
        for j, cell in enumerate(cells):
            if cell.casefold() in ABSENT:
                continue
            value = plain_number(_layout.plain(cell).replace("D", "E").replace("d", "e"), signs)
            if value is not None and abs(value) >= _NO_READING:
                continue
            if value is None and block.headings[j].is_known:
                if _WITH_UNIT.fullmatch(cell):
                    raise SourceError(path, f"found {shorten(cell)}, expected a number alone", line=number, hint=_ALONE)
                at = sum(len(before) + 1 for before in cells[:j]) + 1
                raise not_a_number(cell, path=path, line_number=number, column=at)
            table[i, j] = np.nan if value is None else value
    return table


def _fill_merged(block: Block, values: Floats) -> None:
    """Give every row the temperature or number of its set where cells of a spreadsheet were merged."""
    for heading, column in zip(block.headings, values.T, strict=True):
        stated = np.isfinite(column)
        is_merged = heading.name in ("temperature", "temperature_set", "set") and stated[0]
        if is_merged and 2 * np.count_nonzero(stated) <= column.size:
            column[:] = column[np.maximum.accumulate(np.where(stated, np.arange(column.size), 0))]


def _tell_of_specimens(path: Path, block: Block) -> None:
    """Say that a column names several specimens, whose rows are read as those of one."""
    for k, heading in enumerate(block.headings):
        if heading.name in _SPECIMEN:
            names = sorted({row[k] for _, row in block.rows if k < len(row) and row[k]})
            if len(names) > 1:
                warnings.warn(
                    f"{path}:{block.line}: {heading.text} names {len(names)} specimens ({shorten(', '.join(names))}), "
                    "which are read as one; if they are of different materials, give each a file of its own",
                    stacklevel=5,
                )


def _converted(path: Path, block: Block, pairs: Sequence[Pair]) -> dict[str, Column]:
    """Convert columns to SI by the units that the file states, and make the moduli of them."""
    found: dict[str, Column] = {}
    for heading, values in pairs:
        if not heading.is_known:
            if np.isfinite(values).any() and heading.name not in (*found, *_OWN):
                found[heading.name] = Column(heading.name, heading.text, heading.unit, heading.unit or "1", values)
            continue
        if heading.name not in found:
            found[heading.name] = _column(path, block, heading, values)
    count = len(next(iter(found.values())).values)
    for name, (value, unit) in block.facts.items():
        has = found.keys() & (FREQUENCIES if name == "frequency" else {name})
        if not has:
            heading = Heading(f"{name} of the header", name, unit, is_known=True)
            found[name] = _column(path, block, heading, np.full(count, value))
    if "temperature" not in found and "temperature_set" in found:
        column = found["temperature_set"]
        found["temperature"] = Column("temperature", column.header, column.unit, column.si, column.values)
    found, contradictions = with_moduli(found)
    for said in contradictions:
        warnings.warn(f"{path}:{block.line}: {said}", stacklevel=5)
    return _with_log_shift(path, found)


def _column(path: Path, block: Block, heading: Heading, values: Floats) -> Column:
    """Convert one column to SI."""
    name, stated = heading.name, heading.unit
    wanted = _words.SI_OF.get(name, ("1",))
    if not stated and name == "angular_frequency":
        stated = "rad/s"  # that is what an angular frequency is in
    if not stated and is_of_parameters(block.above[1]):
        stated = {"frequency": "rad/s"}.get(name, "Pa" if "Pa" in wanted else "")  # RepTate's own units
    try:
        unit = _words.unit_of(stated) if stated or name in UNITLESS or "1" in wanted else None
    except InputError:
        unit = None
    if unit is None or unit.si not in wanted:
        is_in = f"is in {shorten(stated)}" if stated else "has no unit"
        spelled = " or ".join(dict.fromkeys("degC" if si == "degF" else si for si in wanted))
        raise SourceError(
            path,
            f"{heading.text} {is_in}, expected a unit of {spelled}",
            line=block.unit_line or block.line,
            hint="State the units in the headings or in a row below them, or give all columns in order: "
            f'columns="{example(block)}".',
        )
    if stated.strip("[]() ") == "mPa":
        warnings.warn(
            f"{path}:{block.unit_line or block.line}: {heading.text} is in mPa, which is read as MPa (megapascal); "
            "if it is in millipascal, write 1e-3 Pa",
            stacklevel=6,
        )
    column = 10.0**values if heading.is_logarithm else values
    si = "rad/s" if name == "angular_frequency" else "Hz" if name == "frequency" else unit.si
    factor = unit.factor
    if name == "angular_frequency" and unit.si == "Hz":
        factor *= 2.0 * np.pi
    if name == "frequency" and unit.si == "rad/s":
        factor /= 2.0 * np.pi
    column = column * factor
    if unit.si == "K" and "degC" in wanted:
        column, si = column - _ZERO_CELSIUS, "degC"
    if unit.si == "degF":
        column, si = (column - 32.0) * 5.0 / 9.0, "degC"
    return Column(name, heading.text or name, stated, si, column)


def _with_log_shift(path: Path, columns: dict[str, Column]) -> dict[str, Column]:
    """Return shifts as their decimal logarithm, however they were written."""
    for name in ("a_T", "ln_aT"):
        if name not in columns or "log10_aT" in columns:
            continue
        column = columns.pop(name)
        values = np.asarray(column.values, dtype=float)
        if name == "a_T" and (values <= 0).any():
            raise SourceError(path, f"{column.header} is zero or negative; shift factors are not")
        found = np.log10(values) if name == "a_T" else values / np.log(10.0)
        columns["log10_aT"] = Column("log10_aT", column.header, column.unit, "1", found)
    return columns


def _joined(parts: Sequence[dict[str, Column]]) -> dict[str, Column]:
    """Put tables that stood side by side one below the other, numbered as sets."""
    if len(parts) == 1:
        return parts[0]
    names = [name for name in parts[0] if all(name in part for part in parts)]
    joined = {
        name: Column(
            name, parts[0][name].header, parts[0][name].unit, parts[0][name].si,
            np.concatenate([np.asarray(part[name].values) for part in parts]),
        )
        for name in names
    }  # fmt: skip
    count = len(next(iter(parts[0].values())).values)
    numbers = np.repeat(np.arange(len(parts), dtype=float), count)
    return joined | {"set": Column("set", "", "", "1", numbers)}


def _complete(path: Path, tables: Sequence[_Table]) -> list[_Table]:
    """Return the tables that can be used; refuse a file that has none, naming what is missing."""
    whole = [table for table in tables if not table.missing]
    sweeps = [table for table in whole if not table.block.names() & SHIFTS]
    if sweeps and len(sweeps) < len(whole):
        warnings.warn(
            f"{path}: a table of shift factors beside the readings is left out; give it as a file of its own",
            stacklevel=3,
        )
        whole = sweeps
    if not whole:
        block = tables[0].block
        vague = next((heading for heading in block.headings if heading.name in _VAGUE), None)
        said = f"found {_spoken(block.headings)}; no {tables[0].missing}"
        remedy = "Export the table again with it; if a column is there under another name, name all columns in order"
        if vague is not None and "modulus" in tables[0].missing:
            said = f"{shorten(vague.text)} may be the storage modulus or the complex one; the file does not say which"
            remedy = "Say it by naming the columns in order, with E' or |E*| in its place"
        hint = f'{remedy}: columns="{example(block)}".'
        raise SourceError(_place(path, block), said, line=block.line, hint=hint)
    for table in tables:
        if table.missing:
            title = f' "{table.block.title}"' if table.block.title else ""
            warnings.warn(
                f"{path}:{table.block.line}: the table{title} is left out: found {_spoken(table.block.headings)}; "
                f"no {table.missing}",
                stacklevel=3,
            )
    return whole


def _sets(columns: dict[str, Column], count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows set by set, in the order in which sets begin, and where every set starts.

    A row without a number belongs to the set of the row above it.
    """
    if "set" not in columns:
        return np.arange(count), np.array([0])
    numbers = np.asarray(columns["set"].values, dtype=float)
    numbered = np.where(np.isnan(numbers), 0, np.arange(count))
    numbers = numbers[np.maximum.accumulate(numbered)]
    _, first, member = np.unique(numbers, return_index=True, return_inverse=True)
    order = np.argsort(first[member], kind="stable")
    begins = np.concatenate([[True], np.diff(first[member][order]) != 0])
    return order, np.flatnonzero(begins)


def _warn_of_a_cut(path: Path, sizes: NDArray[np.intp]) -> bool:
    """Tell a file that was cut between two lines: its last set lacks rows that all others have."""
    usual = int(sizes[0])
    is_cut = sizes.size > 2 and bool((sizes[:-1] == usual).all()) and int(sizes[-1]) < usual
    if is_cut:
        warnings.warn(
            f"{path}: the last set holds {sizes[-1]} rows, all others {usual}; the file may be cut", stacklevel=4
        )
    return is_cut


def _intervals(path: Path, table: _Table, first: int) -> Iterator[Interval]:
    """Yield one interval of every run of a set, or of the whole table."""
    count = len(next(iter(table.columns.values())).values)
    order, starts = _sets(table.columns, count)
    stops = np.append(starts[1:], count)
    kept = [column for name, column in table.columns.items() if name != "set"]
    for number, (start, stop) in enumerate(zip(starts, stops, strict=True), first):
        rows = order[start:stop]
        yield Interval(
            path.stem,
            table.block.title or "table",
            number,
            None,
            np.arange(1, stop - start + 1),
            table.is_whole[rows],
            tuple(Column(c.name, c.header, c.unit, c.si, np.asarray(c.values)[rows]) for c in kept),
        )


def _assembled(path: Path, encoding: str, tables: Sequence[_Table], signs: Separators) -> xr.Dataset:
    """Make one Dataset of all tables."""
    intervals: list[Interval] = []
    for table in tables:
        intervals += _intervals(path, table, len(intervals) + 1)
    sizes = np.array([interval.point.size for interval in intervals])
    is_cut = _warn_of_a_cut(path, sizes)
    numbers = [
        np.asarray(c.values, dtype=float) for table in tables for name, c in table.columns.items() if name != "set"
    ]
    work = {"bytes_read": path.stat().st_size, "rows_read": int(sizes.sum()), "intervals_read": len(intervals)}
    dataset = assemble(
        _one_unit(intervals),
        source=path.name,
        encoding=encoding,
        header="",
        empty_cells=int(sum(np.isnan(values).sum() for values in numbers)),
        work=json.dumps(work),
        delimiter=tables[0].block.separator,
        decimal=signs.decimal,
    )
    dataset.attrs |= {"instrument": DEVICE, "layout": "plain table"}
    if is_cut:
        dataset.attrs["incomplete"] = 1
    return dataset


def _one_unit(intervals: Sequence[Interval]) -> list[Interval]:
    """Leave unknown columns out whose unit is not the same in all tables."""
    units: dict[str, set[str]] = {}
    for interval in intervals:
        for column in interval.columns:
            units.setdefault(column.name, set()).add(column.si)
    return [
        Interval(
            i.test, i.result, i.number, i.declared, i.point, i.is_valid,
            tuple(c for c in i.columns if len(units[c.name]) == 1),
        )
        for i in intervals
    ]  # fmt: skip

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
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from instruments._instrument import HEAD_BYTES
from instruments._symbols import SHIFTS
from instruments.anton_paar import Column, Interval, assemble
from instruments.tables import CODECS, _layout, _words, workbook_hint
from instruments.tables._cells import numbers_of, plain
from instruments.tables._columns import example
from instruments.tables._layout import Block
from instruments.tables._values import Table
from instruments.tables._words import Heading
from labpipe.errors import InputError, SourceError, warn_of
from labpipe.text import Limits, Separators, TextFile, check_decimal, first_bytes, separators, shorten, survey

DEVICE = "plain table of a dynamic mechanical analysis"

_HEADER = 100  # lines in which a file says how it is written
_LIMITS = Limits(max_bytes=128 << 20)
_VAGUE = ("modulus", "module", "modul", "modulo", "e", "g", "e_modulus", "youngs_modulus", "young_s_modulus", "e_modul")
_DECIMAL = re.compile(r"#DE[CZ]IMAL:\s*(\w+)")  # of Netzsch


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
    check_decimal(decimal)
    path = Path(path)
    named = None if columns is None else _named(columns)
    found = _in_sheets(path, named) if _is_workbook(path) else _in_text(path, encoding, allow_incomplete, named)
    signs = _signs(path, found.blocks, decimal or found.decimal)
    if found.open_line and not allow_incomplete:
        _check_last_row(path, found.open_line, found.blocks[-1])
    whole = _complete(path, [Table(_place(path, block), block, signs) for block in found.blocks])
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
    head = first_bytes(path, HEAD_BYTES)
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
        raise InputError(
            f'columns="{columns}" names {_spoken(found)}; expected frequency and two of storage modulus, loss modulus, '
            "tan δ and so on, for example \"f (Hz), E' (MPa), E'' (MPa), T (degC)\""
        )
    return found


def _lines(source: TextFile, allow_incomplete: bool) -> list[tuple[int, str]]:
    """Return the lines that are not empty with their numbers; without a cut one, if that is asked for."""
    found = [(number, line) for number, line in _layout.joined(source.lines()) if line.strip("\t;,| ")]
    if source.is_ended or not found or not allow_incomplete:
        return found
    warn_of(source.path, "the last line is cut, it has no line end; it is dropped", line=source.n_lines)
    return found[:-1]


def _check_last_row(path: Path, line: int, block: Block) -> None:
    """Refuse a last line that lost cells; of a whole one, say that its number may be short."""
    if not block.rows or block.rows[-1][0] != line:
        return
    if len(block.rows[-1][1]) < max(map(len, (cells for _, cells in block.rows))):
        text = "the last line has no line end and fewer cells than the others; it is cut"
        raise SourceError(path, text, line=line, hint="Complete the line, or drop it with allow_incomplete=True.")
    warn_of(
        path,
        "the last line has no line end; it is kept, as no cell is missing, "
        "but if the file was cut, its last number is wrong",
        line=line,
    )


def _without_headings(path: Path, lines: Sequence[tuple[int, str]]) -> SourceError:
    """Say what was found in place of headings, and how to name the columns."""
    width = next((len(found) for _, line in lines[:200] if len(found := numbers_of(line)) > 2), 0)
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
        plain(cell)
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


def _complete(path: Path, tables: Sequence[Table]) -> list[Table]:
    """Return the tables that can be used; refuse a file that has none, naming what is missing."""
    whole = [table for table in tables if not table.missing]
    sweeps = [table for table in whole if not table.block.names() & SHIFTS]
    if sweeps and len(sweeps) < len(whole):
        warn_of(path, "a table of shift factors beside the readings is left out; give it as a file of its own")
        whole = sweeps
    if not whole:
        block = tables[0].block
        vague = next((heading for heading in block.headings if heading.name in _VAGUE), None)
        said = f"found {_spoken(block.headings)}; no {tables[0].missing}"
        remedy = "Export the table again with it; if a column is there under another name, name all columns in order"
        if vague is not None and "modulus" in tables[0].missing:
            said = f"{shorten(vague.text)} may be the storage modulus or the complex one; the file does not say which"
            remedy = "Say it by naming the columns in order, with E' or |E*| in its place"
        raise SourceError(_place(path, block), said, line=block.line, hint=f'{remedy}: columns="{example(block)}".')
    for table in tables:
        if table.missing:
            title = f' "{table.block.title}"' if table.block.title else ""
            warn_of(
                path,
                f"the table{title} is left out: found {_spoken(table.block.headings)}; no {table.missing}",
                line=table.block.line,
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
        warn_of(path, f"the last set holds {sizes[-1]} rows, all others {usual}; the file may be cut")
    return is_cut


def _intervals(path: Path, table: Table, first: int) -> Iterator[Interval]:
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
            tuple(replace(column, values=np.asarray(column.values)[rows]) for column in kept),
        )


def _assembled(path: Path, encoding: str, tables: Sequence[Table], signs: Separators) -> xr.Dataset:
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

"""Plain tables of a dynamic mechanical analysis: a row of headings, a row of units, numbers.

This is how other analysers, programs and supplements of papers hand sweeps on::

    f,E_stor,E_loss,T,Set
    Hz, MPa, MPa, C, -
    0.1,8097.175545,93.07449045,-49.9612,0

and shift factors: ``T,log_aT``. Columns are found by name (:mod:`instruments.tables._words`),
units by the second row or by brackets in the headings; nothing is guessed. A column ``Set``
numbers the isotherms. The result has the form of :func:`instruments.anton_paar.read`.
"""

import csv
import json
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from instruments import anton_paar
from instruments.anton_paar import Column, Interval, assemble
from instruments.tables import _words
from labpipe.arrays import Floats
from labpipe.errors import InputError, SourceError
from labpipe.numbers import listed
from labpipe.text import Limits, Separators, TextFile, not_a_number, plain_number, separators, shorten, survey

DEVICE = "plain table of a dynamic mechanical analysis"


_LIMITS = Limits(max_bytes=128 << 20)
_ABSENT = ("", "-", "nan", "n/a", "na")
_ZERO_CELSIUS = 273.15
# What the canonical columns become beyond those of a rheometer.
_SI_OF = {
    **anton_paar.SI_OF,
    "log10_aT": ("1",),
    "ln_aT": ("1",),
    "a_T": ("1",),
    "b_T": ("1",),
    "set": ("1",),
    "temperature": ("degC", "K"),
    "temperature_set": ("degC", "K"),
}


@dataclass(frozen=True, slots=True)
class _Head:
    """What the first rows say: names, headings and units of the columns; where numbers begin."""

    names: list[str]
    headings: list[str]
    units: list[str]
    first: int


def read(
    path: str | os.PathLike[str],
    *,
    encoding: str | None = None,
    decimal: str | None = None,
    allow_incomplete: bool = False,
) -> xr.Dataset:
    """Read sweeps or shift factors from a plain table.

    Parameters
    ----------
    path : path-like
        Text with TAB, semicolon or comma between the columns.
    encoding, decimal : str, optional
        By default decided from the file.
    allow_incomplete : bool
        Drop a last row that has no line end, with a warning; by default such a file is refused.

    Returns
    -------
    Dataset
        Over ``sample``, as :func:`instruments.anton_paar.read`: ``frequency`` [Hz],
        ``storage_modulus``, ``loss_modulus`` [Pa], ``temperature`` [degC]; ``interval`` counts
        the sets, where the file numbers them. Of a table of shifts ``temperature`` and
        ``log10_aT`` (from ``a_T`` or its natural logarithm, if need be).

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
    source = survey(path, declared=(encoding,) if encoding else ("cp1252",), limits=_LIMITS)
    lines = _lines(source, allow_incomplete)
    delimiter = _words.delimiter_of(lines[0][1]) if lines else ""
    if not delimiter:
        raise SourceError(
            path,
            "the first line holds no headings separated by TAB, semicolon or comma",
            line=1,
            hint="Begin with a row such as f,E_stor,E_loss,T and a row of units.",
        )
    rows = [(number, _cells(line, delimiter)) for number, line in lines]
    head = _head(path, rows)
    is_short = _short_rows(path, lines[head.first :], len(head.names), delimiter)
    signs = _signs(path, rows[head.first :], delimiter, decimal)
    values = _values(path, rows[head.first :], head, signs)
    values[is_short] = np.nan
    columns = _columns(path, head, values, rows[0][0])
    how = {"delimiter": delimiter, "decimal": signs.decimal}
    return _assembled(path, source, columns, ~is_short, how)


def _lines(source: TextFile, allow_incomplete: bool) -> list[tuple[int, str]]:
    """Return the lines that are not empty with their numbers, the last one only if it is whole."""
    found = [(number, line) for number, line in enumerate(source.lines(), 1) if line.strip("\t;, ")]
    if source.is_ended or not found:
        return found
    if not allow_incomplete:
        raise SourceError(
            source.path,
            "the last line has no line end; it may be cut",
            line=source.n_lines,
            hint="End the line if it is whole, or drop it with allow_incomplete=True.",
        )
    warnings.warn(
        f"{source.path}:{source.n_lines}: the last line is cut, it has no line end; it is dropped", stacklevel=3
    )
    return found[:-1]


def _cells(line: str, delimiter: str) -> list[str]:
    """Split one line; what a spreadsheet padded at its end falls away."""
    cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _short_rows(path: Path, lines: Sequence[tuple[int, str]], width: int, delimiter: str) -> NDArray[np.bool_]:
    """Find rows that lost cells, in a table whose other rows are whole.

    Which cell was lost is not known: two numbers may have become one, and those behind it stand in
    the wrong columns. An empty cell is no lost one; nor are those that every row lacks alike.
    """
    counts = [len(next(csv.reader([line], delimiter=delimiter))) for _, line in lines]
    is_short = np.array(counts) < width
    if is_short.all() and len(set(counts)) <= 1:
        return np.zeros(len(lines), dtype=bool)
    short = [number for (number, _), count in zip(lines, counts, strict=True) if count < width]
    if short:
        warnings.warn(
            f"{path}: {listed(short)}: {len(short)} of {len(lines)} rows hold fewer than "
            f"{width} cells; it is unknown which are missing, so these rows are marked invalid",
            stacklevel=3,
        )
    return is_short


def _head(path: Path, rows: Sequence[tuple[int, list[str]]]) -> _Head:
    """Read headings and units."""
    number, headings = rows[0]
    parts = [_words.parted(heading) for heading in headings]
    names = [_words.quantity(name) or anton_paar.slug(name) for name, _ in parts]
    if not _words.is_table(set(names)):
        raise SourceError(
            path,
            f"found the columns {shorten(', '.join(headings))}, expected frequency, "
            "temperature, storage and loss modulus, or temperature and log_aT",
            line=number,
            hint="Name the columns, for example f,E_stor,E_loss,T.",
        )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise SourceError(
            path,
            f"two columns hold the same quantity: {', '.join(twice)}",
            line=number,
            hint="Delete or rename one of them.",
        )
    units = [unit for _, unit in parts]
    second = rows[1][1] if len(rows) > 1 else []
    # A unit may be "1"; but the first column always has one that is no number.
    if second and plain_number(second[0].replace(",", ".")) is None:
        stated = second + [""] * (len(names) - len(second))
        return _Head(names, headings, stated[: len(names)], 2)
    return _Head(names, headings, units, 1)


def _signs(path: Path, rows: Sequence[tuple[int, list[str]]], delimiter: str, decimal: str | None) -> Separators:
    """Decide the decimal sign; between commas it can only be the dot."""
    if decimal is not None or delimiter == ",":
        return Separators(decimal or ".", "")
    try:
        return separators(cell for _, cells in rows for cell in cells)
    except InputError as error:
        raise SourceError(path, str(error)) from None


def _values(path: Path, rows: Sequence[tuple[int, list[str]]], head: _Head, signs: Separators) -> Floats:
    """Return the numbers, NaN for an absent one."""
    width = len(head.names)
    if not rows:
        raise SourceError(path, "found no row of numbers below the headings", line=1)
    table = np.full((len(rows), width), np.nan)
    for i, (number, cells) in enumerate(rows):
        if len(cells) > width:
            raise SourceError(
                path,
                f"found {len(cells)} cells, expected {width}",
                line=number,
                hint="A cell was added; compare the row with its neighbours.",
            )
        for j, cell in enumerate(cells):
            if cell.casefold() in _ABSENT:
                continue
            value = plain_number(cell, signs)
            if value is None:
                at = sum(len(before) + 1 for before in cells[:j]) + 1
                raise not_a_number(cell, path=path, line_number=number, column=at)
            table[i, j] = value
    return table


def _columns(path: Path, head: _Head, values: Floats, line: int) -> dict[str, Column]:
    """Convert every column to SI by the unit that the file states."""
    found: dict[str, Column] = {}
    for j, (name, heading, stated) in enumerate(zip(head.names, head.headings, head.units, strict=True)):
        wanted = _SI_OF.get(name)
        try:
            unit = anton_paar.unit_of(stated or "1")
        except InputError:
            if wanted is None:
                found[name] = Column(name, heading, stated, stated or "1", values[:, j])
                continue
            unit = None
        # The radian is often left out.
        si = "rad/s" if unit and name == "angular_frequency" and unit.si == "1/s" else None
        si = si or (unit.si if unit else None)
        if unit is None or si is None or (wanted is not None and si not in wanted):
            raise SourceError(
                path,
                f"{heading} is in {shorten(stated or 'no unit')}, expected a unit of "
                f"{' or '.join(wanted or ('its own',))}",
                line=line + (head.first > 1),
                hint="State the units in the second row, for example Hz, MPa, MPa, C.",
            )
        column = values[:, j] * unit.factor
        if si == "K":
            column, si = column - _ZERO_CELSIUS, "degC"
        found[name] = Column(name, heading, stated, si, column)
    return _with_log_shift(path, found)


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


def _assembled(
    path: Path, source: TextFile, columns: dict[str, Column], is_whole: NDArray[np.bool_], how: dict[str, str]
) -> xr.Dataset:
    """Make one interval of every run of a set, or of the whole table."""
    count = len(next(iter(columns.values())).values)
    order, starts = _sets(columns, count)
    stops = np.append(starts[1:], count)
    is_cut = _warn_of_a_cut(path, stops - starts)
    kept = [column for name, column in columns.items() if name != "set"]
    intervals = [
        Interval(
            path.stem,
            "table",
            number,
            None,
            np.arange(1, stop - start + 1),
            is_whole[order[start:stop]],
            tuple(Column(c.name, c.header, c.unit, c.si, np.asarray(c.values)[order[start:stop]]) for c in kept),
        )
        for number, (start, stop) in enumerate(zip(starts, stops, strict=True), 1)
    ]
    dataset = assemble(
        intervals,
        source=path.name,
        encoding=source.encoding,
        header="",
        empty_cells=int(sum(np.isnan(np.asarray(c.values, dtype=float)).sum() for c in kept)),
        work=json.dumps({"bytes_read": source.size, "rows_read": count, "intervals_read": len(intervals)}),
        **how,
    )
    dataset.attrs |= {"instrument": DEVICE, "layout": "plain table"}
    if is_cut:
        dataset.attrs["incomplete"] = 1
    return dataset

"""The readings of a Keyence storage file: values, states and counter, every row accounted for.

Rows are parsed in batches by numpy. A batch that holds a marker, or a number that may be one, is
read again cell by cell; so is any batch in which something is wrong, to name line and column.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from instruments.keyence._header import Header, KeyenceProfile, column_of, split_cells
from instruments.keyence._markers import NINES, NUMERIC_MARKERS, Layout, Status, is_padded, layout, marker_status
from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError, SourceError
from labpipe.text import (
    DOT,
    Separators,
    check_width,
    marker_reason,
    not_a_number,
    parse_rows,
    plain_number,
    separators,
    shorten,
)

_BATCH = 1 << 11  # rows: markers come in runs, so a small batch keeps most of the file fast
SAMPLE = 200  # rows from which delimiter, decimal sign and layout of the columns are learnt

_SUSPICIOUS = np.array(sorted({*NUMERIC_MARKERS, *NINES, *(-nines for nines in NINES)}))


class Rows(NamedTuple):
    """The readings.

    ``values`` (row, output): in the units of the file; NaN where there is no reading; ``status`` (row, output):
    :class:`Status`; ``counter`` (row,): the counter of the file; ``layouts``: of every output, where all its sampled
    numbers have one; ``signs``.
    """

    values: Floats
    status: NDArray[np.int8]
    counter: Integers | None
    layouts: tuple[Layout | None, ...]
    signs: Separators


class _Table(NamedTuple):
    """What is the same for all rows of one file."""

    path: Path
    header: Header
    profile: KeyenceProfile
    signs: Separators
    layouts: tuple[Layout | None, ...]
    fixed: bool  # zero-padded throughout: a number of another layout has lost or gained digits


def read_rows(path: Path, header: Header, lines: Iterable[str], profile: KeyenceProfile) -> Rows:
    """Read all rows; the caller has removed blank lines at the end.

    Raises
    ------
    SourceError
        With line and column of a cell that is neither number nor marker, of a row with another
        number of cells, of a number that does not have the layout of its column.
    """
    stream = iter(lines)
    sample = list(islice(stream, SAMPLE))
    table = _learn(path, header, sample, profile)
    parts: list[tuple[Floats, NDArray[np.int8]]] = []
    line_number = header.n_lines + 1
    for batch in _batches(sample, stream):
        parts.append(_read_batch(table, batch, line_number))
        line_number += len(batch)
    values = np.concatenate([part[0] for part in parts])
    status = np.concatenate([part[1] for part in parts])
    counter = values[:, 0].astype(np.int64) if header.has_counter else None
    first = int(header.has_counter)
    return Rows(values[:, first:], status[:, first:], counter, table.layouts[first:], table.signs)


def _batches(sample: list[str], stream: Iterator[str]) -> Iterator[list[str]]:
    batch = sample
    while batch:
        yield batch
        batch = list(islice(stream, _BATCH))


def _learn(path: Path, header: Header, sample: Sequence[str], profile: KeyenceProfile) -> _Table:
    rows = [split_cells(line, header.delimiter) for line in sample]
    first = int(header.has_counter)
    cells = [cell for row in rows for cell in row[first:]]
    numbers = [cell for cell in cells if marker_status(cell, profile.markers) is None]
    signs = _signs(path, header, numbers, profile)
    n_columns = first + len(header.outputs)
    columns = [[row[i] for row in rows if len(row) == n_columns] for i in range(n_columns)]
    layouts = tuple(_column_layout(column) for column in columns)
    is_fixed = all(each is not None for each in layouts[first:]) and all(
        any(map(is_padded, column)) for column in columns[first:]
    )
    return _Table(path, header, profile, signs, layouts, is_fixed)


def _signs(path: Path, header: Header, numbers: Sequence[str], profile: KeyenceProfile) -> Separators:
    if profile.decimal is not None:
        return Separators(profile.decimal, "")
    if header.delimiter == ",":
        return DOT
    try:
        return separators(numbers)
    except InputError as error:
        raise SourceError(path, str(error), line=header.n_lines + 1) from None


def _column_layout(cells: Sequence[str]) -> Layout | None:
    """Return the layout that the numbers of a column have; one odd cell does not unsettle it."""
    counted = Counter(found for found in map(layout, cells) if found is not None)
    if not counted:
        return None
    most, count = counted.most_common(1)[0]
    others = sum(counted.values()) - count
    return most if others <= max(1, count // 20) and count > others else None


def _read_batch(table: _Table, lines: list[str], first_line: int) -> tuple[Floats, NDArray[np.int8]]:
    header = table.header
    n_columns = len(header.outputs) + header.has_counter
    if '"' in lines[0]:
        lines = [line.replace('"', "") for line in lines]
    if not table.fixed or _same_length(lines, header):
        try:
            values = parse_rows(
                lines, n_columns, header.delimiter, path=table.path, first_line=first_line, signs=table.signs
            )
        except SourceError:
            values = np.empty((0, n_columns))
        outputs = values[:, int(header.has_counter) :]
        if len(values) and not _has_suspicious(outputs):
            return values, np.zeros(values.shape, dtype=np.int8)
    rows = [_read_row(table, line, number) for number, line in enumerate(lines, first_line)]
    return (
        np.array([values for values, _ in rows], dtype=np.float64),
        np.array([status for _, status in rows], dtype=np.int8),
    )


def _same_length(lines: list[str], header: Header) -> bool:
    """Tell whether all rows are equally long, apart from the digits of the counter."""
    if not header.has_counter:
        return len(set(map(len, lines))) == 1
    delimiter = header.delimiter
    return len({len(line) - line.find(delimiter) for line in lines}) == 1


def _has_suspicious(outputs: Floats) -> bool:
    """Find numbers that may be markers; a decimal fraction has one nearest double, so == does."""
    near = np.searchsorted(_SUSPICIOUS, outputs)
    near = np.minimum(near, len(_SUSPICIOUS) - 1)
    below = np.maximum(near - 1, 0)
    tolerance = 1e-9 * np.abs(outputs)  # NINES are computed, not parsed: their last bit may differ
    return bool(
        np.any(np.abs(_SUSPICIOUS[near] - outputs) <= tolerance)
        or np.any(np.abs(_SUSPICIOUS[below] - outputs) <= tolerance)
    )


def _read_row(table: _Table, line: str, line_number: int) -> tuple[list[float], list[int]]:
    header = table.header
    n_columns = len(header.outputs) + header.has_counter
    cells = split_cells(line, header.delimiter)
    check_width(line, cells, n_columns, header.delimiter, path=table.path, line_number=line_number)
    values, states = [], []
    for index, cell in enumerate(cells):
        is_counter = header.has_counter and index == 0
        status = None
        if not is_counter:
            status = marker_status(cell, table.profile.markers, table.layouts[index])
        if status is not None:
            values.append(np.nan)
            states.append(int(status))
            continue
        number = plain_number(cell, table.signs)
        column = column_of(line, header.delimiter, index) if header.columns.all_kept else None
        if number is None:
            raise not_a_number(cell, path=table.path, line_number=line_number, column=column)
        if is_counter and not cell.isdigit():
            text = f"found the counter {shorten(cell)}, expected a whole number"
            raise SourceError(table.path, text, line=line_number, column=column)
        if table.fixed and not is_counter and layout(cell) != table.layouts[index]:
            raise _other_layout(table, cell, index, line_number, column)
        values.append(number)
        states.append(int(Status.VALID))
    return values, states


def _other_layout(table: _Table, cell: str, index: int, line_number: int, column: int | None) -> SourceError:
    known = table.layouts[index]
    digits = f"{known.whole} digits before and {known.decimals} after the decimal sign" if known else ""
    text = f"found {shorten(cell)}, but every number of this column has {digits}"
    hint = "Characters were lost or added: export the file again."
    return SourceError(table.path, text, line=line_number, column=column, hint=hint).because(marker_reason(cell))

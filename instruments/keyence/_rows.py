"""The readings of a Keyence storage file: values, states and counter, every row accounted for.

Rows are parsed in batches by numpy. A batch that holds a marker, or a number that may be one, is
read again cell by cell; so is any batch in which something is wrong, to name line and column.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from instruments.keyence._header import Header, column_of, split_cells
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
_SAMPLE = 200  # rows from which delimiter, decimal sign and layout of the columns are learnt
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
    """Properties of all rows of one file; ``fixed`` numbers are padded: one of another layout lost or gained digits."""

    path: Path
    header: Header
    n_columns: int
    signs: Separators
    layouts: tuple[Layout | None, ...]
    fixed: bool


def read_rows(path: Path, header: Header, lines: Iterable[str], decimal: str | None) -> Rows:
    """Read all rows.

    Raises
    ------
    SourceError
        With line and column of a cell that is neither number nor marker, of a row with another
        number of cells, of a number that does not have the layout of its column.
    """
    stream = iter(lines)
    sample = list(islice(stream, _SAMPLE))
    table = _learn(path, header, sample, decimal)
    parts: list[tuple[Floats, NDArray[np.int8]]] = []
    line_number = header.n_lines + 1
    stream = chain(sample, stream)
    while batch := list(islice(stream, _BATCH)):
        parts.append(_read_batch(table, batch, line_number))
        line_number += len(batch)
    values, status = (np.concatenate(each) for each in zip(*parts, strict=True)) if parts else (np.empty((0, 1)),) * 2
    first = int(header.has_counter)
    counter = values[:, 0].astype(np.int64) if first else None
    return Rows(values[:, first:], status[:, first:].astype(np.int8), counter, table.layouts[first:], table.signs)


def _learn(path: Path, header: Header, sample: Sequence[str], decimal: str | None) -> _Table:
    rows = [split_cells(line, header.delimiter) for line in sample]
    first = int(header.has_counter)
    if decimal is not None:
        signs = Separators(decimal, "")
    elif header.delimiter == ",":
        signs = DOT
    else:
        try:
            signs = separators([cell for row in rows for cell in row[first:] if marker_status(cell) is None])
        except InputError as error:
            raise SourceError(path, str(error), line=header.n_lines + 1) from None
    n_columns = first + len(header.outputs)
    columns = [[row[i] for row in rows if len(row) == n_columns] for i in range(n_columns)]
    layouts = tuple(_column_layout(column) for column in columns)
    is_fixed = all(layouts[first:]) and all(any(map(is_padded, column)) for column in columns[first:])
    return _Table(path, header, n_columns, signs, layouts, is_fixed)


def _column_layout(cells: Sequence[str]) -> Layout | None:
    """Return the layout that the numbers of a column have; one odd cell does not unsettle it."""
    counted = Counter(found for found in map(layout, cells) if found is not None)
    if not counted:
        return None
    most, count = counted.most_common(1)[0]
    others = sum(counted.values()) - count
    return most if others <= max(1, count // 20) and count > others else None


def _read_batch(table: _Table, lines: list[str], first_line: int) -> tuple[Floats, NDArray[np.int8]]:
    header, delimiter = table.header, table.header.delimiter
    if '"' in lines[0]:
        lines = [line.replace('"', "") for line in lines]
    # rows of fixed numbers are equally long, apart from the digits of the counter
    lengths = {len(line) - (line.find(delimiter) if header.has_counter else 0) for line in lines}
    if not table.fixed or len(lengths) == 1:
        try:
            values = parse_rows(
                lines, table.n_columns, delimiter, path=table.path, first_line=first_line, signs=table.signs
            )
        except SourceError:
            values = np.empty((0, table.n_columns))
        if len(values) and not _has_suspicious(values[:, int(header.has_counter) :]):
            return values, np.zeros(values.shape, dtype=np.int8)
    rows = [_read_row(table, line, number) for number, line in enumerate(lines, first_line)]
    return np.array([values for values, _ in rows], float), np.array([status for _, status in rows], np.int8)


def _has_suspicious(outputs: Floats) -> bool:
    """Find numbers that may be markers; a decimal fraction has one nearest double, so its tolerance is tiny."""
    above = np.minimum(np.searchsorted(_SUSPICIOUS, outputs), len(_SUSPICIOUS) - 1)
    distance = np.minimum(np.abs(_SUSPICIOUS[above] - outputs), np.abs(_SUSPICIOUS[np.maximum(above - 1, 0)] - outputs))
    return bool(np.any(distance <= 1e-9 * np.abs(outputs)))


def _read_row(table: _Table, line: str, line_number: int) -> tuple[list[float], list[int]]:
    header = table.header
    cells = split_cells(line, header.delimiter)
    check_width(line, cells, table.n_columns, header.delimiter, path=table.path, line_number=line_number)
    values, states = [], []
    for index, cell in enumerate(cells):
        is_counter = header.has_counter and index == 0
        status = None if is_counter else marker_status(cell, table.layouts[index])
        if status is not None:
            values.append(np.nan)
            states.append(int(status))
            continue
        number = plain_number(cell, table.signs)
        column = column_of(line, header.delimiter, index) if len(header.kept) == header.n_cells else None
        if number is None:
            raise not_a_number(cell, path=table.path, line_number=line_number, column=column)
        if is_counter and not cell.isdigit():
            text = f"found the counter {shorten(cell)}, expected a whole number"
            raise SourceError(table.path, text, line=line_number, column=column)
        known = table.layouts[index]
        if table.fixed and not is_counter and known is not None and layout(cell) != known:
            digits = f"{known.whole} digits before and {known.decimals} after the decimal sign"
            text = f"found {shorten(cell)}, but every number of this column has {digits}"
            hint = "Characters were lost or added: export the file again."
            error = SourceError(table.path, text, line=line_number, column=column, hint=hint)
            raise error.because(marker_reason(cell))
        values.append(number)
        states.append(int(Status.VALID))
    return values, states

"""What a storage file's columns hold beside outputs: times, judgements, cells that a spreadsheet added.

Only outputs and the counter are read as numbers. Columns of words and empty ones are left out, and
a column of times is kept as text: how many decimals it has says how exact it is.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError, SourceError
from labpipe.numbers import shorten
from labpipe.text import check_width
from labpipe.units import unit

_TIME = re.compile(
    r"(?:elapsed |relative |sampling )?time(?:[ -]?stamp)?|timestamp|t|date[ /&]*time|clock|"
    r"zeit|uhrzeit|temps|時間|時刻|时间",
    re.IGNORECASE,
)
_WORDS = re.compile(r"judge?ments?|judge|results?(?: info)?|status|state|go/?ng|判定(?:結果)?|结果", re.IGNORECASE)
_JUDGEMENT = re.compile(r"GO|NG|OK|HI|LO|HH|LL|HIGH|LOW|PASS|FAIL", re.IGNORECASE)
_CLOCK = re.compile(r"(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[ T])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)")
_LABEL = re.compile(r"(.*?)\s*(?:[\[(]([^\])]*)[\])](?:\s.*)?)?")
_DAY = 86400.0


@dataclass(frozen=True, slots=True)
class Columns:
    """Which columns of a row are read.

    Attributes
    ----------
    n : int
        Cells of a row.
    kept : tuple of int
        The counter and the outputs, in order.
    times : int or None
        The column of times.
    unit_text : str
        The unit of the times, ``""`` when it is not said, or they are times of day.
    """

    n: int
    kept: tuple[int, ...]
    times: int | None = None
    unit_text: str = ""

    @property
    def all_kept(self) -> bool:
        """Whether every cell is a number to be read."""
        return len(self.kept) == self.n


def is_aside(cell: str) -> bool:
    """Tell whether a cell of a row is a time of day or a judgement, and no reading."""
    return _CLOCK.fullmatch(cell) is not None or _JUDGEMENT.fullmatch(cell) is not None


def is_time(name: str) -> bool:
    """Tell whether a column's name, with its unit or without, says that it holds times."""
    label = _LABEL.fullmatch(name)
    return label is not None and _TIME.fullmatch(label[1]) is not None


def sort_columns(names: Sequence[str], row: Sequence[str]) -> Columns:
    """Sort the columns by their names, and where there are none by the cells of the first row."""
    kept, times, unit_text = [], None, ""
    for index, cell in enumerate(row):
        name = _LABEL.fullmatch(names[index]) if names else None
        if times is None and (_TIME.fullmatch(name[1]) if name else _CLOCK.fullmatch(cell)):
            times, unit_text = index, (name and name[2]) or ""
        elif (cell or (names and names[index])) and not (
            _WORDS.fullmatch(name[1] if name else "") or _JUDGEMENT.fullmatch(cell)
        ):
            kept.append(index)
    return Columns(len(row), tuple(kept), times, unit_text)


def only_readings(
    lines: Iterable[str], columns: Columns, delimiter: str, times: list[str], *, path: Path, first_line: int
) -> Iterator[str]:
    """Pass on the cells that are read of each row, and collect its time.

    Raises
    ------
    SourceError
        A row has another number of cells.
    """
    for number, line in enumerate(lines, first_line):
        cells = line.split(delimiter)
        check_width(line, cells, columns.n, delimiter, path=path, line_number=number)
        if columns.times is not None:
            times.append(cells[columns.times].strip(' "'))
        yield delimiter.join(cells[index] for index in columns.kept)


def seconds(texts: Sequence[str], unit_text: str, *, path: Path, first_line: int) -> tuple[Floats, float]:
    """Read the times of all rows.

    Returns
    -------
    time : array (row,)
        [s] from the first row; a day that ends between two rows is followed.
    resolution : float
        [s] of the last decimal written.

    Raises
    ------
    SourceError
        A cell is no time.
    """
    factor = 1.0
    if unit_text:
        try:
            factor = unit(unit_text).factor if unit(unit_text).si == "s" else np.nan
        except InputError:
            factor = np.nan
        if not factor > 0:
            raise SourceError(path, f"found times in {shorten(unit_text)}, expected s, ms or us", line=first_line - 1)
    found = np.empty(len(texts))
    for row, text in enumerate(texts):
        clock = _CLOCK.fullmatch(text)
        try:
            value = float((clock[3] if clock else text).replace(",", "."))
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise SourceError(path, f"found {shorten(text)}, expected a time", line=first_line + row)
        found[row] = int(clock[1]) * 3600 + int(clock[2]) * 60 + value if clock else value
    is_clock = bool(texts) and _CLOCK.fullmatch(texts[0]) is not None
    decimals = max(_decimals(text) for text in texts)
    time = (found - found[0]) * factor
    if is_clock:
        time += _DAY * np.cumsum(np.diff(time, prepend=0.0) < -_DAY / 2)
    return time, factor * 10.0**-decimals


def _decimals(text: str) -> int:
    """Return how many decimals a time is written with; ``5.00E-04`` has six.

    Examples
    --------
    >>> _decimals("0.0005"), _decimals("5.00E-04"), _decimals("14:02:11,5"), _decimals("12")
    (4, 6, 1, 0)
    """
    match = re.search(r"(?:[.,](\d*))?(?:[eE]([+-]?\d+))?$", text)
    return len(match[1] or "") - int(match[2] or 0) if match else 0


def even_interval(time: Floats, resolution: float, *, path: Path, first_line: int) -> float:
    """Return the interval of times that lie evenly, each within its last decimal.

    Raises
    ------
    SourceError
        They do not: rows are missing, repeated or moved.
    """
    n = len(time)
    steps = np.diff(time)
    interval = float(time[-1] / (n - 1)) if n > 1 else 0.0
    allowed = 1.001 * resolution + 1e-9 * abs(interval)
    if interval > 0 and np.max(np.abs(time - interval * np.arange(n))) <= allowed:
        return interval
    usual = float(np.median(steps)) if n > 1 else 0.0
    row = int(np.argmax(np.abs(steps - usual))) + 1 if n > 1 else 0
    raise SourceError(
        path,
        f"the times do not lie evenly: a step of {steps[row - 1] if n > 1 else 0.0:.6g} s, {usual:.6g} s elsewhere",
        line=first_line + row,
        hint="Rows are missing, repeated or moved: export the file again, without gaps.",
    )

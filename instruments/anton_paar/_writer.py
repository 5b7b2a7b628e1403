"""RheoCompass exports as the software writes them: UTF-16, TAB, CRLF."""

import os
from collections.abc import Sequence

import numpy as np

from instruments._intervals import Interval
from instruments._quantities import unit_of
from labpipe import files
from labpipe.errors import InputError


def encode(intervals: Sequence[Interval], project: str = "", digits: int | None = None) -> bytes:
    """Return the bytes of an export: UTF-16, little-endian, with its mark.

    Parameters
    ----------
    intervals : sequence of Interval
        Those of one test, and of one result in it, one behind the other. InputError where a text holds a TAB.
    project, digits : str, int, optional
        First line of the export; significant digits, by default as many as the number has.
    """
    rows, before = [["Project:", project], [""]], ("", "")
    for interval in intervals:
        place = interval.test, interval.result
        rows += [["Test:", interval.test], [""]] if place[0] != before[0] else []
        rows += [["Result:", interval.result], [""]] if place != before else []
        columns, declared = interval.columns, interval.declared or interval.point.size
        rows += [
            ["Interval and data points:", str(interval.number), str(declared)],
            ["Interval data:", "Point No.", *(column.header for column in columns)],
            [""] * (len(columns) + 2),
            ["", "", *(column.unit for column in columns)],
        ]
        numbers = [f"{n}" if ok else f"{n} (invalid)" for n, ok in zip(interval.point, interval.is_valid, strict=True)]
        written = []
        for column in columns:  # in the unit of its heading
            if isinstance(column.values, list):
                written.append(column.values)
                continue
            shown = (np.asarray(column.values) / unit_of(column.unit).factor).tolist()
            texts = (repr(value) if digits is None else f"{value:.{digits}g}" for value in shown)
            written.append(["" if text == "nan" else text.replace("e", "E") for text in texts])
        rows += [*(["", *row] for row in zip(numbers, *written, strict=True)), [""]]
        before = place
    if bad := next((cell for row in rows for cell in row if not {"\n", "\r", "\t"}.isdisjoint(cell)), None):
        raise InputError(f"a cell of an export holds no line end and no TAB: {bad!r}")
    text = "\r\n".join("\t".join(row) for row in rows[:-1]) + "\r\n"
    return b"\xff\xfe" + text.encode("utf-16-le")


def write(
    path: str | os.PathLike[str], intervals: Sequence[Interval], project: str = "", digits: int | None = None
) -> None:
    """Write an export as the software does; see :func:`encode`. StorageError where the file cannot be written."""
    files.write_bytes(path, encode(intervals, project, digits))

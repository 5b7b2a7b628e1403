"""RheoCompass exports as the software writes them: UTF-16, TAB, CRLF."""

import json
import os
from itertools import pairwise

import numpy as np
import xarray as xr

from instruments._quantities import unit_of
from labpipe import files
from labpipe.errors import InputError
from labpipe.units import ZERO_CELSIUS


def encode(dataset: xr.Dataset, *, digits: int | None = None) -> bytes:
    """Turn a Dataset of the form of :func:`instruments.anton_paar.read` into an export.

    Parameters
    ----------
    dataset : Dataset
        As read or assembled.
    digits : int, optional
        Significant digits; by default as many as the number has.

    Returns
    -------
    bytes
        UTF-16, little-endian, with its mark.

    Raises
    ------
    InputError
        The Dataset has another form, or a text holds a TAB or a line end.
    """
    try:
        entries = json.loads(dataset.attrs["tests"])
        stops = np.cumsum([0, *(entry["rows"] for entry in entries)]).tolist()
        if stops[-1] != dataset.sizes["sample"] or not entries:
            raise InputError("the attribute tests does not fit the samples")
        rows = [["Project:", str(dataset.attrs.get("project", ""))], [""]]
        before: tuple[int, int] | tuple[()] = ()
        for entry, (start, stop) in zip(entries, pairwise(stops), strict=True):
            place = entry["test"], entry["result"]
            rows += [["Test:", entry["test_name"]], [""]] if place[:1] != before[:1] else []
            rows += [["Result:", entry["result_name"]], [""]] if place != before else []
            rows += [*_table(dataset.isel(sample=slice(start, stop)), entry, digits), [""]]
            before = place
    except KeyError as error:
        raise InputError(f"not a Dataset of this reader: {error} is missing") from None
    for cell in (cell for row in rows for cell in row):
        if not {"\n", "\r", "\t"}.isdisjoint(cell):
            raise InputError(f"a cell of an export holds no line end and no TAB: {cell!r}")
    text = "\r\n".join("\t".join(row) for row in rows[:-1]) + "\r\n"
    return b"\xff\xfe" + text.encode("utf-16-le")


def _table(part: xr.Dataset, entry: dict[str, object], digits: int | None) -> list[list[str]]:
    """Return the cells of one interval: its labels, headings, units and rows."""
    columns: list[dict[str, str]] = entry["columns"]  # type: ignore[assignment]  # as assembled
    declared = entry["rows"] if entry["declared"] is None else entry["declared"]
    numbers = [
        f"{point or ''}" if is_valid else f"{point or ''} (invalid)"
        for point, is_valid in zip(part["point"].values, part["is_valid"].values, strict=True)
    ]
    written = [_written(part[column["name"]], column["unit"], digits) for column in columns]
    return [
        ["Interval and data points:", str(entry["interval"]), str(declared)],
        ["Interval data:", "Point No.", *(column["header"] for column in columns)],
        ["", "", *(column.get("sub_label", "") for column in columns)],
        ["", "", *(column["unit"] for column in columns)],
        *(["", *row] for row in zip(numbers, *written, strict=True)),
    ]


def _written(values: xr.DataArray, unit: str, digits: int | None) -> list[str]:
    """Return the cells of a column, in the unit of its heading."""
    if values.dtype.kind not in "fiu":
        return [str(value) for value in values.values]
    factor, zero = 1.0, 0.0
    try:
        factor, si = unit_of(unit) if unit else (1.0, "")
        zero = ZERO_CELSIUS if (si, values.attrs["units"]) == ("K", "degC") else 0.0
    except InputError:
        pass  # an unknown quantity was kept in its own unit
    shown = (values.values.astype(float) / factor + zero).tolist()
    texts = (repr(value) if digits is None else f"{value:.{digits}g}" for value in shown)
    return ["" if np.isnan(value) else text.replace("e", "E") for value, text in zip(shown, texts, strict=True)]


def write(path: str | os.PathLike[str], dataset: xr.Dataset, *, digits: int | None = None) -> None:
    """Write an export as the software does; see :func:`encode`.

    Raises
    ------
    InputError
        As :func:`encode`.
    StorageError
        The file cannot be written.
    """
    files.write_bytes(path, encode(dataset, digits=digits))

"""Datasets as tables of text, JSON and MATLAB files, for programs that read no netCDF.

Every format keeps units, long names and the provenance. Text is that of the Dataset alone, so two
exports of one result are equal byte for byte.
"""

import io
import json
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""A spreadsheet takes a cell that begins with one of these for a formula."""
_HIDDEN = re.compile(r"([;,]\s*)(?=[=+@]|-[^\d.])")
"""Where a cell would begin for a spreadsheet that splits at semicolons, whatever the quotes, or
that splits a remark; a negative number is none."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]+")
_APART = r"\1'"
_MATLAB_NAME = 63
"""Longest name of a variable in MATLAB."""
_MATLAB_HEAD = 116
"""Bytes of free text that begin a MATLAB file; by default they hold the time of day."""


def csv_tables(dataset: xr.Dataset, remarks: Mapping[str, str]) -> dict[str, str]:
    """Write a Dataset as tables, one for all variables of equal dimensions, by those: ``"time"``, ``"repeat-time"``.

    A table over several dimensions has one row per combination, with one column per dimension; variables without
    dimensions are in ``"values"``. Remarks stand above the table, one line each, after ``#``; below the head of names
    stands a row of units.

    Examples
    --------
    >>> made = csv_tables(xr.Dataset({"x": ("time", [1.0, 2.5], {"units": "m"})}), {})
    >>> print(made["time"], end="")
    time,x
    1,m
    0,1.0
    1,2.5
    """
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, variable in dataset.variables.items():
        if variable.dims != (name,):
            groups.setdefault(tuple(map(str, variable.dims)), []).append(str(name))
    for name in map(str, dataset.dims):  # a coordinate that nothing else stands over
        if name in dataset.variables and not any(name in dims for dims in groups):
            groups[name,] = []
    head = "".join(f"# {key}: {_HIDDEN.sub(_APART, one_line(value))}\n" for key, value in remarks.items())
    return {"-".join(dims) or "values": head + _table(dataset, dims, names) for dims, names in groups.items()}


def _table(dataset: xr.Dataset, dims: tuple[str, ...], names: list[str]) -> str:
    shape = tuple(dataset.sizes[dim] for dim in dims)
    titles, units, columns = [], [], []
    for axis, dim in enumerate(dims):
        has_values = dim in dataset.variables
        values = dataset[dim].values if has_values else np.arange(shape[axis])
        along = [1] * axis + [shape[axis]] + [1] * (len(dims) - axis - 1)
        titles.append(dim)
        units.append(str(dataset[dim].attrs.get("units", "1")) if has_values else "1")
        columns.append(_cells(np.broadcast_to(values.reshape(along), shape)))
    for name in names:
        variable = dataset[name]
        titles.append(name)
        units.append(str(variable.attrs.get("units", "")))
        columns.append(_cells(variable.values))
    rows = [_row(titles), _row(units), *map(",".join, zip(*columns, strict=True))]
    return "\n".join(rows) + "\n"


def _cells(values: NDArray[Any]) -> list[str]:
    flat = np.asarray(values).ravel()
    if flat.dtype.kind == "f":
        return [repr(value) for value in flat.tolist()]
    if flat.dtype.kind in "iu":
        return [str(value) for value in flat.tolist()]
    if flat.dtype.kind == "b":
        return ["1" if value else "0" for value in flat.tolist()]
    return [text_cell(str(value)) for value in flat.tolist()]


def _row(texts: Iterable[str]) -> str:
    return ",".join(map(text_cell, texts))


def text_cell(text: str) -> str:
    """Write a text as a cell of csv that no spreadsheet takes for a formula, wherever it splits.

    Examples
    --------
    >>> text_cell("=1+1"), text_cell("a;=1+1")
    ("'=1+1", "a;'=1+1")
    """
    text = _HIDDEN.sub(_APART, one_line(text))
    if text.startswith(_FORMULA):
        text = "'" + text
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"') else text


def one_line(text: str) -> str:
    """Replace line ends and control characters by blanks."""
    return _CONTROL.sub(" ", text)


def json_text(dataset: xr.Dataset, remarks: Mapping[str, str]) -> str:
    """Write a Dataset as one JSON document; NaN and infinities become null.

    It has ``remarks``, ``dimensions`` (sizes by name), ``attributes``, and ``variables``: for each
    ``dimensions``, ``units``, ``long_name``, further attributes, and nested ``values``.
    """
    variables = {
        str(name): {
            "dimensions": list(map(str, variable.dims)),
            **{str(k): _plain(v) for k, v in variable.attrs.items()},
            "values": _plain(variable.values),
        }
        for name, variable in dataset.variables.items()
    }
    document = {
        "remarks": dict(remarks),
        "dimensions": {str(k): v for k, v in dataset.sizes.items()},
        "attributes": {str(k): _plain(v) for k, v in dataset.attrs.items()},
        "variables": variables,
    }
    return json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def _plain(value: Any) -> Any:
    """Turn numpy's values into Python's; what JSON has no number for becomes null."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | bool) or value is None else str(value)


def mat_bytes(dataset: xr.Dataset, remarks: Mapping[str, str]) -> bytes:
    """Write a Dataset as a MATLAB file (version 5, readable by MATLAB, Octave and Julia).

    It has one array per variable; structures ``units``, ``long_name`` and ``dimensions`` with a text
    per variable; ``remarks``. Names are cut to what MATLAB takes.
    """
    from scipy.io import savemat

    names = _matlab_names(map(str, dataset.variables))
    content: dict[str, Any] = {}
    for name, short in names.items():
        values = dataset[name].values
        content[short] = values.astype(object) if values.dtype.kind in "OU" else values
    for key in ("units", "long_name"):
        content[key] = {n: str(dataset[v].attrs.get(key, "")) for v, n in names.items()}
    content["dimensions"] = {n: ", ".join(map(str, dataset[v].dims)) for v, n in names.items()}
    content["remarks"] = {short: remarks[key] for key, short in _matlab_names(remarks, ()).items()} or ""
    stream = io.BytesIO()
    savemat(stream, content, long_field_names=True, oned_as="column", do_compression=True)
    head = b"MATLAB 5.0 MAT-file, written by labpipe".ljust(_MATLAB_HEAD)
    return head + stream.getvalue()[_MATLAB_HEAD:]


_TAKEN = ("units", "long_name", "dimensions", "remarks")


def _matlab_names(names: Iterable[str], taken: Iterable[str] = _TAKEN) -> dict[str, str]:
    """Give every name one that MATLAB accepts, all of them different."""
    found: dict[str, str] = {}
    used = set(taken)
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = (plain if plain[:1].isalpha() else f"x{plain}")[:_MATLAB_NAME]
        number, wanted = 2, plain
        while plain in used:
            plain, number = f"{wanted[: _MATLAB_NAME - 4]}_{number}", number + 1
        used.add(plain)
        found[name] = plain
    return found

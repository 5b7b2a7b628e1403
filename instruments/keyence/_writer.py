"""Keyence storage files as a controller would write them, in the assumed layout."""

import os
import re
from collections.abc import Mapping
from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from instruments.keyence._markers import Layout, Status
from labpipe import files
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.units import quantity, unit
from labpipe.variables import described, variable

DEVICE = "Keyence laser displacement sensor"
_WIDTH = 8  # characters of a reading: sign, digits, decimal sign

#: The cell of each state without a reading.
TOKENS = {
    Status.RANGEOVER_P: "+FFFFFFF",
    Status.RANGEOVER_N: "-FFFFFFF",
    Status.WAITING: "-------",
    Status.ALARM: "alarm",
    Status.INVALID: "Invalid",
    Status.SUSPECT: "FFFFFFF",
}


def output_variables(
    output: int, unit_text: str, values: Floats, status: NDArray[np.int8], written: Layout | None
) -> dict[str, Any]:
    """Make the variables of one output: its readings in SI, and their states."""
    known = unit(unit_text)
    attrs: dict[str, Any] = described(known.si, f"OUT{output}", original_unit=unit_text)
    if written is not None:
        attrs["decimals"] = written.decimals
        attrs["resolution"] = known.factor * 10.0**-written.decimals
    states, names = [int(state) for state in Status], " ".join(state.name for state in Status)
    flags = described("1", f"state of OUT{output}", flag_values=states, flag_meanings=names)
    return {
        f"out{output}": ("time", values * known.factor, attrs),
        f"status{output}": ("time", status.astype(np.int8), flags),
    }


def make_recording(
    outputs: Mapping[int, Floats],
    *,
    cycle: str | float,
    start: datetime,
    storage_factor: int = 1,
    unit_text: str = "mm",
    decimals: int = 4,
    measuring_range: float | None = None,
    averaging: int = 1,
    model: str = "LK-G5001",
    serial: str = "",
) -> xr.Dataset:
    """Make the Dataset that :func:`read` would return for these readings, for :func:`write`.

    Parameters
    ----------
    outputs : mapping
        Number of the output to its readings in SI, one per stored point.
    cycle : str or float
        Time between samples, ``"50 us"`` or s.
    start : datetime
        Written as the date.
    storage_factor, averaging : int
        As set on the controller.
    unit_text, decimals : str and int
        Of the display: readings are rounded to it.
    measuring_range : float, optional [SI]
        Readings beyond ± this value are over range.
    model, serial : str
        Of the controller.

    Examples
    --------
    >>> made = make_recording({1: np.array([1e-3, 9e-3])}, cycle="50 us",
    ...                       start=datetime(2024, 5, 14), measuring_range=5e-3)
    >>> made.status1.values.tolist()
    [0, 1]
    """
    interval = quantity(cycle).value if isinstance(cycle, str) else float(cycle)
    factor, limit = unit(unit_text).factor, np.inf if measuring_range is None else measuring_range
    variables: dict[str, Any] = {}
    for output, readings in outputs.items():
        shown = np.round(np.asarray(readings, float) / factor, decimals)
        status = np.where(shown > limit / factor, Status.RANGEOVER_P, Status.VALID).astype(np.int8)
        status[shown < -limit / factor] = Status.RANGEOVER_N
        shown = np.where(status == Status.VALID, shown, np.nan)
        variables |= output_variables(output, unit_text, shown, status, Layout(True, 6 - decimals, decimals))
    time = np.arange(len(next(iter(outputs.values())))) * (interval * storage_factor)
    attrs: dict[str, Any] = {"instrument": DEVICE, "model": model, "start": start.isoformat()}
    attrs |= {"serial": serial} if serial else {}
    attrs |= {"sampling_cycle": interval, "storage_factor": storage_factor, "averaging": averaging, "layout": "assumed"}
    attrs["sampling_interval"] = interval * storage_factor
    return xr.Dataset(variables, {"time": variable("time", time, "s", "time from the first point")}, attrs)


def encode(dataset: xr.Dataset) -> bytes:
    """Turn a Dataset of the form of :func:`read` into the bytes of a storage file (UTF-8 with its mark, commas, CRLF).

    InputError where a value does not fit the eight characters of a reading, or an output does not state its unit.
    """
    outputs = sorted(int(name[3:]) for name in map(str, dataset.data_vars) if re.fullmatch(r"out\d+", name))
    units, columns = [], []
    for output in outputs:
        found = dataset[f"out{output}"]
        if "original_unit" not in found.attrs:  # arithmetic drops attributes in older xarray and keeps them in newer
            text = f"out{output} has no attribute original_unit, so its readings cannot be written; state it: "
            raise InputError(f'{text}dataset["out{output}"].attrs["original_unit"] = "mm"')
        units.append(str(found.attrs["original_unit"]))
        shown, states = found.values / unit(units[-1]).factor, dataset[f"status{output}"].values
        cells = [f"{value:+0{_WIDTH}.{int(found.attrs.get('decimals', 4))}f}" for value in shown.tolist()]
        for index in np.flatnonzero(states != Status.VALID):
            cells[index] = TOKENS[Status(states[index])]
        misfit = next((cell for cell in cells if len(cell) > _WIDTH), "")
        if misfit or "+0000nan" in cells:
            text = misfit or "NaN with the state VALID"
            raise InputError(f"OUT{output}: {text} does not fit the {_WIDTH} characters of a reading")
        columns.append(cells)
    attrs, count = dataset.attrs, dataset.sizes["time"]
    lines = [
        ("Remark", "assumed layout"),
        *((key.title(), attrs[key]) for key in ("model", "serial", "head") if attrs.get(key)),
        *([("Date", attrs["start"].replace("T", " ").replace("-", "/"))] if attrs["start"] else []),
        ("Sampling cycle", f"{attrs['sampling_cycle'] * 1e6:.6g}us"),
        ("Storage cycle", f"x{attrs['storage_factor']}"),
        *([("Averaging", str(attrs["averaging"]))] if "averaging" in attrs else []),
        ("Data count", str(count)),
        ("Unit", *units),
        ("No.", *(f"OUT{output}" for output in outputs)),
        *zip(map(str, range(1, count + 1)), *columns, strict=True),
    ]
    return ("\r\n".join(map(",".join, lines)) + "\r\n").encode("utf-8-sig")


def write(path: str | os.PathLike[str], dataset: xr.Dataset) -> None:
    """Write a Dataset of the form of :func:`read` as :func:`encode` does; StorageError where it cannot be written."""
    files.write_bytes(path, encode(dataset))

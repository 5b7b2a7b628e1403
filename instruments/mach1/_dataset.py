"""Mach-1 blocks to one Dataset in SI, with the metadata of the blocks as JSON."""

import json
import math
import re
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from instruments._clock import moment
from instruments.mach1._blocks import DECLARED, Block, Column, Parameter
from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError
from labpipe.text import is_number, shorten
from labpipe.variables import described, variable

DEVICE = "Biomomentum Mach-1"

MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_DATE = re.compile(r"(?:[A-Za-z]{3}, )?([A-Za-z]{3}) ([0-9]{1,2}), ([0-9]{4})")

#: Compression times this sign is the force of the file, by the type of load cell.
COMPRESSION_SIGN = {"Multiple-axis": -1, "Single-axis": 1}


def assemble(blocks: Sequence[Block], decimal: str = ".") -> xr.Dataset:
    """Join blocks to one Dataset in SI, of the form that :func:`read` returns.

    Parameters
    ----------
    blocks : sequence of Block
        As parsed, or made by :func:`make_block`.
    decimal : str
        Of numbers in the header that are kept as text.

    Raises
    ------
    InputError
        There are none, or one quantity has units of two kinds.
    """
    if not blocks:
        raise InputError("a Mach-1 file has at least one block, found none")
    counts = [len(block.values) for block in blocks]
    starts = np.concatenate([[0], np.cumsum(counts)])
    total = int(starts[-1])
    columns: dict[str, tuple[Floats, Column]] = {}
    for block, first in zip(blocks, starts[:-1], strict=True):
        for index, column in enumerate(block.columns):
            name = variable_name(column.quantity)
            values, known = columns.setdefault(name, (np.full(total, np.nan), column))
            if known.unit.si != column.unit.si:
                raise InputError(f'"{column.header}" is in {column.unit.si}, before in {known.unit.si}')
            values[first : first + len(block.values)] = block.values[:, index] * column.unit.factor
    time, _ = columns.pop("time", (np.empty(0), None))
    dataset = xr.Dataset(
        {name: _variable(values, column) for name, (values, column) in columns.items()},
        coords={
            "time": variable("sample", time, "s", "time within the block"),
            "block": ("sample", np.repeat(np.arange(len(blocks)), counts), described("1", "block")),
            "segment": ("sample", _segments(blocks), described("1", "dividers so far in the block")),
        },
        attrs=_file_attributes(blocks, decimal),
    )
    return dataset.assign(_block_variables(blocks))


def _variable(values: Floats, column: Column) -> tuple[Any, ...]:
    attrs = described(column.unit.si, column.quantity, original_unit=column.unit_text)
    return "sample", values, attrs


def variable_name(quantity: str) -> str:
    """Name the variable of a column.

    Examples
    --------
    >>> variable_name("Position (z)"), variable_name("Fz"), variable_name("Tx")
    ('position_z', 'force_z', 'torque_x')
    """
    axis = re.fullmatch(r"([FT])([xyz])", quantity)
    if axis:
        return f"{'force' if axis[1] == 'F' else 'torque'}_{axis[2]}"
    return re.sub(r"[^a-z0-9]+", "_", quantity.lower()).strip("_") or "unnamed"


def _segments(blocks: Sequence[Block]) -> Integers:
    parts = [
        np.searchsorted(np.asarray(block.dividers), np.arange(len(block.values)), side="right") for block in blocks
    ]
    return np.concatenate(parts).astype(np.int64)


def _block_variables(blocks: Sequence[Block]) -> dict[str, Any]:
    def over_blocks(values: object, long_name: str, units: str = "1") -> tuple[Any, ...]:
        return "block_index", np.asarray(values), described(units, long_name)

    variables = {
        "function": ("block_index", np.array([block.function for block in blocks])),
        "start_time": ("block_index", np.array([start_of(block) for block in blocks])),
        "n_rows": over_blocks([len(block.values) for block in blocks], "rows of the block"),
        "sampling_interval": over_blocks([_interval(block) for block in blocks], "sampling interval", "s"),
        "compression_sign": over_blocks(
            [_compression_sign(block) for block in blocks],
            "sign of compression in force_z, 0 when the header does not state it",
        ),
        "is_complete": over_blocks(
            [int(block.is_complete) for block in blocks], "1 when the block is ended in the file"
        ),
    }
    for name in dict.fromkeys(DECLARED.values()):
        found = [_declared(block, name) for block in blocks]
        units = {parameter.unit.si for parameter in found if parameter and parameter.unit}
        if len(units) == 1:
            values = [_si_value(parameter) for parameter in found]
            long_name = name.replace("_", " ") + " (a command, not a measurement)"
            variables[name] = over_blocks(values, long_name, units.pop())
    return variables


def _declared(block: Block, name: str) -> Parameter | None:
    for parameter in block.parameters:
        if DECLARED.get(_base(parameter.key)) == name:
            return parameter
    return None


def _base(key: str) -> str:
    name, separator, _ = key.rpartition(", ")
    return name if separator else key


def _si_value(parameter: Parameter | None) -> float:
    if parameter is None or parameter.number is None or parameter.unit is None:
        return math.nan
    return parameter.number * parameter.unit.factor


def _interval(block: Block) -> float:
    time = block.values[:, 0] if block.columns else np.empty(0)
    return float((time[-1] - time[0]) / (len(time) - 1)) if len(time) > 1 else math.nan


def _compression_sign(block: Block) -> int:
    return COMPRESSION_SIGN.get(dict(block.info).get("Load Cell Type", ""), 0)


def start_of(block: Block) -> str:
    """Return the ISO start of a block, or "" when the header's date is not in the known form."""
    info = dict(block.info)
    date, clock = info.get("Date", ""), info.get("Time", "")
    named = _DATE.fullmatch(date)
    if named and named[1].title() in MONTHS:
        date = f"{named[3]}-{MONTHS.index(named[1].title()) + 1:02d}-{int(named[2]):02d}"
    start = moment(f"{date} {clock}") if clock else None
    return "" if start is None else start.isoformat(timespec="milliseconds")


def _file_attributes(blocks: Sequence[Block], decimal: str) -> dict[str, Any]:
    attrs: dict[str, Any] = {
        "instrument": DEVICE,
        "header": "\n".join(_header_text(block) for block in blocks),
        "blocks": json.dumps([_describe(block, decimal) for block in blocks], ensure_ascii=False),
        "start": start_of(blocks[0]),
        "clock": "local wall clock without a zone",
        "incomplete": int(not all(block.is_complete for block in blocks)),
    }
    signs = {_compression_sign(block) for block in blocks if block.has_data}
    if len(signs) == 1 and 0 not in signs:
        attrs["compression_sign"] = signs.pop()
    return attrs


def _header_text(block: Block) -> str:
    return "\n".join(["<INFO>", *block.info_lines, "<END INFO>", f"<{block.function}>", *block.parameter_lines])


def _describe(block: Block, decimal: str) -> dict[str, Any]:
    """Put everything that a block says of itself into plain JSON types."""
    info = dict(block.info)
    keys = ("Name", "Type", "Calibration Factor", "Offset", "Calibration Date")
    return {
        "function": block.function,
        "start": start_of(block),
        "info_lines": block.info_lines,
        "parameter_lines": block.parameter_lines,
        "info": info,
        "parameters": [
            {
                "key": parameter.key,
                "text": parameter.text,
                "value": _si_or_none(parameter),
                "units": parameter.unit.si if parameter.unit else None,
            }
            for parameter in block.parameters
        ],
        "columns": [
            {
                "header": column.header,
                "variable": variable_name(column.quantity),
                "unit": column.unit_text,
                "factor": column.unit.factor,
            }
            for column in block.columns
        ],
        "rows": len(block.values),
        "dividers": block.dividers,
        "sampling_interval": None if math.isnan(_interval(block)) else _interval(block),
        "load_cell": {key.lower().replace(" ", "_"): info.get(f"Load Cell {key}") for key in keys},
        "filter": _filter(info, decimal),
        "images_folder": info.get("Captured Images Folder"),
        "compression_sign": _compression_sign(block),
        "has_data": block.has_data,
        "incomplete": not block.is_complete,
    }


def _si_or_none(parameter: Parameter) -> float | None:
    value = _si_value(parameter)
    return None if math.isnan(value) else value


def _filter(info: Mapping[str, str], decimal: str) -> dict[str, float | int] | None:
    """Order and cutoff [Hz] of the low-pass, or None when the header declares none."""
    if info.get("Load Cell Low-pass filter") != "Yes":
        return None
    order = info.get("Load Cell Low-pass filter Order", "")
    cutoff = info.get("Load Cell Low-pass filter Cutoff frequency (Hz)", "").replace(decimal, ".")
    if is_number(cutoff) and float(cutoff) > 0 and re.fullmatch("[1-9]", order.strip()):
        return {"order": int(order), "cutoff": float(cutoff)}
    stated = f"of order {shorten(order)} and cutoff {shorten(cutoff)} Hz"
    text = f"the header declares a low-pass filter {stated}; the readings cannot be corrected for it"
    warnings.warn(text, UserWarning, stacklevel=2)
    return None

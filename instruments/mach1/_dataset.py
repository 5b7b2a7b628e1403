"""Biomomentum Mach-1 Motion text files: blocks of time, position and force, to a Dataset and back.

- Force is in N or in gram-force per column, already low-passed (as its header declares), and not tared.
- A six-axis cell counts compression negative, a single-axis cell positive: it is ``compression_sign * force_z``.
- Time restarts at zero in every block; ``start_time`` is a local wall clock without a zone.
- The declared frequency and amplitude are commands, not the motion of the stage: fit them.
"""

import json
import math
import os
import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from instruments._clock import moment
from instruments.mach1._blocks import DECLARED, DIVIDER, END_DATA, TITLE, Block, Column, Cursor, parse, parts_of
from labpipe import files
from labpipe.arrays import Floats
from labpipe.errors import InputError, warn_of
from labpipe.text import check_decimal, is_number, shorten, survey
from labpipe.variables import variable

DEVICE = "Biomomentum Mach-1"

COMPRESSION_SIGN = {"Multiple-axis": -1, "Single-axis": 1}  # times compression is the force of the file


def read(path: str | os.PathLike[str], *, decimal: str | None = None, allow_incomplete: bool = False) -> xr.Dataset:
    """Read a Mach-1 Motion text file; SourceError names file, line and column of a departure from the format.

    Parameters
    ----------
    path : path-like
        The file.
    decimal : str, optional
        ``","`` for a file in which dots were replaced; the instrument writes a dot.
    allow_incomplete : bool
        Read a file that stops early, its last block marked, its cut row dropped, with a warning; else it is refused.

    Returns
    -------
    Dataset
        Over ``sample``: coordinates ``time`` [s] (within the block), ``block``, ``segment`` (dividers so far);
        ``position_z`` [m], ``position_theta`` [rad], ``force_z`` [N], ``torque_x`` [N m], … as present, NaN in blocks
        without the column. Over ``block_index``: ``function``, ``start_time``, ``n_rows``, ``sampling_interval`` [s],
        ``compression_sign``, ``declared_…``. Attributes: ``header``, ``blocks`` (JSON, everything), ``start``,
        ``compression_sign`` when all blocks agree.
    """
    check_decimal(decimal)
    source = survey(path, declared=("latin-1",))
    blocks = parse(Cursor(source, decimal or ".", allow_incomplete))
    if unknown := ", ".join(str(number) for number, block in enumerate(blocks) if not start_of(block)):
        text = f'date and time of block {unknown} are not of the form "Wed, Jul 19, 2023" and "12:14:21.065"'
        warn_of(source.path, f"{text}; the start is left empty")
    dataset = assemble(blocks)
    work = {"bytes_read": source.size, "blocks": len(blocks), "rows_read": int(dataset.sizes["sample"])}
    dataset.attrs |= {"source": Path(path).name, "encoding": source.encoding, "work": json.dumps(work)}
    return dataset


def assemble(blocks: Sequence[Block]) -> xr.Dataset:
    """Join blocks to one Dataset of the form of :func:`read`; InputError where a quantity has units of two kinds."""
    counts = [len(block.values) for block in blocks]
    starts = np.concatenate([[0], np.cumsum(counts)])
    columns: dict[str, tuple[Floats, Column]] = {}
    for block, first in zip(blocks, starts[:-1], strict=True):
        for index, column in enumerate(block.columns):
            values, known = columns.setdefault(variable_name(column.quantity), (np.full(starts[-1], np.nan), column))
            if known.unit.si != column.unit.si:
                raise InputError(f'"{column.header}" is in {column.unit.si}, before in {known.unit.si}')
            values[first : first + len(block.values)] = block.values[:, index] * column.unit.factor
    time, _ = columns.pop("time", (np.empty(0), None))
    segments = [np.searchsorted(block.dividers, np.arange(n), "right") for block, n in zip(blocks, counts, strict=True)]
    described_columns = {
        name: variable("sample", values, column.unit.si, column.quantity, original_unit=column.unit_text)
        for name, (values, column) in columns.items()
    }
    described_blocks = [_describe(block) for block in blocks]
    attrs: dict[str, Any] = {
        "instrument": DEVICE,
        "header": "\n".join(line for each in described_blocks for line in _lines_above(each)),
        "blocks": json.dumps(described_blocks, ensure_ascii=False),
        "start": start_of(blocks[0]),
        "clock": "local wall clock without a zone",
        "incomplete": int(not all(block.is_complete for block in blocks)),
    }
    signs = {each["compression_sign"] for each in described_blocks if each["has_data"]}
    if len(signs) == 1 and 0 not in signs:
        attrs["compression_sign"] = signs.pop()
    segment = np.concatenate(segments).astype(np.int64)
    coords = {
        "time": variable("sample", time, "s", "time within the block"),
        "block": variable("sample", np.repeat(np.arange(len(blocks)), counts), "1", "block"),
        "segment": variable("sample", segment, "1", "dividers so far in the block"),
    }
    return xr.Dataset({**described_columns, **_block_variables(blocks, described_blocks)}, coords, attrs)


def variable_name(quantity: str) -> str:
    """Name the variable of a column."""
    if axis := re.fullmatch(r"([FT])([xyz])", quantity):
        return f"{'force' if axis[1] == 'F' else 'torque'}_{axis[2]}"
    return re.sub(r"[^a-z0-9]+", "_", quantity.lower()).strip("_") or "unnamed"


def _block_variables(blocks: Sequence[Block], described_blocks: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Make the variables over blocks: rows, interval, sign, completeness, and the numbers that functions declare."""
    sign = "sign of compression in force_z, 0 when the header does not state it"
    found: dict[str, tuple[list[Any], str, str]] = {
        "n_rows": ([each["rows"] for each in described_blocks], "1", "rows of the block"),
        "sampling_interval": ([each["sampling_interval"] for each in described_blocks], "s", "sampling interval"),
        "compression_sign": ([each["compression_sign"] for each in described_blocks], "1", sign),
        "is_complete": ([int(block.is_complete) for block in blocks], "1", "1 when the block is ended in the file"),
    }
    for name in dict.fromkeys(DECLARED.values()):
        stated = [next((p for p in b.parameters if DECLARED.get(parts_of(p.key)[0]) == name), None) for b in blocks]
        units = {p.unit.si for p in stated if p and p.unit}
        if len(units) == 1:
            values = [p.number * p.unit.factor if p and p.unit and p.number is not None else None for p in stated]
            found[name] = values, units.pop(), name.replace("_", " ") + " (a command, not a measurement)"
    made: dict[str, Any] = {
        name: variable("block_index", np.array([math.nan if v is None else v for v in values]), units, text)
        for name, (values, units, text) in found.items()
    }
    for name, key in (("function", "function"), ("start_time", "start")):
        made[name] = ("block_index", np.array([each[key] for each in described_blocks]))
    return made


def start_of(block: Block) -> str:
    """Return the ISO start of a block, or "" when the header's date is not in the known form."""
    date, clock = block.info.get("Date", ""), block.info.get("Time", "")
    start = moment(f"{date} {clock}") if clock else None
    return "" if start is None else start.isoformat(timespec="milliseconds")


def _describe(block: Block) -> dict[str, Any]:
    """Put the whole description of a block into plain JSON types; NaN is None."""
    info = block.info
    time = block.values[:, 0] if block.columns else np.empty(0)
    low_pass: dict[str, float | int] | None = None  # order and cutoff [Hz], where the header declares them
    if info.get("Load Cell Low-pass filter") == "Yes":
        order = info.get("Load Cell Low-pass filter Order", "")
        cutoff = info.get("Load Cell Low-pass filter Cutoff frequency (Hz)", "").replace(",", ".")
        if is_number(cutoff) and float(cutoff) > 0 and re.fullmatch("[1-9]", order.strip()):
            low_pass = {"order": int(order), "cutoff": float(cutoff)}
        else:
            text = f"the header declares a low-pass filter of order {shorten(order)} and cutoff {shorten(cutoff)} Hz"
            warnings.warn(f"{text}; the readings cannot be corrected for it", UserWarning, stacklevel=2)
    keys = ("Name", "Type", "Calibration Factor", "Offset", "Calibration Date")
    columns = [
        {"header": c.header, "variable": variable_name(c.quantity), "unit": c.unit_text, "factor": c.unit.factor}
        for c in block.columns
    ]
    parameters = [
        {"key": key, "text": text, "value": known and (number or 0.0) * known.factor, "units": known and known.si}
        for key, text, number, known in block.parameters
    ]
    return {
        "function": block.function,
        "start": start_of(block),
        "info_lines": block.info_lines,
        "parameter_lines": block.parameter_lines,
        "info": info,
        "parameters": parameters,
        "columns": columns,
        "rows": len(block.values),
        "dividers": block.dividers,
        "sampling_interval": float((time[-1] - time[0]) / (len(time) - 1)) if len(time) > 1 else None,
        "load_cell": {key.lower().replace(" ", "_"): info.get(f"Load Cell {key}") for key in keys},
        "filter": low_pass,
        "images_folder": info.get("Captured Images Folder"),
        "compression_sign": COMPRESSION_SIGN.get(info.get("Load Cell Type", ""), 0),
        "has_data": block.has_data,
        "incomplete": not block.is_complete,
    }


def _lines_above(block: Mapping[str, Any]) -> list[str]:
    """Return the lines of a block above its data."""
    return ["<INFO>", *block["info_lines"], "<END INFO>", f"<{block['function']}>", *block["parameter_lines"]]


def encode(dataset: xr.Dataset) -> bytes:
    """Turn a Dataset of the form of :func:`read` into a Mach-1 file; one that was read comes out byte for byte."""
    lines = [TITLE]
    starts = np.concatenate([[0], np.cumsum(dataset["n_rows"].values)]).astype(int)
    for index, block in enumerate(json.loads(dataset.attrs["blocks"])):
        lines += _lines_above(block)
        if not block["has_data"]:
            continue
        lines.append("<DATA>")
        if columns := block["columns"]:
            part = slice(starts[index], starts[index + 1])
            values = np.column_stack([dataset[each["variable"]].values[part] / each["factor"] for each in columns])
            rows = ["\t".join(["%.6f"] * len(columns)) % tuple(row) for row in values.tolist()]
            for position in reversed(block["dividers"]):
                rows.insert(position, DIVIDER)
            lines += ["\t".join(each["header"] for each in columns), *rows]
        lines.append(END_DATA)
    return ("\r\n".join(lines) + "\r\n").encode(dataset.attrs.get("encoding", "latin-1"))


def write(path: str | os.PathLike[str], dataset: xr.Dataset) -> None:
    """Write a Dataset of the form of :func:`read` as a Mach-1 file; StorageError where it cannot be written."""
    files.write_bytes(Path(path), encode(dataset))

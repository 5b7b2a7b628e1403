"""Biomomentum Mach-1 Motion text files: blocks of time, position and force, to a Dataset and back.

The grammar is in :mod:`instruments.mach1._blocks`. Facts of the instrument that matter here:

- force is in N or in gram-force per column, already low-passed (as its header declares), and not
  tared;
- a six-axis cell counts compression negative, a single-axis cell positive. The reader keeps the
  sign of the file and says which it is in ``compression_sign``: compression is
  ``compression_sign * force_z``;
- time restarts at zero in every block; ``start_time`` is a local wall clock without a zone;
- the declared frequency and amplitude are commands, not what the stage did: fit them.
"""

import json
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from instruments.mach1._blocks import DIVIDER, TITLE, Block, parse
from instruments.mach1._dataset import assemble, start_of
from instruments.mach1._lines import END_DATA, Options
from labpipe import files
from labpipe.errors import warn_of
from labpipe.text import Limits, check_decimal, survey

_CELL, _WITH_COMMA = re.compile(r"-?[0-9]+([.,][0-9]+)?"), re.compile(r"-?[0-9]+,[0-9]{4,}")


def read(
    path: str | os.PathLike[str],
    *,
    decimal: str | None = None,
    allow_incomplete: bool = False,
    allow_gaps: bool = False,
    limits: Limits | None = None,
) -> xr.Dataset:
    """Read a Mach-1 Motion text file.

    Parameters
    ----------
    path : path-like
        The file.
    decimal : str
        ``","`` for a file that a spreadsheet has rewritten; the instrument writes a dot. By default
        a comma is taken where the first row of readings has it with more digits than thousands have.
    allow_incomplete : bool
        Read a file that stops early; its last block is marked, its cut row dropped, and a warning
        given. By default such a file is refused.
    allow_gaps : bool
        Read blocks in which rows are missing, by the times they carry. By default refused.
    limits : Limits, optional
        Size limits.

    Returns
    -------
    Dataset
        Over ``sample``: coordinates ``time`` [s] (within the block), ``block``, ``segment``
        (dividers so far); variables ``position_z`` [m], ``position_theta`` [rad], ``force_z`` [N],
        ``torque_x`` [N m], … as present, NaN in blocks without the column. Over ``block_index``:
        ``function``, ``start_time``, ``n_rows``, ``sampling_interval`` [s],
        ``compression_sign``, and ``declared_…`` numbers. Attributes: ``header`` (its text),
        ``blocks`` (JSON, everything), ``start``, ``compression_sign`` when all blocks agree.

    Raises
    ------
    SourceError
        With file, line and column of what departs from the format.

    Examples
    --------
    >>> readings = read("sinusoid.txt")  # doctest: +SKIP
    >>> readings.force_z.attrs["units"]  # doctest: +SKIP
    'N'
    """
    check_decimal(decimal)
    source = survey(path, declared=("latin-1",), limits=limits or Limits())
    decimal = decimal or _decimal_of(source.lines())
    blocks = parse(source, Options(decimal, allow_incomplete, allow_gaps))
    _note_unknown_starts(source.path, blocks)
    dataset = assemble(blocks, decimal)
    n_rows = int(dataset.sizes["sample"])
    work = {"bytes_read": source.size, "blocks": len(blocks), "rows_read": n_rows}
    dataset.attrs |= {"source": Path(path).name, "encoding": source.encoding, "work": json.dumps(work)}
    return dataset


def _decimal_of(lines: Iterable[str]) -> str:
    """Return the decimal sign of the first row of readings."""
    for line in lines:
        cells = [cell.strip('"') for cell in re.split("[\t;]", line.strip())]
        if len(cells) > 1 and all(map(_CELL.fullmatch, cells)):
            return "," if any(map(_WITH_COMMA.fullmatch, cells)) else "."
    return "."


def _note_unknown_starts(path: Path, blocks: list[Block]) -> None:
    unknown = [str(number) for number, block in enumerate(blocks) if not start_of(block)]
    if unknown:
        warn_of(
            path,
            f"date and time of block {', '.join(unknown)} are not of the form "
            '"Wed, Jul 19, 2023" and "12:14:21.065"; the start is left empty',
        )


def encode(dataset: xr.Dataset) -> bytes:
    """Turn a Dataset of the form of :func:`read` into the bytes of a Mach-1 file.

    Parameters
    ----------
    dataset : Dataset
        As from :func:`read` or :func:`assemble`.

    Returns
    -------
    bytes
        CRLF, tabs, six decimals; what was read from a file comes out byte for byte.
    """
    lines = [TITLE]
    starts = np.concatenate([[0], np.cumsum(dataset["n_rows"].values)]).astype(int)
    for index, block in enumerate(json.loads(dataset.attrs["blocks"])):
        lines += ["<INFO>", *block["info_lines"], "<END INFO>"]
        lines += [f"<{block['function']}>", *block["parameter_lines"]]
        if block["has_data"]:
            rows = slice(starts[index], starts[index + 1])
            lines += ["<DATA>", *_data_lines(dataset, block, rows), END_DATA]
    text = "\r\n".join(lines) + "\r\n"
    return text.encode(dataset.attrs.get("encoding", "latin-1"))


def _data_lines(dataset: xr.Dataset, block: Mapping[str, Any], rows: slice) -> list[str]:
    columns = block["columns"]
    if not columns:
        return []
    values = np.column_stack([dataset[column["variable"]].values[rows] / column["factor"] for column in columns])
    pattern = "\t".join(["%.6f"] * len(columns))
    lines = [pattern % tuple(row) for row in values.tolist()]
    for position in reversed(block["dividers"]):
        lines.insert(position, DIVIDER)
    return ["\t".join(column["header"] for column in columns), *lines]


def write(path: str | os.PathLike[str], dataset: xr.Dataset) -> None:
    """Write a Dataset of the form of :func:`read` as a Mach-1 file.

    Raises
    ------
    StorageError
        The file cannot be written.
    """
    files.write_bytes(Path(path), encode(dataset))

"""Keyence storage files as a controller would write them, in the assumed layout."""

import os
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime

import numpy as np

from instruments.keyence._markers import Status
from labpipe import files
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.units import Measure, si, unit

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


def encode(
    outputs: Mapping[int, Floats],
    *,
    cycle: Measure,
    start: datetime,
    storage_factor: int = 1,
    averaging: int = 1,
    unit_text: str = "mm",
    decimals: int = 4,
    measuring_range: float = np.inf,
) -> bytes:
    """Return the bytes of a storage file (UTF-8 with its mark, commas, CRLF).

    ``outputs`` holds the readings of each output in SI, one per stored point, NaN where there is none. They are rounded
    to the display's ``unit_text`` and ``decimals`` (InputError where one does not fit its eight characters), and over
    range beyond ± ``measuring_range`` [SI]; ``cycle`` is the time between samples, such as ``"50 us"``.
    """
    columns, known = [], unit(unit_text)
    for output, readings in sorted(outputs.items()):
        shown = np.round(np.asarray(readings, float) / known.factor, decimals)
        ranges = np.isnan(shown), shown > measuring_range / known.factor, shown < -measuring_range / known.factor
        states = np.select(ranges, (Status.WAITING, Status.RANGEOVER_P, Status.RANGEOVER_N), Status.VALID)
        pairs = zip(shown.tolist(), states.tolist(), strict=True)
        columns.append([cell_of(value, state, decimals, _WIDTH) for value, state in pairs])
        if misfit := next((cell for cell in columns[-1] if len(cell) > _WIDTH), ""):
            raise InputError(f"OUT{output}: {misfit} does not fit the {_WIDTH} characters of a reading")
    count, sampling = len(columns[0]), si(cycle, "s", "cycle")
    settings = (("Averaging", str(averaging)), ("Data count", str(count)))
    head = head_lines(sorted(outputs), [unit_text] * len(outputs), start, sampling, storage_factor, settings)
    head.insert(1, ("Model", "LK-G5001"))
    return text_of([*head, *zip(map(str, range(1, count + 1)), *columns, strict=True)]).encode("utf-8-sig")


def head_lines(
    outputs: Sequence[int],
    units: Sequence[str],
    start: datetime,
    cycle: float,
    factor: int = 1,
    settings: Iterable[Sequence[str]] = (),
) -> list[Sequence[str]]:
    """Return the cells of the lines above the readings; ``cycle`` [s] is the time between samples."""
    return [
        ("Remark", "assumed layout"),
        ("Date", f"{start:%Y/%m/%d %H:%M:%S}"),
        ("Sampling cycle", f"{cycle * 1e6:.6g}us"),
        ("Storage cycle", f"x{factor}"),
        *settings,
        ("Unit", *units),
        ("No.", *(f"OUT{output}" for output in outputs)),
    ]


def cell_of(value: float, state: int, decimals: int, width: int) -> str:
    """Write one reading, or the token of its state."""
    return TOKENS[Status(state)] if state != Status.VALID else f"{value:+0{width}.{decimals}f}"


def text_of(lines: Iterable[Sequence[str]]) -> str:
    """Join cells by commas and end every line."""
    return "".join(f"{','.join(line)}\r\n" for line in lines)


def write(path: str | os.PathLike[str], outputs: Mapping[int, Floats], **settings: object) -> None:
    """Write a storage file of the readings and settings of :func:`encode`; StorageError where it cannot be written."""
    files.write_bytes(path, encode(outputs, **settings))  # type: ignore[arg-type]  # encode checks them

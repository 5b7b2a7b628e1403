"""Mach-1 blocks as the instrument would record them: for sample data and for tests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from instruments.mach1._blocks import Block, Column, parameter_of
from labpipe.arrays import Floats
from labpipe.text import plain_number
from labpipe.units import unit


@dataclass(frozen=True, slots=True)
class LoadCell:
    """A load cell as the header describes it, ``Single-axis`` or ``Multiple-axis``, low-passed in third order at 20 Hz.

    ``steps`` map the header cell of a column to the step of its values, in the unit of that cell.
    """

    name: str
    kind: str
    calibration_factor: float = 1.0
    offset: float = 0.0
    calibration_date: str = "2024-01-24"
    steps: Mapping[str, float] = field(default_factory=dict)


_SIX_AXES = {**dict.fromkeys(("Fx, N", "Fy, N"), 6e-4), "Fz, N": 8.5e-4}
_SIX_AXES |= dict.fromkeys(("Tx, N-mm", "Ty, N-mm", "Tz, N-mm"), 0.006003)
#: Cells met in public files, with the steps measured there.
LOAD_CELLS = {
    "17N": LoadCell("FT35537-17N", "Multiple-axis", 1.000491, 2.317150, "2023-07-19", _SIX_AXES),
    "25g": LoadCell("25g SN:0000000", "Single-axis", steps={"Fz, gf": 0.00125}),
    "25kg": LoadCell("25kg SN:0000000", "Single-axis", 1.004174, 151.5, steps={"Fz, gf": 1.506261}),
}


def make_block(
    function: str,
    start: datetime,
    columns: Mapping[str, Floats],
    parameters: Mapping[str, str],
    *,
    load_cell: LoadCell = LOAD_CELLS["25kg"],
    dividers: Sequence[int] = (),
    images_folder: str | None = None,
) -> Block:
    """Make a block for :func:`assemble` as the instrument would record it, on the steps of its stage and load cell.

    ``function`` is such as ``"Sinusoid"``, ``start`` the local wall clock; ``columns`` map header cells (``"Fz, gf"``)
    to values in SI, ``parameters`` keys to texts (``{"Frequency, Hz": "0.10000"}``); ``dividers`` are numbers of rows
    before each divider, ``images_folder`` that of the camera.
    """
    info = [
        ("Date", f"{start:%a, %b %d, %Y}"),
        ("Time", f"{start:%H:%M:%S}.{start.microsecond // 1000:03d}"),
        ("Mach-1 Motion Software Version", "4.4.0.29"),
        ("Mach-1 System S/N", "MA0000000"),
        ("Mach-1 System Model", "V500c"),
        ("Load Cell Name", load_cell.name),
        ("Load Cell Type", load_cell.kind),
        ("Load Cell Calibration Factor", f"{load_cell.calibration_factor:.6f}"),
        ("Load Cell Offset", f"{load_cell.offset:.6f}"),
        ("Load Cell Calibration Date", load_cell.calibration_date),
        ("Load Cell Low-pass filter", "Yes"),
        ("Load Cell Low-pass filter Order", "3"),
        ("Load Cell Low-pass filter Cutoff frequency (Hz)", "20.00"),
        *([("Captured Images Folder", images_folder)] if images_folder else []),
    ]
    declared = [parameter_of(key, text, plain_number(text)) for key, text in parameters.items()]
    steps = {**load_cell.steps, "Position (z)": 1e-6 if function == "Sinusoid" else 1e-4}  # mm, of the stage
    known, values = [], []
    for header, si_values in columns.items():
        quantity, _, unit_text = header.rpartition(", ")
        known.append(Column(header, quantity, unit_text, unit(unit_text)))
        written = np.asarray(si_values, float) / known[-1].unit.factor
        step = steps.get(quantity, steps.get(header))
        values.append(np.round(written if step is None else np.round(written / step) * step, 6))  # decimals of the file
    return Block(
        function,
        tuple(f"{key}:\t{value}" for key, value in info),
        tuple(f"{key}:\t{value}" for key, value in parameters.items()),
        tuple(declared),
        tuple(known),
        np.column_stack(values),
        tuple(dividers),
    )

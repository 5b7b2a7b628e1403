"""Results of the correlation program DICe: a folder of DICe_solution_*.txt, one file per frame.

The fields are the user's choice, so columns are found by their names. Pixels, y downwards. A
point that failed carries SIGMA = -1 and becomes NaN.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe import files, text
from labpipe.arrays import Floats, Integers
from labpipe.errors import SourceError, warn_of
from labpipe.text import plain_number
from labpipe.variables import variable

_FILE = re.compile(r"^DICe_solution_(-?\d+)\.txt$")
_FIELDS = {
    "DISPLACEMENT_X": ("dx", "px", "displacement to the right"),
    "DISPLACEMENT_Y": ("dy", "px", "displacement downwards"),
    "ROTATION_Z": ("rotation", "rad", "rotation"),
    "SIGMA": ("sigma", "px", "predicted standard uncertainty of the displacement"),
    "GAMMA": ("gamma", "1", "correlation residual"),
    "BETA": ("beta", "1", "sensitivity to noise"),
    "MATCH": ("match", "1", "0 where the point was matched"),
    "STATUS_FLAG": ("status_flag", "1", "status written by DICe"),
}
_REQUIRED = ("COORDINATE_X", "COORDINATE_Y", "DISPLACEMENT_X", "DISPLACEMENT_Y")


def read(path: str | os.PathLike[str], *, fps: float | None = None) -> xr.Dataset:
    """Read all frames of a DICe run.

    Parameters
    ----------
    path : path-like
        The folder, or one of its files.
    fps : float, optional [1/s]
        Frame rate; gives a ``time`` coordinate from the frame numbers.

    Returns
    -------
    Dataset over (frame, point)
        ``dx``, ``dy`` [px], ``valid``, and of the further fields those that are known (``sigma``,
        ``rotation``, ``gamma``, …); coordinates ``frame`` (number in the file name), ``x``, ``y``
        [px]. Failed points are NaN. The attribute ``other_fields`` names the fields that were not read.

    Raises
    ------
    SourceError
        A field is missing, a number cannot be read, or the points differ between frames.

    Warns
    -----
    UserWarning
        Points failed.
    """
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    found = [path] if path.is_file() else files.files_below(folder)
    numbered = sorted(
        (int(match.group(1)), p) for p in found if p.parent == folder and (match := _FILE.match(p.name)) is not None
    )
    if not numbered:
        raise SourceError(path, "no file DICe_solution_<number>.txt is there")
    header, tables = _tables([p for _, p in numbered])
    return _dataset(path, header, np.stack(tables), np.array([n for n, _ in numbered]), fps)


def _tables(paths: Sequence[Path]) -> tuple[list[str], list[Floats]]:
    header: list[str] = []
    tables: list[Floats] = []
    for path in paths:
        names, table = _one(path)
        if tables and names != header:
            raise SourceError(path, f"has the fields {', '.join(names)}, but {paths[0].name} has {', '.join(header)}")
        if tables and table.shape != tables[0].shape:
            raise SourceError(
                path,
                f"holds {len(table)} points, expected {len(tables[0])} as in {paths[0].name}",
                hint="The file may be cut off.",
            )
        header = names
        places = [names.index(n) for n in ("COORDINATE_X", "COORDINATE_Y")]
        if tables and not np.allclose(table[:, places], tables[0][:, places], atol=1e-3):
            raise SourceError(path, f"its points lie elsewhere than those of {paths[0].name}")
        tables.append(table)
    return header, tables


def _one(path: Path) -> tuple[list[str], Floats]:
    """Read one file: preamble lines of stars, the header, one line per point."""
    surveyed = text.survey(path)
    with path.open(encoding=surveyed.encoding) as stream:
        lines = stream.read().splitlines()
    start = next((i for i, line in enumerate(lines) if line and not line.startswith("***")), None)
    if start is None:
        raise SourceError(path, "holds no header of fields")
    delimiter = "," if "," in lines[start] else None
    header = [name.strip() for name in lines[start].split(delimiter) if name.strip()]
    missing = [name for name in _REQUIRED if name not in header]
    if missing:
        message = f"the fields {', '.join(missing)} are missing; found {', '.join(header)}"
        raise SourceError(path, message, line=start + 1, hint="Ask DICe for them in its output specification.")
    rows = []
    for number, line in enumerate(lines[start + 1 :], start + 2):
        if not line.strip():
            continue
        cells = [cell.strip() for cell in line.strip().rstrip(",").split(delimiter)]
        if len(cells) != len(header):
            raise SourceError(path, f"{len(cells)} values, expected {len(header)}", line=number)
        values = [plain_number(cell) for cell in cells]
        if None in values:
            k = values.index(None)
            raise text.not_a_number(cells[k], path=path, line_number=number, column=k + 1)
        rows.append(values)
    if not rows:
        raise SourceError(path, "holds no point", line=start + 1)
    return header, np.array(rows, dtype=float)


def _dataset(path: Path, header: list[str], values: Floats, frames: Integers, fps: float | None) -> xr.Dataset:
    columns = {name: values[:, :, k] for k, name in enumerate(header)}
    valid = np.isfinite(columns["DISPLACEMENT_X"]) & np.isfinite(columns["DISPLACEMENT_Y"])
    if "SIGMA" in columns:
        valid &= columns["SIGMA"] >= 0
    variables: dict[str, Any] = {
        name: variable(("frame", "point"), np.where(valid, columns[field], np.nan), units, label)
        for field, (name, units, label) in _FIELDS.items()
        if field in columns
    }
    variables["valid"] = variable(("frame", "point"), valid, "1", "whether there is a displacement")
    coordinates: dict[str, Any] = {
        "frame": variable("frame", frames, "1", "number in the file name"),
        "x": variable("point", columns["COORDINATE_X"][0], "px", "column"),
        "y": variable("point", columns["COORDINATE_Y"][0], "px", "row"),
    }
    if fps is not None:
        time = (frames - frames[0]) / fps
        coordinates["time"] = variable("frame", time, "s", "time")
    lost = int((~valid).sum())
    if lost:
        warn_of(path.name, f"{lost} of {valid.size} points failed in DICe and are NaN")
    known = {*_FIELDS, "COORDINATE_X", "COORDINATE_Y", "SUBSET_ID"}
    other = ", ".join(name for name in header if name not in known)
    return xr.Dataset(variables, coordinates, {"instrument": "DICe", "source": path.name, "other_fields": other})

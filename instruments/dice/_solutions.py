"""Results of the correlation program DICe: a folder of DICe_solution_*.txt, one file per frame, in pixels, y downwards.

The fields are the user's choice, so columns are found by their names.
"""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe import files, text
from labpipe.arrays import Floats
from labpipe.errors import SourceError, warn_of
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
    """Read all frames of a DICe run; SourceError where fields are missing or the points differ between frames.

    Parameters
    ----------
    path : path-like
        The folder, or one of its files.
    fps : float, optional [1/s]
        Frame rate; gives a ``time`` coordinate from the frame numbers.

    Returns
    -------
    Dataset over (frame, point)
        ``dx``, ``dy`` [px], ``valid``, and of the further fields those that are known (``sigma``, ``rotation``,
        ``gamma``, …); coordinates ``frame`` (number in the file name), ``x``, ``y`` [px]. Points that failed, with
        SIGMA = -1, are NaN, and warned of. The attribute ``other_fields`` names the fields that were not read.
    """
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    found = [path] if path.is_file() else files.files_below(folder)
    numbered = sorted((int(m[1]), p) for p in found if p.parent == folder and (m := _FILE.match(p.name)))
    if not numbered:
        raise SourceError(path, "no file DICe_solution_<number>.txt is there")
    header, first = _one(numbered[0][1])
    tables, places = [first], [header.index(name) for name in _REQUIRED[:2]]
    for _, other in numbered[1:]:
        names, table = _one(other)
        is_alike = names == header and table.shape == first.shape
        if not is_alike or not np.allclose(table[:, places], first[:, places], atol=1e-3):
            message = f"its fields or its {len(table)} points are not the {len(first)} of {numbered[0][1].name}"
            raise SourceError(other, message, hint="The file may be cut off, or belong to another run.")
        tables.append(table)
    values, frames = np.stack(tables), np.array([number for number, _ in numbered])
    columns = {name: values[:, :, k] for k, name in enumerate(header)}
    valid = columns.get("SIGMA", np.zeros(values.shape[:2])) >= 0
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
        coordinates["time"] = variable("frame", (frames - frames[0]) / fps, "s", "time")
    if lost := int((~valid).sum()):
        warn_of(path.name, f"{lost} of {valid.size} points failed in DICe and are NaN")
    others = ", ".join(name for name in header if name not in {*_FIELDS, *_REQUIRED, "SUBSET_ID"})
    return xr.Dataset(variables, coordinates, {"instrument": "DICe", "source": path.name, "other_fields": others})


def _one(path: Path) -> tuple[list[str], Floats]:
    """Read one file: preamble lines of stars, the header, one line per point."""
    lines = list(text.survey(path).lines())
    start = next((i for i, line in enumerate(lines) if line and not line.startswith("***")), None)
    if start is None:
        raise SourceError(path, "holds no header of fields")
    delimiter = "," if "," in lines[start] else None
    header = [name.strip() for name in lines[start].split(delimiter) if name.strip()]
    if missing := [name for name in _REQUIRED if name not in header]:
        message = f"the fields {', '.join(missing)} are missing; found {', '.join(header)}"
        raise SourceError(path, message, line=start + 1, hint="Ask DICe for them in its output specification.")
    rows = [" ".join(line.strip().rstrip(",").replace(delimiter or " ", " ").split()) for line in lines[start + 1 :]]
    while rows and not rows[-1]:
        rows.pop()
    if not rows:
        raise SourceError(path, "holds no point", line=start + 1)
    return header, text.parse_rows(rows, len(header), " ", path=path, first_line=start + 2)

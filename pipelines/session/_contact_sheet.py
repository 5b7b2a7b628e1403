"""A picture of a file: a frame of a film with its pixels along the sides and others below, or columns over time."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import instruments
from labpipe import files
from labpipe.errors import InputError, UsageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from labpipe.frames import FrameSource

_FRAMES, _WIDTH, _GAP = 8, 240, 6
"""Pictures of the strip, the width of one and the gap between two, in pixels."""
_ACROSS = 9.0  # inches of a frame with its pixels
_COLUMNS = 6  # of a table that are drawn; more would be too small to read


def write_sheet(source: Path, target: Path, options: dict[str, Any] | None = None) -> None:
    """Draw a film or table of a known instrument and write the picture; options are those of :func:`instruments.read`.

    Raises
    ------
    UsageError
        The target is no .png, or is the source.
    """
    if target.suffix.lower() != ".png":
        raise UsageError(f"{target}: the picture is written as .png; name it so")
    if target.resolve() == source.resolve():
        raise UsageError(f"{target} is the file itself, which is never written; name another picture")
    found = instruments.read(source, **options or {})
    stream = BytesIO()
    figure = _curves(found) if isinstance(found, xr.Dataset) else _frames(found)
    figure.savefig(stream, format="png", dpi=100, metadata={"Software": None})
    files.write_bytes(target, stream.getvalue())


def _frames(film: "FrameSource") -> "Figure":
    """Draw the first sound frame with its pixels along the sides, and below it some frames of the film."""
    from matplotlib.figure import Figure

    sound = np.flatnonzero(film.valid)
    if not sound.size:
        raise InputError("no frame of the film can be decoded")
    _, rows, columns = film.shape
    below = strip(film)
    high, low = _ACROSS * min(rows / columns, 1.0), _ACROSS * below.shape[0] / below.shape[1]
    figure = Figure(figsize=(_ACROSS + 1.0, high + low + 1.2), layout="constrained")
    first, others = figure.subplots(2, 1, height_ratios=(high, low))
    black, white = film.levels
    first.imshow(film[int(sound[0])], cmap="gray", vmin=black, vmax=white, interpolation="nearest")
    first.set(xlabel="x / px", ylabel="y / px", title=f"frame {sound[0]}")
    first.minorticks_on()
    first.grid(color="tab:orange", linewidth=0.5, alpha=0.6)
    others.imshow(below, cmap="gray", vmin=0, vmax=255)
    others.set_axis_off()
    return figure


def strip(frames: "FrameSource", count: int = _FRAMES) -> "NDArray[np.uint8]":
    """Put some frames, evenly over the film, side by side; only those are read.

    Black and white are the film's levels; a damaged frame is left grey.
    """
    import cv2

    total, rows, columns = frames.shape
    chosen = np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int))
    height = max(1, round(rows * _WIDTH / columns))
    sheet = np.full((height, len(chosen) * (_WIDTH + _GAP) - _GAP), 255, np.uint8)
    black, white = frames.levels
    for left, index in zip(range(0, sheet.shape[1], _WIDTH + _GAP), chosen.tolist(), strict=True):
        tile = np.full((height, _WIDTH), 128, np.uint8)
        if frames.valid[index]:
            grey = (frames[index].astype(np.float32) - black) * (255.0 / max(white - black, 1e-9))
            # Averaging over areas does not invent patterns when a frame is made smaller.
            way = cv2.INTER_AREA if columns > _WIDTH else cv2.INTER_NEAREST
            tile = np.clip(np.round(cv2.resize(grey, (_WIDTH, height), interpolation=way)), 0, 255).astype(np.uint8)
        sheet[:, left : left + _WIDTH] = tile
    return sheet


def _curves(dataset: xr.Dataset) -> "Figure":
    """Draw the numeric columns of a table over its first long axis, one below the other."""
    from matplotlib.figure import Figure

    longest = max(dataset.sizes.values(), default=0)
    columns = [v for v in dataset.data_vars.values() if v.shape == (longest,) and v.dtype.kind == "f"]
    columns = [v for v in columns if np.isfinite(v.values).any()][:_COLUMNS]
    if not columns:
        raise InputError("the file holds no column of numbers to draw")
    figure = Figure(figsize=(7.0, 1.5 * len(columns) + 0.4), layout="constrained")
    for place, variable in enumerate(columns):
        axes = figure.add_subplot(len(columns), 1, place + 1)
        has_time = "time" in dataset.variables and dataset["time"].dims == variable.dims
        # A clock that starts again in every block would lay the blocks over each other.
        has_time = has_time and bool((np.diff(dataset["time"].values) > 0).all())
        axes.plot(dataset["time"].values if has_time else np.arange(longest), variable.values, linewidth=0.7)
        axes.set_ylabel(f"{variable.name} / {variable.attrs.get('units', '')}")
    axes.set_xlabel("time / s" if has_time else str(variable.dims[0]))
    return figure

"""Readings and frames that an experiment excludes, as flags, and its exclusions and notes on its page."""

from typing import Any, Literal, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError
from labpipe.frames import FrameSource, ShownFrames
from labpipe.report import Column, Notice, Section, Table
from labpipe.signals import outliers
from labpipe.variables import variable
from labpipe.workflow.exclusions import exclusions

EXCLUDED = "is_excluded"
"""Variable of readings, over their dimension: 1 where session.toml excludes one. It is there where any is."""
_OTHER: dict[str, Literal["readings", "frames"]] = {"readings": "frames", "frames": "readings"}


def excluded(settings: Any, of: Literal["readings", "frames"], count: int) -> Flags:
    """Return flags (count,) of the readings, from 1, or frames, from 0, of a file that are excluded.

    ``settings`` hold the exclusions that concern the file alone, as a step receives them.

    Raises
    ------
    InputError
        The file has no such reading or frame, none is left, or it is of the other sort.
    """
    flags, begin = np.zeros(count, bool), int(of == "readings")
    for one in exclusions(settings):
        if one.spans(_OTHER[of]):
            raise InputError(
                f"exclude: {one.file} holds {of}, no {_OTHER[of]}; write {of} = {getattr(one, _OTHER[of])}"
            )
        for first, last in one.spans(of):
            if last >= count + begin:
                held = f"which holds {count} {of}, {begin} to {count - 1 + begin}"
                raise InputError(f"exclude: {one.excluded}, {held}; correct the numbers")
            flags[first - begin : last - begin + 1] = True
        if flags.all():
            raise InputError(f"exclude: no {of} of {one.file} are left; exclude the whole file: give no {of}")
    return flags


def without_readings(readings: xr.Dataset, settings: Any, *columns: str) -> xr.Dataset:
    """Leave out excluded readings of any instrument: NaN in columns that begin so, and flagged in :data:`EXCLUDED`."""
    dim = "time" if "time" in readings.dims else "sample"
    flags = excluded(settings, "readings", readings.sizes[dim])
    if not flags.any():
        return readings
    kept = {name: readings[name].where(~flags) for name in readings.data_vars if str(name).startswith(columns)}
    return readings.assign(kept | {EXCLUDED: variable(dim, flags.astype(np.int8), "1", "excluded by session.toml")})


def left_out(values: Floats, time: Floats, *, ends: bool = True) -> tuple[Flags, list[tuple[int, int, float]]]:
    """Return flags of readings that leave a record and return to it, and first, last and deviation of each run.

    The readings (time,) are NaN where there is none; see :func:`labpipe.signals.outliers`.
    """
    found = outliers(values, time if np.all(np.diff(time) > 0) else None, ends=ends)
    if not found.runs:
        return found.flags, []
    kept = np.isfinite(values) & ~found.flags
    off = np.abs(values - np.interp(time, time[kept], values[kept]))
    return found.flags, [(first, last, float(np.nanmax(off[first : last + 1]))) for first, last in found.runs]


def without_frames(film: FrameSource, is_excluded: Flags) -> FrameSource:
    """Return a film in which frames that are excluded count as damaged, so that they are not read."""
    return cast("FrameSource", _KeptFrames(film, is_excluded)) if is_excluded.any() else film


class _KeptFrames(ShownFrames):
    def __init__(self, film: FrameSource, is_excluded: Flags) -> None:
        self._film, self._is_excluded = film, is_excluded

    def __getattr__(self, name: str) -> Any:  # time, shape, levels, header, …
        return getattr(self._film, name)

    @property
    def valid(self) -> Flags:
        """False for frames that are damaged or excluded."""
        return self._film.valid & ~self._is_excluded

    def __getitem__(self, index: int) -> NDArray[np.integer]:
        """Return one frame."""
        return self._film[index]

    def roi(self, rows: slice, columns: slice) -> FrameSource:
        """Return a view of a rectangle."""
        return without_frames(self._film.roi(rows, columns), self._is_excluded)


def exclusion_notice(settings: Any) -> tuple[Notice, ...]:
    """Say next to the verdict how much was left out of it."""
    if not (found := exclusions(settings)):
        return ()
    text = "; ".join(f"{one.excluded} ({one.reason})" for one in found)
    return (Notice("info", f"Excluded from the measurement: {text}."),)


def notebook(settings: Any) -> Section:
    """Show notes and exclusions of an experiment, in the order of their days; no block where there are none."""
    entries = [(str(note.on), note.who, "note", note.text) for note in getattr(settings, "notes", ())]
    entries += [(str(one.on or ""), one.who, f"excluded: {one.excluded}", one.reason) for one in exclusions(settings)]
    table = Table(tuple(map(Column, ("day", "who", "entry", "text or reason"))), sorted(entries))
    return Section("Notes and exclusions", [table] if entries else [])

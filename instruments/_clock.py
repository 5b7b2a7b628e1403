"""Dates, times of day and times of rows as instruments write them."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import SourceError

_DATES = ("%Y/%m/%d", "%Y-%m-%d", "%d.%m.%Y")
_CLOCKS = ("", " %H:%M:%S", " %H:%M:%S.%f", "T%H:%M:%S", "T%H:%M:%S.%f", " %H:%M")


def moment(text: str) -> datetime | None:
    """Return the moment of a date, with or without a time of day; None in a form that is not known or ambiguous."""
    for day in _DATES:
        for time in _CLOCKS:
            try:
                return datetime.strptime(text, day + time)
            except ValueError:
                continue
    return None


def even_interval(path: Path, time: Floats, resolution: float, lines: Sequence[int]) -> float:
    """Return the interval [s] of times that lie evenly, each within its last decimal.

    SourceError where they do not, or one is missing.
    """
    steps = np.diff(time)
    interval = float((time[-1] - time[0]) / steps.size) if steps.size else 0.0
    off = np.abs(time - time[0] - interval * np.arange(time.size))
    if interval > 0 and (off <= 1.001 * resolution + 1e-9 * interval).all():
        return interval
    usual = float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0
    row = int(np.argmax(np.nan_to_num(np.abs(steps - usual), nan=np.inf))) if steps.size else -1
    raise SourceError(
        path,
        f"the times are uneven: a step of {steps[row] if steps.size else 0.0:.6g} s, {usual:.6g} s elsewhere",
        line=lines[row + 1],
        hint="Rows are missing, repeated or moved: export the file again, without gaps.",
    )

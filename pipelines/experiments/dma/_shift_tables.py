"""Tables of shift factors: published ones to compare with, and those set by hand."""

from pathlib import Path

import numpy as np

import instruments
from labpipe.arrays import Floats
from labpipe.errors import SourceError
from pipelines.experiments.dma.settings import Dma

_LEAST_SHARED = 2


def read(path: Path, settings: Dma) -> tuple[Floats, Floats]:
    """Read temperatures and log10 a_T, ascending in temperature."""
    options = settings.export
    read = instruments.read_table(path, "sweep", "plain_table", encoding=options.encoding, decimal=options.decimal)
    if "log10_aT" not in read:
        text = "found no column log_aT; this is not a table of shift factors"
        raise SourceError(path, text, line=1, hint="Begin the file with T,log_aT and a row of units such as C,-.")
    T, shift = read["temperature"].values, read["log10_aT"].values
    good = np.isfinite(T) & np.isfinite(shift)
    ascending, first = np.unique(T[good], return_index=True)
    return ascending, shift[good][first]


def at(table: tuple[Floats, Floats], T: Floats) -> Floats:
    """Interpolate; set temperatures are rounded, so half their spacing beyond the ends counts."""
    x, y = table
    if x.size < _LEAST_SHARED:
        return np.full(T.size, np.nan)
    reach = 0.5 * float(np.median(np.diff(x)))
    ends = (x[0] - reach, x[-1] + reach)
    outer = (y[0] - reach * (y[1] - y[0]) / (x[1] - x[0]), y[-1] + reach * (y[-1] - y[-2]) / (x[-1] - x[-2]))
    knots = np.concatenate([[ends[0]], x, [ends[1]]])
    values = np.concatenate([[outer[0]], y, [outer[1]]])
    return np.asarray(np.interp(T, knots, values, left=np.nan, right=np.nan))

"""A laboratory's own sensor: three lines of header, then displacements in micrometres.

::

    toy vibrometer
    start 2024-05-14T10:22:31
    interval_s 5e-05
    12.25
    lost

All that labpipe must know of it is INSTRUMENT, named in the entry points of its distribution.
"""

from pathlib import Path
from typing import TypedDict

from instruments import Instrument
from labpipe.errors import SourceError


class Options(TypedDict, total=False):
    """What the file leaves unsaid."""

    gain: float | None


def sniff(head: bytes, path: Path) -> bool:
    del path
    return head.startswith(b"toy vibrometer\n")


def read(path: Path, *, gain: float | None = None):
    """Return ``out1`` [m] and ``status1`` over ``time`` [s]."""
    import numpy as np
    import xarray as xr

    _, start, interval, *rows = Path(path).read_text("utf-8").splitlines()
    for number, row in enumerate(rows, 4):
        if row != "lost" and not row.lstrip("-").replace(".", "", 1).isdigit():
            raise SourceError(path, f'found "{row}", expected a number or lost', line=number)
    values = np.array([np.nan if row == "lost" else float(row) for row in rows])
    step = float(interval.split()[1])
    metres = {"units": "m", "long_name": "displacement", "resolution": 1e-8}
    state = {"units": "1", "long_name": "0 where valid"}
    return xr.Dataset(
        {
            "out1": ("time", values * 1e-6 * (gain or 1.0), metres),
            "status1": ("time", np.isnan(values).astype(np.int8), state),
        },
        {"time": ("time", np.arange(len(rows)) * step, {"units": "s", "long_name": "time"})},
        {
            "instrument": "toy vibrometer",
            "sampling_interval": step,
            "start": start.split()[1],
            "source": Path(path).name,
        },
    )


INSTRUMENT = Instrument(
    name="toy_vibrometer",
    title="toy vibrometer file",
    content="displacement",
    sniff=sniff,
    reader="toy_vibrometer:read",
    options=Options,
)

"""Recording of a running Keyence controller into a storage file, which is readable at any moment.

Readings are requested at even times after the start. A reading that is late or lost leaves its row without one.
"""

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from instruments.keyence._connection import Connection
from instruments.keyence._markers import Status
from instruments.keyence._writer import TOKENS, cell_of, head_lines, text_of
from labpipe import files
from labpipe.errors import InputError, LabpipeError, SourceError, UsageError
from labpipe.units import unit


@dataclass(frozen=True, slots=True)
class Setup:
    """Numbers of the outputs, decimals and units of their display, interval [s] between two readings."""

    outputs: tuple[int, ...]
    decimals: tuple[int, ...]
    units: tuple[str, ...]
    interval: float

    def __post_init__(self) -> None:
        """Refuse counts that do not fit together, units that are no length, and an interval that cannot be kept."""
        if not len(self.outputs) == len(self.decimals) == len(self.units):
            found = f"{len(self.decimals)} decimals and {len(self.units)} units"
            raise InputError(f"{len(self.outputs)} outputs need as many decimals and units, found {found}")
        if not 1e-4 <= self.interval <= 3600 or not all(0 <= d <= 6 for d in self.decimals):
            raise InputError("the interval must be from 0.1 ms to 1 h, the decimals from 0 to 6")
        if any(unit(text).si != "m" for text in self.units):
            raise InputError(f"units of a display are lengths such as mm or um, found {', '.join(self.units)}")


@dataclass(slots=True)
class Acquired:
    """A recording: its file, the table of the real times of its readings, and counts."""

    path: Path
    times: Path
    readings: int = 0
    rows: int = 0
    errors: int = 0
    last_error: str = ""
    worst_lateness: float = 0.0
    start: datetime | None = None


def record(
    path: Path, setup: Setup, connect: Callable[[], Connection], duration: float, *, patience: float = 10.0
) -> Acquired:
    """Record a controller into a storage file, and the real times into NAME.times.csv; UsageError where one exists.

    Parameters
    ----------
    path, setup : Path, Setup
    connect : callable
        Opens a connection; called again after each error.
    duration, patience : float [s]
        Of the recording; longest silence, after which SourceError is raised and the readings until then are kept.
    """
    done = Acquired(path, path.with_suffix(".times.csv"))
    if existing := next((p for p in (done.path, done.times) if p.exists()), None):
        raise UsageError(f"{existing} exists already; raw files are never replaced, take another name")
    if not (duration > 0 and patience > 0):
        raise UsageError("duration and patience must be positive")
    connection: Connection | None = connect()
    started, begun = datetime.now().astimezone(), time.perf_counter()
    slot, first, answered, waiting = 0, 0, 0.0, [TOKENS[Status.WAITING]] * len(setup.outputs)
    append: tuple[Callable[[str], None], ...] = ()

    def hang_up() -> None:
        nonlocal connection
        if connection is not None:
            connection.close()
        connection = None

    with contextlib.ExitStack() as opened:
        opened.callback(hang_up)
        while slot < round(duration / setup.interval):
            time.sleep(max(0.0, begun + slot * setup.interval - time.perf_counter()))
            try:
                connection = connection or connect()
                asked = time.perf_counter() - begun
                reading = connection.read()
            except LabpipeError as error:
                done.errors, done.last_error = done.errors + 1, str(error).splitlines()[0]
                hang_up()  # the next bytes may belong to an earlier answer
            else:
                answered = time.perf_counter() - begun
                middle, lines, times = (asked + answered) / 2, list[Sequence[str]](), ""
                if done.start is None:
                    first, done.start = slot, started + timedelta(seconds=slot * setup.interval)
                    lines += head_lines(setup.outputs, setup.units, done.start, setup.interval)
                    times = "row,time_s,round_trip_s\r\n"
                    append = tuple(opened.enter_context(files.journal(each)) for each in (done.path, done.times))
                lines += [(str(empty), *waiting) for empty in range(done.rows + 1, slot - first + 1)]
                done.rows, done.readings = slot - first + 1, done.readings + 1
                done.worst_lateness = max(done.worst_lateness, abs(middle - slot * setup.interval))
                cells = zip(*reading, setup.decimals, strict=True)
                lines += [(str(done.rows), *(cell_of(c * 10.0**-n, state, n, 8 + (n > 0)) for c, state, n in cells))]
                append[0](text_of(lines))  # whole lines with one call, so that a kill leaves no part of one
                append[1](f"{times}{done.rows},{middle:.6f},{answered - asked:.6f}\r\n")
            now = time.perf_counter() - begun
            if now - answered > patience:
                hint = f"Last error: {done.last_error}" if done.last_error else None
                raise SourceError("acquisition", f"the controller has been silent for {patience:g} s", hint=hint)
            slot = max(slot + 1, math.floor(now / setup.interval) + 1)
    if not done.readings:
        raise InputError(f"nothing was recorded: no reading came before the end. {done.last_error}".strip())
    return done


def recover(path: Path) -> dict[str, Any]:
    """Cut off the part of a line that a power failure left at the end of a recording and of its table of times."""
    found: dict[str, Any] = {"path": str(path)}
    for each in (path, path.with_suffix(".times.csv")):
        if not each.is_file():
            raise UsageError(f"{each}: there is no such file; expected a recording and its table of times")
        data = each.read_bytes()
        whole, _, rest = data.rpartition(b"\n")
        found[f"bytes_cut_off_{each.name}"] = len(rest)
        if rest:
            files.write_bytes(each, whole + b"\n" * (len(rest) < len(data)))
    return found

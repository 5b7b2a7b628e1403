"""Recording of a running Keyence controller into a storage file.

Readings are requested at even times after the start. Every row is appended as it comes, so the file is readable at any
moment, also after a crash. A reading that is late or lost leaves its row without one; nothing is filled in.
"""

import contextlib
import math
import re
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from instruments.keyence._connection import Connection, Reading
from instruments.keyence._markers import Status
from instruments.keyence._writer import TOKENS
from labpipe import files
from labpipe.errors import InputError, LabpipeError, SourceError, UsageError
from labpipe.units import quantity, unit

_TRIGGER = re.compile(r"\s*out(\d+)\s*([<>])\s*(.+)", re.IGNORECASE)


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


class Trigger(NamedTuple):
    """An output that passes a level [m] upwards or downwards."""

    output: int
    level: float
    is_rising: bool

    @classmethod
    def of(cls, text: str) -> "Trigger":
        """Read a trigger such as ``out1 < -1.5 mm``."""
        if (match := _TRIGGER.fullmatch(text)) is None:
            raise InputError(f'a trigger reads "out1 < -1.5 mm", found "{text}"')
        return cls(int(match[1]), quantity(match[3]).value, match[2] == ">")

    def passed(self, setup: Setup, before: "list[_Sample]", sample: "_Sample") -> bool:
        """Compare the level with the last two readings, both valid."""
        place = setup.outputs.index(self.output)
        pair = [each.reading for each in (*before, sample)]
        if len(pair) < 2 or any(reading.states[place] != Status.VALID for reading in pair):
            return False
        factor = 10.0 ** -setup.decimals[place] * unit(setup.units[place]).factor
        earlier, later = (reading.counts[place] * factor - self.level for reading in pair)
        return earlier < 0.0 <= later if self.is_rising else earlier > 0.0 >= later


class _Sample(NamedTuple):
    """A reading, its slot, the middle of request and answer [s from the start], and the time between them [s]."""

    slot: int
    at: float
    round_trip: float
    reading: Reading


@dataclass(slots=True)
class Acquired:
    """A recording: its file, the table of the real times of its readings, and counts."""

    path: Path
    times: Path
    readings: int = 0
    rows: int = 0
    trigger_row: int | None = None
    errors: int = 0
    last_error: str = ""
    worst_lateness: float = 0.0
    start: datetime | None = None
    _first: int = 0
    _unwritten: tuple[list[str], list[str]] = field(default_factory=lambda: ([], []))
    _open: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    _append: tuple[Callable[[str], None], ...] = ()

    def add(self, setup: Setup, sample: _Sample, started: datetime) -> None:
        """Append the row of a reading and those of empty slots before it."""
        if self.start is None:
            self._first, self.start = sample.slot, started + timedelta(seconds=sample.slot * setup.interval)
            head = [
                "Remark,assumed layout",
                f"Date,{self.start:%Y/%m/%d %H:%M:%S}",
                f"Sampling cycle,{setup.interval * 1e6:.6g}us",
                "Storage cycle,x1",
                ",".join(("Unit", *setup.units)),
                ",".join(("No.", *(f"OUT{output}" for output in setup.outputs))),
            ]
            self._unwritten[0].extend(head)
            self._unwritten[1].append("row,time_s,round_trip_s")
        waiting = ",".join([TOKENS[Status.WAITING]] * len(setup.outputs))
        row = sample.slot - self._first + 1
        self._unwritten[0].extend(f"{empty},{waiting}" for empty in range(self.rows + 1, row))
        cells = [
            f"{count * 10.0**-decimals:+0{8 + (decimals > 0)}.{decimals}f}" if state == Status.VALID else TOKENS[state]
            for count, state, decimals in zip(*sample.reading, setup.decimals, strict=True)
        ]
        self._unwritten[0].append(f"{row},{','.join(cells)}")
        self._unwritten[1].append(f"{row},{sample.at:.6f},{sample.round_trip:.6f}")
        self.rows, self.readings = row, self.readings + 1
        self.worst_lateness = max(self.worst_lateness, abs(sample.at - sample.slot * setup.interval))

    def flush(self) -> None:
        """Write whole lines, each file with one call, so that a killed recording leaves no part of a line."""
        if self.rows and not self._append:
            self._append = tuple(self._open.enter_context(files.journal(p)) for p in (self.path, self.times))
        for append, lines in zip(self._append, self._unwritten, strict=False):
            if lines:
                append("\r\n".join(lines) + "\r\n")
                lines.clear()

    def close(self) -> None:
        """Write the rest and close the files."""
        with self._open:
            self.flush()


def record(
    path: Path,
    setup: Setup,
    connect: Callable[[], Connection],
    duration: float,
    trigger: Trigger | None = None,
    *,
    before: float = 0.0,
    patience: float = 10.0,
) -> Acquired:
    """Record a controller into a storage file, and the real times into NAME.times.csv.

    Parameters
    ----------
    path, setup : Path, Setup
    connect : callable
        Opens a connection; called again after each error.
    duration, before, patience : float [s]
        Kept after the start or the trigger, and before the trigger; longest silence of the controller.
    trigger : Trigger, optional

    Raises
    ------
    UsageError
        A file of that name exists.
    SourceError, KeyboardInterrupt
        The controller cannot be reached or is silent, or the user stopped; readings until then are in the file.
    """
    done = Acquired(path, path.with_suffix(".times.csv"))
    if existing := next((p for p in (done.path, done.times) if p.exists()), None):
        raise UsageError(f"{existing} exists already; raw files are never replaced, take another name")
    if not (duration > 0 and before >= 0 and patience > 0):
        raise UsageError("duration and patience must be positive, the time before the trigger not negative")
    if trigger is not None and trigger.output not in setup.outputs:
        raise InputError(f"the trigger looks at out{trigger.output}, which is not recorded")
    connection: Connection | None = connect()
    started, begun, interval = datetime.now().astimezone(), time.perf_counter(), setup.interval
    end = round(duration / interval) if trigger is None else math.inf
    kept: deque[_Sample] = deque(maxlen=1 if trigger is None else math.ceil(before / interval) + 1)
    slot, answered, shown = 0, 0.0, 0.0
    try:
        while slot < end:
            time.sleep(max(0.0, begun + slot * interval - time.perf_counter()))
            try:
                connection = connection or connect()
                asked = time.perf_counter() - begun
                reading = connection.read()
                answered = time.perf_counter() - begun
                sample = _Sample(slot, (asked + answered) / 2, answered - asked, reading)
                if end == math.inf and trigger is not None and trigger.passed(setup, [*kept][-1:], sample):
                    end = slot + round(duration / interval)
                    for earlier in (s for s in kept if s.slot >= slot - round(before / interval)):
                        done.add(setup, earlier, started)
                    done.trigger_row = slot - (done._first if done.rows else slot) + 1
                kept.append(sample)
                if end < math.inf:
                    done.add(setup, sample, started)
            except LabpipeError as error:
                done.errors, done.last_error = done.errors + 1, str(error).splitlines()[0]
                if connection is not None:  # the next bytes may belong to an earlier answer
                    connection.close()
                connection = None
            now = time.perf_counter() - begun
            if now - answered > patience:
                hint = f"Last error: {done.last_error}" if done.last_error else None
                raise SourceError("acquisition", f"the controller has been silent for {patience:g} s", hint=hint)
            if now - shown > 0.1:
                done.flush()
                shown = now
            slot = max(slot + 1, math.floor(now / interval) + 1)
    finally:
        if connection is not None:
            connection.close()
        done.close()
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

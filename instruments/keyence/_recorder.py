"""Record a running Keyence controller in even time slots, through a ring buffer.

Readings are asked for at even times ``k × interval`` after the start. A slot whose reading did not
come (late, lost, connection broken) stays empty and is counted; nothing is filled in. So the
recording has the even time base of a storage file, and its real times stand beside it.
"""

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr

from instruments.keyence._live import Connection, Reading
from instruments.keyence._markers import Layout, Status
from instruments.keyence._writer import DEVICE, output_variables
from labpipe.arrays import Floats
from labpipe.errors import InputError, LabpipeError, SourceError
from labpipe.units import unit
from labpipe.variables import variable

_CELL_DIGITS = 6
"""Digits beside sign and decimal sign in a cell of a storage file."""
_RING = 4096
"""Readings between two looks of the keeper, which looks ten times a second."""
_LOOK = 0.1  # s


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading: its slot, the middle of question and answer [s from the start], round trip."""

    slot: int
    at: float
    round_trip: float
    reading: Reading


class Ring:
    """The last readings; when nobody takes them in time the oldest are lost, and counted.

    Examples
    --------
    >>> ring = Ring(2)
    >>> for n in range(3):
    ...     ring.put(n)
    >>> ring.take(), ring.lost
    ([1, 2], 1)
    """

    def __init__(self, size: int = _RING) -> None:
        self._items: deque[Sample] = deque(maxlen=size)
        self._lock = threading.Lock()
        self.lost = 0

    def put(self, item: Sample) -> None:
        """Add a reading, over the oldest when there is no room."""
        with self._lock:
            self.lost += len(self._items) == self._items.maxlen
            self._items.append(item)

    def take(self) -> list[Sample]:
        """Return and forget what is there."""
        with self._lock:
            found = list(self._items)
            self._items.clear()
        return found


@dataclass(frozen=True, slots=True)
class Trigger:
    """What ends the waiting: an output that passes a level [SI]; how much is kept around it [s]."""

    output: int
    level: float
    is_rising: bool
    before: float = 0.0

    def passed(self, earlier: float, later: float) -> bool:
        """Whether the level lies between two readings, in the wanted direction."""
        if self.is_rising:
            return earlier < self.level <= later
        return earlier > self.level >= later


@dataclass(slots=True)
class Tally:
    """What went wrong on the way, in counts."""

    reconnections: int = 0
    errors: int = 0
    last_error: str = ""
    lost_in_ring: int = 0


@dataclass(frozen=True, slots=True)
class Setup:
    """What is recorded, and how the controller's numbers are to be read.

    Attributes
    ----------
    outputs : tuple of int
        Numbers of the outputs.
    decimals : tuple of int
        Digits after the decimal sign on the display, per output.
    units : tuple of str
        Of the display, per output.
    interval : float [s]
        Between two readings.
    model : str
        Of the controller, for the header of the file.
    """

    outputs: tuple[int, ...]
    decimals: tuple[int, ...]
    units: tuple[str, ...]
    interval: float
    model: str = ""

    def __post_init__(self) -> None:
        """Refuse counts that do not fit together, and an interval that cannot be kept."""
        if not len(self.outputs) == len(self.decimals) == len(self.units):
            raise InputError(
                f"{len(self.outputs)} outputs need as many decimals and units, found "
                f"{len(self.decimals)} and {len(self.units)}"
            )
        if not 1e-4 <= self.interval <= 3600:
            raise InputError(f"the interval must be from 0.1 ms to 1 h, found {self.interval:g} s")
        wrong = [d for d in self.decimals if not 0 <= d <= _CELL_DIGITS]
        if wrong:
            raise InputError(f"decimals must be from 0 to {_CELL_DIGITS}, found {wrong[0]}")

    def value(self, place: int, count: int) -> float:
        """Return a count of one output in SI."""
        return count * 10.0 ** -self.decimals[place] * unit(self.units[place]).factor


@dataclass(slots=True)
class Recorder:
    """Asks in a thread of its own, keeps what comes, and decides when to stop.

    ``setup``: what is recorded; ``connect``: opens a connection; ``patience`` [s]: how long the controller may be
    silent before the recording is given up; ``save``: told the new readings that are kept for good, ten times a second,
    and the tally: what a killed recording leaves.
    """

    setup: Setup
    connect: Callable[[], Connection]
    patience: float = 10.0
    save: Callable[[Sequence[Sample], Tally], None] | None = None
    ring: Ring = field(default_factory=Ring)
    tally: Tally = field(default_factory=Tally)
    kept: list[Sample] = field(default_factory=list)
    started: datetime | None = None
    trigger_slot: int | None = None
    _saved: int = 0
    _stop: threading.Event = field(default_factory=threading.Event)

    def record(
        self, duration: float, trigger: Trigger | None = None, progress: Callable[[int, int], None] | None = None
    ) -> None:
        """Record until the duration has passed, from the start or from the trigger.

        Parameters
        ----------
        duration : float [s]
            How much to keep; after the trigger when there is one.
        trigger : Trigger, optional
            Wait for it; only what lies shortly before it is kept.
        progress : callable, optional
            Told the number of readings, and of empty slots, ten times a second.

        Raises
        ------
        SourceError
            The controller cannot be reached, or stays silent for longer than the patience.
        KeyboardInterrupt
            What came until then is in ``kept``.
        """
        with self.connect():
            pass  # a wrong address is an error at once, not a wait
        self.started = datetime.now().astimezone()
        asker = threading.Thread(target=self._ask, daemon=True)
        begun = time.perf_counter()
        asker.start()
        silent_since = begun
        try:
            while not self._is_over(duration, trigger, time.perf_counter() - begun):
                time.sleep(min(_LOOK, self.setup.interval * 10))
                new = self._take()
                silent_since = time.perf_counter() if new else silent_since
                self._keep(new, trigger)
                self._save(trigger)
                if progress is not None:
                    progress(len(self.kept), self.empty)
                if time.perf_counter() - silent_since > self.patience:
                    raise self._silence()
        finally:
            self._stop.set()
            asker.join()
            self._keep(self._take(), trigger)
            self._save(trigger)
            self._cut(duration, trigger)

    def replay(self, samples: Sequence[Sample], duration: float, trigger: Trigger | None) -> None:
        """Keep what was recorded before as if it came now; see :meth:`record`."""
        self._keep(samples, trigger)
        self._cut(duration, trigger)

    @property
    def empty(self) -> int:
        """Slots without a reading, between the first and the last one that has one."""
        if not self.kept:
            return 0
        return self.kept[-1].slot - self.kept[0].slot + 1 - len(self.kept)

    def _take(self) -> list[Sample]:
        found = self.ring.take()
        self.tally.lost_in_ring = self.ring.lost
        return found

    def _silence(self) -> SourceError:
        message = f"the controller has been silent for {self.patience:g} s"
        hint = f"Last error: {self.tally.last_error}" if self.tally.last_error else None
        return SourceError("acquisition", message, hint=hint)

    def _is_over(self, duration: float, trigger: Trigger | None, now: float) -> bool:
        if trigger is None:
            return now >= duration
        return self.trigger_slot is not None and (now >= self.trigger_slot * self.setup.interval + duration)

    def _keep(self, new: Sequence[Sample], trigger: Trigger | None) -> None:
        """Keep readings; while a trigger is awaited, only the last ones."""
        for sample in new:
            earlier = self.kept[-1] if self.kept else None
            self.kept.append(sample)
            if trigger is None or self.trigger_slot is not None or earlier is None:
                continue
            if self._passes(trigger, earlier, sample):
                self.trigger_slot = sample.slot
        if trigger is not None and self.trigger_slot is None and self.kept:
            first = self.kept[-1].slot - math.ceil(trigger.before / self.setup.interval) - 1
            self.kept = [s for s in self.kept if s.slot >= first]

    def _save(self, trigger: Trigger | None) -> None:
        """Hand on what is new; nothing while a trigger is awaited, as old readings are dropped."""
        is_waiting = trigger is not None and self.trigger_slot is None
        new = self.kept[self._saved :]
        if self.save is not None and new and not is_waiting:
            self.save(new, self.tally)
            self._saved += len(new)

    def _passes(self, trigger: Trigger, earlier: Sample, later: Sample) -> bool:
        place = self.setup.outputs.index(trigger.output)
        states = earlier.reading.states[place], later.reading.states[place]
        if any(state != Status.VALID for state in states):
            return False
        counts = earlier.reading.counts[place], later.reading.counts[place]
        return trigger.passed(*(self.setup.value(place, n) for n in counts))

    def _cut(self, duration: float, trigger: Trigger | None) -> None:
        """Drop what lies outside the wanted time; the last look may have come late."""
        interval = self.setup.interval
        count = round(duration / interval)
        if trigger is None:
            self.kept = [s for s in self.kept if s.slot < count]
        elif self.trigger_slot is not None:
            first = self.trigger_slot - round(trigger.before / interval)
            last = self.trigger_slot + count
            self.kept = [s for s in self.kept if first <= s.slot < last]

    # --- asking, in a thread of its own ---

    def _ask(self) -> None:
        start, slot = time.perf_counter(), 0
        connection: Connection | None = None
        try:
            while not self._stop.wait(max(0.0, start + slot * self.setup.interval - _now())):
                try:
                    if connection is None:
                        connection = self.connect()
                    asked = _now()
                    reading = connection.read()
                    came = _now()
                    at = (asked + came) / 2 - start
                    self.ring.put(Sample(slot, at, came - asked, reading))
                except LabpipeError as error:
                    self._count(error, was_open=connection is not None)
                    _close(connection)  # after an error nobody knows what comes next
                    connection = None
                slot = max(slot + 1, math.floor((_now() - start) / self.setup.interval) + 1)
        finally:
            _close(connection)

    def _count(self, error: LabpipeError, was_open: bool) -> None:
        self.tally.errors += 1
        self.tally.last_error = str(error).splitlines()[0]
        self.tally.reconnections += was_open


def _now() -> float:
    return time.perf_counter()


def _close(connection: Connection | None) -> None:
    if connection is not None:
        with contextlib.suppress(OSError):
            connection.close()


# --- what was recorded, as the reader would return it ------------------------------------------


def recording(setup: Setup, samples: Sequence[Sample], start: datetime) -> xr.Dataset:
    """Lay readings on even slots; an empty slot has no reading and waits for none.

    ``setup``: units and decimals; ``samples``: in the order of their slots; ``start``: when the first slot of the
    recording was. Returns what :func:`instruments.keyence.write` takes. Raises InputError: there is no reading.
    """
    if not samples:
        raise InputError("nothing was recorded: no reading came before the end")
    first = samples[0].slot
    count = samples[-1].slot - first + 1
    slots = np.array([s.slot - first for s in samples])
    variables: dict[str, Any] = {}
    for place, output in enumerate(setup.outputs):
        counts = np.zeros(count)
        status = np.full(count, Status.WAITING, dtype=np.int8)
        counts[slots] = [s.reading.counts[place] for s in samples]
        status[slots] = [s.reading.states[place] for s in samples]
        step = 10.0 ** -setup.decimals[place]
        shown: Floats = np.where(status == Status.VALID, counts * step, np.nan)
        written = _layout(shown, setup.decimals[place])
        shown = np.round(shown, written.decimals)
        variables |= output_variables(output, setup.units[place], shown, status, written)
    attrs = {
        "instrument": DEVICE,
        "model": setup.model,
        "start": start.replace(tzinfo=None, microsecond=0).isoformat(),
        "sampling_cycle": setup.interval,
        "storage_factor": 1,
        "sampling_interval": setup.interval,
        "averaging": 1,
        "layout": "assumed",
    }
    times = np.arange(count) * setup.interval
    coords = {"time": variable("time", times, "s", "time from the first point")}
    return xr.Dataset(variables, coords=coords, attrs=attrs)


def _layout(shown: Floats, decimals: int) -> Layout:
    """Return the layout in which every reading fits its cell: digits before the sign come first."""
    largest = float(np.nanmax(np.abs(shown))) if np.isfinite(shown).any() else 0.0
    whole = max(1, len(f"{largest:.0f}"))
    kept = max(0, min(decimals, _CELL_DIGITS - whole))
    return Layout(True, _CELL_DIGITS - kept, kept)


def stamps(samples: Sequence[Sample]) -> Iterator[str]:
    """Write the real time and the round trip of every reading, as lines of a table."""
    first = samples[0].slot if samples else 0
    yield "row,time_s,round_trip_s"
    for sample in samples:
        yield f"{sample.slot - first + 1},{sample.at:.6f},{sample.round_trip:.6f}"


def timing(setup: Setup, samples: Sequence[Sample]) -> dict[str, float]:
    """How well the even times were kept.

    Returns
    -------
    dict
        ``worst_lateness`` and ``rms_lateness`` [s] of readings after their slot, and
        ``median_round_trip`` [s].
    """
    late = np.array([s.at - s.slot * setup.interval for s in samples])
    trips = np.array([s.round_trip for s in samples])
    if not late.size:
        return {"worst_lateness": math.nan, "rms_lateness": math.nan, "median_round_trip": math.nan}
    return {
        "worst_lateness": float(np.abs(late).max()),
        "rms_lateness": float(np.sqrt(np.mean(late**2))),
        "median_round_trip": float(np.median(trips)),
    }

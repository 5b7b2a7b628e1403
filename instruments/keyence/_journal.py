"""Journal of a recording in progress, from which an interrupted one is recovered; JSON lines.

The first line says how the controller's numbers are to be read; then follow readings ``[slot, time
s, round trip s, [numbers], [states]]`` and, when they changed, the counts of what went wrong. A
last line without its end is one that the kill cut short: it is left out and reported.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import TypeVar

import msgspec

from instruments.keyence._live import Reading
from instruments.keyence._markers import Status
from instruments.keyence._recorder import Sample, Setup, Tally, Trigger
from labpipe.errors import InputError, SourceError

SUFFIX = ".recording"
_VERSION = 1
_LONGEST_GAP = 10_000_000
"""Empty slots in a row: a quarter of an hour at the shortest interval; more is a damaged number."""
_LARGEST = 2**31
"""Whole numbers of either protocol are smaller."""
_T = TypeVar("_T")


class _Line(msgspec.Struct, array_like=True, forbid_unknown_fields=True):
    slot: int
    at: float
    round_trip: float
    counts: tuple[int, ...]
    states: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Head:
    """The first line of a journal.

    ``setup``: what is recorded; ``started``: when slot 0 was; ``duration`` [s]: how much was wanted, from the start or
    from the trigger; ``trigger``: what was waited for; ``recording``: version of this form.
    """

    setup: Setup
    started: datetime
    duration: float
    trigger: Trigger | None = None
    recording: int = _VERSION


@dataclass(frozen=True, slots=True)
class Journal:
    """What a journal holds; ``torn`` tells whether its last line was cut short."""

    head: Head
    samples: tuple[Sample, ...]
    tally: Tally
    torn: bool


def path_of(target: Path) -> Path:
    """Return the journal of a recording: its name with ``.recording`` behind it."""
    return target.with_name(target.name + SUFFIX)


def first_line(head: Head) -> str:
    """Write how the readings are to be understood."""
    return msgspec.json.encode(head).decode() + "\n"


def lines(samples: Sequence[Sample], tally: Tally | None = None) -> str:
    """Write readings, and counts where they changed."""
    written = [
        json.dumps([s.slot, s.at, s.round_trip, s.reading.counts, [int(x) for x in s.reading.states]]) for s in samples
    ]
    written += [] if tally is None else [json.dumps(asdict(tally))]
    return "\n".join(written) + "\n"


def read(path: Path) -> Journal | None:
    """Read a journal.

    Returns
    -------
    Journal or None
        None where the recording was killed before its first reading was kept.

    Raises
    ------
    SourceError
        The file cannot be read, or a line of it is no line of a journal.
    """
    try:
        rows = path.read_bytes().split(b"\n")
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror}") from None
    torn = bool(rows.pop())
    if not rows:
        return None
    head = _decoded(path, 1, rows[0], Head)
    if head.recording != _VERSION:
        message = f"expected a recording of version {_VERSION}, found version {head.recording}"
        raise SourceError(path, message, line=1, hint="Use the version of labpipe that wrote it.")
    samples, tally = [], Tally()
    for number, row in enumerate(rows[1:], 2):
        if row.startswith(b"{"):
            tally = _decoded(path, number, row, Tally)
        else:
            samples.append(_sample(path, number, row, len(head.setup.outputs)))
            if len(samples) > 1:
                _check_order(path, number, samples[-2].slot, samples[-1].slot)
    return Journal(head, tuple(samples), tally, torn) if samples else None


_HINT = "The file is damaged here; delete the line to recover the others."


def _check_order(path: Path, number: int, before: int, slot: int) -> None:
    if not before < slot <= before + _LONGEST_GAP:
        raise SourceError(path, f"slot {slot} cannot follow slot {before}", line=number, hint=_HINT)


def _sample(path: Path, number: int, row: bytes, n_outputs: int) -> Sample:
    found = _decoded(path, number, row, _Line)
    fits = len(found.counts) == len(found.states) == n_outputs and found.slot >= 0
    if not fits or any(abs(count) > _LARGEST for count in found.counts):
        message = f"expected a slot and {n_outputs} numbers and states, found {_shown(row)}"
        raise SourceError(path, message, line=number, hint=_HINT)
    try:
        reading = Reading(found.counts, tuple(map(Status, found.states)))
    except ValueError:
        message = f"found states {list(found.states)}, of which one does not exist"
        raise SourceError(path, message, line=number, hint=_HINT) from None
    return Sample(found.slot, found.at, found.round_trip, reading)


def _decoded(path: Path, number: int, row: bytes, kind: type[_T]) -> _T:
    try:
        return msgspec.json.decode(row, type=kind)
    except (msgspec.DecodeError, InputError, UnicodeDecodeError):
        message = f"expected a line of an unfinished recording, found {_shown(row)}"
        raise SourceError(path, message, line=number, hint=_HINT) from None


def _shown(row: bytes) -> str:
    return json.dumps(row[:60].decode("utf-8", "replace"))

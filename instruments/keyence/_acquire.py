"""Record a running sensor into a file of the session folder, and its actual times into another."""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

from instruments.keyence import _journal as journals
from instruments.keyence._live import Connection
from instruments.keyence._recorder import Recorder, Sample, Setup, Tally, Trigger, recording, stamps, timing
from instruments.keyence._writer import encode
from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.units import quantity, unit

EMULATOR_ONLY = (
    "The live protocols were tested against an emulator only; compare the first readings with the controller's display."
)
_TRIGGER = re.compile(r"\s*out(\d+)\s*([<>])\s*(.+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Acquired:
    """What was recorded: the file, its table of times, and counts of what went wrong."""

    path: Path
    times: Path
    summary: dict[str, Any]


def parse_trigger(text: str, before: float = 0.0) -> Trigger:
    """Read a trigger such as ``out1 < -1.5 mm``.

    Parameters
    ----------
    text : str
        An output, a direction, and a level with its unit.
    before : float [s]
        How much is kept before it.

    Raises
    ------
    InputError
        It reads otherwise.
    """
    match = _TRIGGER.fullmatch(text)
    if match is None:
        raise InputError(f'a trigger reads "out1 < -1.5 mm", found "{text}"')
    return Trigger(int(match[1]), quantity(match[3]).value, match[2] == ">", before)


def record(
    path: str | Path,
    setup: Setup,
    connect: Callable[[], Connection],
    duration: float,
    trigger: Trigger | None = None,
    *,
    patience: float = 10.0,
    progress: Callable[[int, int], None] | None = None,
) -> Acquired:
    """Record a Keyence controller into a storage file, as :func:`instruments.read` reads it.

    What comes is appended to ``NAME.recording`` until the file is complete; :func:`recover` makes
    the file of what a killed recording left there.

    Parameters
    ----------
    path : path-like
        The file; there must be none of that name.
    setup : Setup
        Outputs, decimals, units, interval.
    connect : callable
        Opens a connection.
    duration : float [s]
        From the start, or from the trigger.
    trigger : Trigger, optional
        Wait for it.
    patience : float [s]
        How long the controller may be silent.
    progress : callable, optional
        Told numbers of readings and of empty slots.

    Returns
    -------
    Acquired
        Beside the file lies ``NAME.times.csv`` with the real time of every reading.

    Raises
    ------
    UsageError
        The file, or an unfinished recording of it, exists.
    SourceError, KeyboardInterrupt
        The controller fell silent, or the user stopped; what came until then is written first.
    """
    target = Path(path)
    partial = journals.path_of(target)
    _refuse_existing(target, partial)
    if trigger is not None and trigger.output not in setup.outputs:
        raise InputError(f"the trigger looks at out{trigger.output}, which is not recorded")
    recorder = Recorder(setup, connect, patience)
    try:
        with files.journal(partial) as append:
            recorder.save = _saver(append, recorder, duration, trigger)
            recorder.record(duration, trigger, progress)
    except BaseException:
        if recorder.kept:
            _write(target, setup, recorder)
        files.discard(partial)
        raise
    if not recorder.kept:
        files.discard(partial)
    done = _write(target, setup, recorder)
    files.discard(partial)
    return done


def _refuse_existing(target: Path, partial: Path) -> None:
    if target.exists():
        raise UsageError(f"{target} exists already; raw files are never replaced, take another name")
    if partial.exists():
        raise UsageError(
            f"{partial} holds an unfinished recording, of a run that was killed or still goes on; "
            f"finish it with `labpipe acquire recover {partial}`, or take another name"
        )


def _saver(
    append: Callable[[str], None], recorder: Recorder, duration: float, trigger: Trigger | None
) -> Callable[[Sequence[Sample], Tally], None]:
    """Make what writes readings into the journal as they come, and counts when they changed."""
    told: list[Tally] = []

    def save(samples: Sequence[Sample], tally: Tally) -> None:
        head = ""
        if not told and recorder.started is not None:
            head = journals.first_line(journals.Head(recorder.setup, recorder.started, duration, trigger))
        is_new = not told or told[-1] != tally
        append(head + journals.lines(samples, tally if is_new else None))
        told[:] = [replace(tally)]

    return save


def recover(path: str | Path) -> Acquired:
    """Finish a recording that was killed: write the file that it would have written.

    Parameters
    ----------
    path : path-like
        What it left, ``NAME.recording``; it is deleted when the file is complete.

    Returns
    -------
    Acquired
        As of :func:`record`; ``cut_short`` in the summary tells whether the last line was
        torn, whose reading is then lost.

    Raises
    ------
    UsageError
        It is still being written, holds no reading, or another file of its name exists.
    SourceError
        A line of it is damaged.
    """
    partial = Path(path)
    if partial.suffix != journals.SUFFIX or not partial.is_file():
        raise UsageError(f'{partial}: expected an unfinished recording, a file "NAME{journals.SUFFIX}"')
    with files.lock(partial, wait=False) as is_ours:
        if not is_ours:
            raise UsageError(f"{partial} is still being recorded; end that with Ctrl-C, it keeps what came")
        found = journals.read(partial)
        if found is None:
            raise UsageError(f"{partial} holds no reading: it was killed before one was kept; delete it")
        head = found.head
        recorder = Recorder(head.setup, _nobody, started=head.started, tally=found.tally)
        recorder.replay(found.samples, head.duration, head.trigger)
        done = _write(partial.with_suffix(""), head.setup, recorder, may_exist=True)
        files.discard(partial)
    return Acquired(done.path, done.times, {**done.summary, "cut_short": found.torn})


def _nobody() -> Connection:
    raise InputError("a recording that is recovered has no connection")


def _write(target: Path, setup: Setup, recorder: Recorder, *, may_exist: bool = False) -> Acquired:
    if recorder.started is None or not recorder.kept:
        raise InputError("nothing was recorded: no reading came before the end")
    first = recorder.kept[0].slot
    start = recorder.started + timedelta(seconds=first * setup.interval)
    dataset = recording(setup, recorder.kept, start)
    data = encode(dataset)
    if may_exist and target.exists() and target.read_bytes() != data:
        raise UsageError(f"{target} exists and holds something else; move it away, then try again")
    files.write_bytes(target, data)
    summary = {
        "readings": len(recorder.kept),
        "empty_slots": recorder.empty,
        "trigger_row": None if recorder.trigger_slot is None else recorder.trigger_slot - first + 1,
        **asdict(recorder.tally),
        **timing(setup, recorder.kept),
        "start": start.isoformat(),
        "remark": EMULATOR_ONLY,
    }
    times = target.with_suffix(".times.csv")
    head = f"# {json.dumps(summary)}\n"
    files.write_text(times, head + "\n".join(stamps(recorder.kept)) + "\n")
    return Acquired(target, times, summary)


def check_units(units: tuple[str, ...]) -> None:
    """Refuse a unit that no Keyence display has.

    Raises
    ------
    InputError
        With the units that are known.
    """
    for text in units:
        if unit(text).si != "m":
            raise InputError(f'the unit of a display is a length such as mm or um, found "{text}"')

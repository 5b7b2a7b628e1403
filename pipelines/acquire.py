"""Record a running sensor into a file of the session folder, with its real times beside it."""

import json
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.units import quantity, unit

if TYPE_CHECKING:
    from instruments.keyence_live import Connection
    from instruments.keyence_recorder import Recorder, Setup, Trigger

EMULATOR_ONLY = (
    "The live protocols were tested against an emulator only; compare the first readings with the "
    "controller's display."
)
_TRIGGER = re.compile(r"\s*out(\d+)\s*([<>])\s*(.+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Acquired:
    """What was recorded: the file, its table of times, and counts of what went wrong."""

    path: Path
    times: Path
    summary: dict[str, Any]


def parse_trigger(text: str, before: float = 0.0) -> "Trigger":
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
    from instruments.keyence_recorder import Trigger

    match = _TRIGGER.fullmatch(text)
    if match is None:
        message = f'a trigger reads "out1 < -1.5 mm", found "{text}"'
        raise InputError(message)
    return Trigger(int(match[1]), quantity(match[3]).value, match[2] == ">", before)


def record_keyence(
    path: str | Path,
    setup: "Setup",
    connect: "Callable[[], Connection]",
    duration: float,
    trigger: "Trigger | None" = None,
    *,
    patience: float = 10.0,
    progress: Callable[[int, int], None] | None = None,
) -> Acquired:
    """Record a Keyence controller into a storage file in the layout that :mod:`instruments` reads.

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
        The file exists.
    SourceError, KeyboardInterrupt
        The controller fell silent, or the user stopped; what came until then is written first.
    """
    from instruments.keyence_recorder import Recorder

    target = Path(path)
    if target.exists():
        message = f"{target} exists already; raw files are never replaced, take another name"
        raise UsageError(message)
    if trigger is not None and trigger.output not in setup.outputs:
        message = f"the trigger looks at out{trigger.output}, which is not recorded"
        raise InputError(message)
    recorder = Recorder(setup, connect, patience)
    try:
        recorder.record(duration, trigger, progress)
    except BaseException:
        if recorder.kept:
            _write(target, setup, recorder)
        raise
    return _write(target, setup, recorder)


def _write(target: Path, setup: "Setup", recorder: "Recorder") -> Acquired:
    from instruments import keyence_recorder, keyence_writer

    if recorder.started is None or not recorder.kept:
        message = "nothing was recorded: no reading came before the end"
        raise InputError(message)
    first = recorder.kept[0].slot
    start = recorder.started + timedelta(seconds=first * setup.interval)
    dataset = keyence_recorder.recording(setup, recorder.kept, start)
    keyence_writer.write(target, dataset)
    summary = {
        "readings": len(recorder.kept),
        "empty_slots": recorder.empty,
        "lost_in_ring": recorder.ring.lost,
        "trigger_row": None if recorder.trigger_slot is None else recorder.trigger_slot - first + 1,
        **asdict(recorder.tally),
        **keyence_recorder.timing(setup, recorder.kept),
        "start": start.isoformat(),
        "remark": EMULATOR_ONLY,
    }
    times = target.with_suffix(".times.csv")
    head = f"# {json.dumps(summary)}\n"
    files.write_text(times, head + "\n".join(keyence_recorder.stamps(recorder.kept)) + "\n")
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
            message = f'the unit of a display is a length such as mm or um, found "{text}"'
            raise InputError(message)

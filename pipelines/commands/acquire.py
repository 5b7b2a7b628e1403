"""The command acquire: record a running sensor into a file."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labpipe.errors import InputError
from pipelines.commands.options import echo, echo_json, json_option

if TYPE_CHECKING:
    from instruments.keyence import Acquired


class Time(click.ParamType):  # type: ignore[type-arg]  # generic only since click 8.2
    """An option such as "10 ms", in s."""

    name = "time"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return seconds."""
        from labpipe.units import quantity

        if isinstance(value, float):
            return value
        try:
            found = quantity(value)
        except InputError as error:
            self.fail(str(error), param, ctx)
        if found.si != "s" or found.value <= 0:
            self.fail(f'expected a time such as "10 ms", found "{value}"', param, ctx)
        return found.value


@click.group()
def acquire() -> None:
    r"""Record a running sensor into a file of a session.

    \b
    Example:
      labpipe acquire keyence my-session/laser/drop_1.csv --host 192.168.0.10 --duration "5 s"
    """


@acquire.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--host", required=True, help="Address of the controller.")
@click.option(
    "--port", type=click.IntRange(1, 65535), help="TCP port; default 24687 for lk-g5000, required for dl-en1."
)
@click.option(
    "--protocol", type=click.Choice(["lk-g5000", "dl-en1"]), default="lk-g5000", help="Protocol of the controller."
)
@click.option(
    "--output",
    "outputs",
    type=int,
    multiple=True,
    default=(1,),
    help="Output (or amplifier) to record; may be repeated.",
)
@click.option(
    "--decimals",
    type=int,
    multiple=True,
    required=True,
    help="Digits after the decimal sign on the display, for every output.",
)
@click.option("--unit", "units", multiple=True, default=("mm",), help="Unit on the display, for every output.")
@click.option("--interval", type=Time(), default="10 ms", help="Time between two readings.")
@click.option(
    "--duration", type=Time(), required=True, help="Duration of the recording, from the trigger if there is one."
)
@click.option("--trigger", help='Wait until an output passes a level, e.g. "out1 < -1.5 mm".')
@click.option("--before", type=Time(), default="100 ms", help="Duration kept before the trigger.")
@click.option("--patience", type=Time(), default="10 s", help="Longest wait for an answer of the controller.")
@click.option("--model", default="", show_default=False, help="Model of the controller, for the file's header.")
@json_option
def keyence(
    file: Path,
    host: str,
    port: int | None,
    protocol: str,
    outputs: tuple[int, ...],
    decimals: tuple[int, ...],
    units: tuple[str, ...],
    interval: float,
    duration: float,
    trigger: str | None,
    before: float,
    patience: float,
    model: str,
    as_json: bool,
) -> None:
    r"""Record a Keyence displacement controller over TCP into FILE.

    FILE has the layout of a storage file, so `labpipe process` reads it; FILE.times.csv holds the
    real time of every reading. A missing reading leaves its row empty. Ctrl-C ends the recording
    and keeps all readings so far; after a crash, `labpipe acquire recover` restores them. The
    protocols were tested against an emulator only.

    \b
    Example:
      labpipe acquire keyence drop_1.csv --host 192.168.0.10 --decimals 4 --duration "2 s" \
        --trigger "out1 < -0.5 mm" --interval "1 ms"
    """
    from instruments import keyence as laser

    if port is None and protocol == laser.DL_EN1:
        raise click.UsageError("--port is needed: that of a DL-EN1 is set on the unit")
    units = units * len(outputs) if len(units) == 1 else units
    decimals = decimals * len(outputs) if len(decimals) == 1 else decimals
    laser.check_units(units)
    setup = laser.Setup(outputs, decimals, units, interval, model)
    timeout = min(max(1.0, 2 * interval), patience)

    def connect() -> laser.Connection:
        return laser.Connection(protocol, host, port or laser.LK_PORT, outputs, timeout)

    with _showing(as_json) as progress:
        wanted = laser.parse_trigger(trigger, before) if trigger else None
        done = laser.record(file, setup, connect, duration, wanted, patience=patience, progress=progress)
    _tell(done, as_json)
    if not as_json:
        echo(laser.EMULATOR_ONLY)


@acquire.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@json_option
def recover(file: Path, as_json: bool) -> None:
    r"""Recover an interrupted recording from its FILE.recording.

    During a recording every reading is appended to FILE.recording, one line of JSON each. After a
    crash or a power failure, this command writes the files of the recording from it and deletes it.

    \b
    Example:
      labpipe acquire recover my-session/laser/drop_1.csv.recording
    """
    from instruments import keyence as laser

    _tell(laser.recover(file), as_json)


def _tell(done: "Acquired", as_json: bool) -> None:
    if as_json:
        echo_json({"file": str(done.path), "times": str(done.times), **done.summary})
        return
    echo(f"wrote {done.path} and {done.times}")
    for key, value in done.summary.items():
        if value not in (None, "") and key != "remark":
            shown = f"{value:.6g}" if isinstance(value, float) else value
            echo(f"  {key.replace('_', ' '):20}{shown}")


@contextmanager
def _showing(as_json: bool) -> Iterator[Callable[[int, int], None] | None]:
    """Show the number of readings as they arrive, on a terminal."""
    if as_json or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.status import Status

    with Status("waiting for the controller", console=Console(stderr=True)) as status:
        yield lambda readings, empty: status.update(
            f"{readings} readings, {empty} empty slots; Ctrl-C ends and keeps them"
        )

"""The command acquire: record a running sensor into a file."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from pipelines.commands.options import echo, echo_json, json_option
from pipelines.commands.quantities import TIME


@click.group()
def acquire() -> None:
    r"""Record a running sensor into a file of a session.

    \b
    Example:
      labpipe acquire keyence my-session/laser/drop_1.csv --host 192.168.0.10 --decimals 4 --duration "5 s"
    """


@acquire.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--host", required=True, help="Address of the controller.")
@click.option("--port", type=click.IntRange(1, 65535), help="TCP port; 24687 for lk-g5000, required for dl-en1.")
@click.option("--protocol", type=click.Choice(["lk-g5000", "dl-en1"]), default="lk-g5000", help="Of the controller.")
@click.option("--output", "outputs", type=int, multiple=True, default=(1,), help="Output to record; may be repeated.")
@click.option("--decimals", type=int, multiple=True, required=True, help="Decimals of the display, for every output.")
@click.option("--unit", "units", multiple=True, default=("mm",), help="Unit on the display, for every output.")
@click.option("--interval", type=TIME, default="10 ms", help="Time between two readings.")
@click.option("--duration", type=TIME, required=True, help="From the start, or from the trigger.")
@click.option("--trigger", help='Wait until an output passes a level, e.g. "out1 < -1.5 mm".')
@click.option("--before", type=TIME, default="100 ms", help="Duration kept before the trigger.")
@click.option("--patience", type=TIME, default="10 s", help="Longest wait for an answer of the controller.")
@json_option
def keyence(file: Path, as_json: bool, **given: Any) -> None:
    r"""Record a Keyence displacement controller over TCP into FILE.

    FILE has the layout of a storage file and is readable at any moment, also after a crash; FILE.times.csv holds the
    real time of every reading. A missing reading leaves its row empty. Ctrl-C ends the recording. The protocols were
    tested against an emulator only: compare the first readings with the display.

    \b
    Example:
      labpipe acquire keyence drop_1.csv --host 192.168.0.10 --decimals 4 --duration "2 s" \
        --trigger "out1 < -0.5 mm" --interval "1 ms"
    """
    from instruments import keyence as laser

    outputs, interval, patience = given["outputs"], given["interval"], given["patience"]
    port = given["port"] or (laser.LK_PORT if given["protocol"] == laser.LK_G5000 else None)
    if port is None:
        raise click.UsageError("--port is needed: that of a DL-EN1 is set on the unit")
    decimals, units = (each * len(outputs) if len(each) == 1 else each for each in (given["decimals"], given["units"]))
    done = laser.record(
        file,
        laser.Setup(outputs, decimals, units, interval),
        lambda: laser.Connection(
            given["protocol"], given["host"], port, outputs, min(max(1.0, 2 * interval), patience)
        ),
        given["duration"],
        laser.Trigger.of(given["trigger"]) if given["trigger"] else None,
        before=given["before"],
        patience=patience,
    )
    found = {each.name: getattr(done, each.name) for each in fields(done) if not each.name.startswith("_")}
    _show(found | {name: str(found[name]) for name in ("path", "times", "start")}, as_json)


@acquire.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@json_option
def recover(file: Path, as_json: bool) -> None:
    r"""Cut off the half line that a power failure may leave at the end of a recording.

    \b
    Example:
      labpipe acquire recover my-session/laser/drop_1.csv
    """
    from instruments import keyence as laser

    _show(laser.recover(file), as_json)


def _show(found: dict[str, Any], as_json: bool) -> None:
    if as_json:
        echo_json(found)
        return
    for name, value in found.items():
        echo(f"{name.replace('_', ' '):20}{value}")

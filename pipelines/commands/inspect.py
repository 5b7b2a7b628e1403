"""The command inspect: what a file is, what it holds, and what is wrong with it."""

from pathlib import Path
from typing import Any

import click

from pipelines.commands.options import echo, echo_json, json_option, reading_options

_SAID_APART = {"variables", "problems"}


@click.command()
@click.argument("source", metavar="FILE", type=click.Path(exists=True, path_type=Path))
@reading_options
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a picture (.png): frames of a film, columns of a table.",
)
@json_option
def inspect(source: Path, reading: dict[str, Any], out: Path | None, as_json: bool) -> None:
    r"""Say what FILE is: instrument, columns, units, ranges, sampling, problems.

    Works on any single file: readings, films, calibration records, session.toml, results,
    pictures. Nothing is written unless --out names a picture.

    \b
    Example:
      labpipe inspect my-session/laser/drop_1.csv
      labpipe inspect my-session/film/front.cine --out front.png
      labpipe inspect old/bare.csv --instrument keyence --cycle "50 us" --unit mm
    """
    from pipelines.session import describe

    found = describe(source, reading)
    if out is not None:
        from pipelines.session import write_sheet

        write_sheet(source, out, reading)
        found["picture"] = str(out)
    if as_json:
        echo_json(found)
        return
    _say(found)


def _say(found: dict[str, Any]) -> None:
    for key, value in found.items():
        if key not in _SAID_APART:
            text = f"{value:.6g}" if isinstance(value, float) else str(value)
            echo(f"{key.replace('_', ' '):20}{text}")
    rows = found.get("variables", [])
    width = max((len(row["name"]) for row in rows), default=0) + 2
    for row in rows:
        if "values" in row:
            span = ", ".join(row["values"])
        elif row["min"] is None:
            span = "no value"
        else:
            span = f"{row['min']:.6g} … {row['max']:.6g}"
        invalid = f", {row['invalid']} invalid" if row["invalid"] else ""
        name = f" ({row['long_name']})" if row["long_name"] not in ("", row["name"]) else ""
        echo(f"  {row['name']:{width}}{row['units']:8}{span}{invalid}{name}")
    for line in found["problems"] or ["none found"]:
        echo(f"problem: {line}")

"""The command inspect: what a file is, what it holds, and what is wrong with it."""

from pathlib import Path
from typing import Any

import click

from pipelines.commands.options import as_typed, echo, echo_json, json_option, reading_options


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
    pictures; of a folder it says in a line what each file is. Nothing is written unless --out
    names a picture.

    \b
    Example:
      labpipe inspect my-session/laser/drop_1.csv
      labpipe inspect my-session/film/front.cine --out front.png
      labpipe inspect old/bare.csv --instrument keyence --cycle "50 us" --unit mm
      labpipe inspect run.csv --columns 'time = "Time (s)", displacement = "Position (m)"'
    """
    from pipelines.session import inspect as look

    found = look(source, out=out, **reading)
    if as_json:
        echo_json(found)
        return
    for line in found.lines():
        echo(as_typed(line) if line.startswith("problem: ") else line)

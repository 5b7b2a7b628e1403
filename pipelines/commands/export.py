"""The command export: results and raw files as csv, netCDF, MATLAB, JSON or one table."""

from pathlib import Path
from typing import Any

import click

from pipelines.commands.options import echo, echo_json, json_option, names_option, reading_options
from pipelines.session import FORMATS


@click.command()
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@click.option("--format", "-f", "kind", type=click.Choice(FORMATS), default="csv", help="Format of the files.")
@names_option("--only", "--experiment", help="Only these experiments of a session.")
@names_option("--stage", "stages", help="Only these stages, such as bounces.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder; default SESSION/labpipe/export, or here for a file.",
)
@click.option(
    "--bulk",
    type=click.Choice(["constant", "relaxing", "incompressible"]),
    help="Bulk modulus of a material for a simulation code; default: Poisson's ratio is constant.",
)
@click.option("--force", is_flag=True, help="Replace files of the same name.")
@reading_options
@json_option
def export(
    source: Path,
    kind: str,
    only: list[str] | None,
    stages: list[str] | None,
    out: Path | None,
    bulk: str | None,
    force: bool,
    reading: dict[str, Any],
    as_json: bool,
) -> None:
    r"""Write results of a session, or a raw instrument file, for other programs.

    SOURCE is a session folder or a file of any known instrument. Values are in SI; a csv table
    has a row of units below its names, and remarks that begin with #. Of a session, xlsx and tex
    are one table with a row for each quantity: value, u, model, deviation, verdict; xlsx has the
    curves on further sheets. abaqus, ansys, comsol and lsdyna are the materials of a session as
    input of a simulation code.

    \b
    Example:
      labpipe export my-session --stage bounces --format csv
      labpipe export my-session --format xlsx
      labpipe export my-session --experiment nbr_dma --format abaqus --bulk constant
      labpipe export my-session/laser/drop_1.csv --format mat
    """
    from pipelines import process as verbs

    done = verbs.export(
        source, kind, only=only, stages=stages or (), out=out, replace=force, reading=reading, bulk=bulk
    )
    if as_json:
        echo_json({"files": [str(p) for p in done.paths], "left_out": list(done.left_out)})
        return
    for path in done.paths:
        echo(str(path))
    for line in done.left_out:
        click.echo(f"left out: {line}", err=True)

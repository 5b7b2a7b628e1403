"""Build the guide: ``python -m pipelines.guide SITE [SESSION ...]``."""

import sys
from pathlib import Path

import click

from labpipe.errors import LabpipeError
from pipelines.guide import build


@click.command()
@click.argument("site", type=click.Path(file_okay=False, path_type=Path))
@click.argument("sessions", nargs=-1, type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(site: Path, sessions: tuple[Path, ...]) -> None:
    """Write the guide into the folder SITE; processed SESSIONS give the gallery of reports.

    A tutorial is run while it is written, in a temporary folder; its pictures, and those of the
    gallery, need a Chromium.
    """
    try:
        click.echo(build(site, sessions))
    except LabpipeError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)


main()

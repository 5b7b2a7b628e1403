"""Build the guide: ``python -m pipelines.guide SITE [SESSION ...]``."""

import sys
from pathlib import Path

import click

from labpipe.errors import LabpipeError
from pipelines.guide import build


@click.command()
@click.argument("site", type=click.Path(file_okay=False, path_type=Path))
@click.argument("sessions", nargs=-1, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--keep", is_flag=True, help="Keep tutorial and pictures for the guide of the installed package.")
def main(site: Path, sessions: tuple[Path, ...], keep: bool) -> None:
    """Write the guide into the folder SITE; processed SESSIONS give the gallery of reports.

    A tutorial is run while it is written, in a temporary folder; its pictures, and those of the
    gallery, need a Chromium; without one those that the package holds are shown.
    """
    try:
        click.echo(build(site, sessions, keep=keep))
    except LabpipeError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)


main()

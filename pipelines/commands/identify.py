"""The command identify: the material behind the experiments of a session."""

import sys
from pathlib import Path
from typing import Literal

import click

from pipelines.cli import is_quiet
from pipelines.commands.options import echo, echo_json, jobs_option, json_option, names_option, session_argument


@click.command()
@session_argument
@names_option(
    "--experiments", "--only", "-e", help="Only these experiments; by default all that can identify a material."
)
@click.option("--prior", metavar="dma|NAME", help="Use the moduli of the session's rheometer experiment as prior.")
@click.option(
    "--spectrum", type=click.Choice(["smooth", "fractional"]), default="smooth", help="Family of relaxation spectra."
)
@click.option(
    "--impacts", default=6, type=click.IntRange(min=1, max=100), help="Number of bounces of a drop that are evaluated."
)
@click.option(
    "--sampler",
    type=click.Choice(["laplace", "rto"]),
    default="laplace",
    help="Normal approximation alone, or with independent draws of the posterior.",
)
@jobs_option
@json_option
def identify(session: Path, experiments: list[str] | None, prior: str | None,
             spectrum: Literal["smooth", "fractional"], impacts: int,
             sampler: Literal["laplace", "rto"], jobs: int, as_json: bool,
             ) -> None:  # fmt: skip
    r"""Identify the viscoelastic materials of the experiments in SESSION, with credible intervals.

    Drops, contact films, relaxations and harmonic indentations of one material are fitted
    together. What is missing is processed first. One page and one netCDF file per material:
    SESSION/labpipe/identify_MATERIAL.html and .nc.

    \b
    Example:
      labpipe identify my-session
      labpipe identify my-session -e acrylic_5mm -e acrylic_10mm
      labpipe identify my-session -e nbr_relaxation --prior dma
    """
    from pipelines.identify import identify as verb

    found = verb(
        session, experiments or (), prior=prior, spectrum=spectrum, impacts=impacts,
        sampler=sampler, jobs=jobs, say=_say,
    )  # fmt: skip
    if as_json:
        echo_json(found.documents())
        return
    for line in found.lines():
        echo(line)


def _say(text: str) -> None:
    """Tell a terminal what goes on; a file or a pipe gets nothing."""
    if sys.stderr.isatty() and not is_quiet():
        click.echo(text, err=True)

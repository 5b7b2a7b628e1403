"""The command identify: the material behind the experiments of a session."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipelines.commands.options import echo, echo_json, jobs_option, json_option, session_argument

if TYPE_CHECKING:
    from pipelines.identify import Identified

STEM = "identify_"


@click.command()
@session_argument
@click.option(
    "--experiments",
    "-e",
    multiple=True,
    metavar="NAME",
    help="Only these experiments; by default all that can identify a material. Repeatable.",
)
@click.option("--prior", metavar="dma|NAME", help="Use the moduli of the session's rheometer experiment as prior.")
@click.option(
    "--spectrum",
    type=click.Choice(["smooth", "fractional"]),
    default="smooth",
    show_default=True,
    help="Family of relaxation spectra.",
)
@click.option(
    "--impacts",
    default=6,
    show_default=True,
    type=click.IntRange(min=1, max=100),
    help="Number of bounces of a drop that are evaluated.",
)
@click.option(
    "--no-profile", is_flag=True, help="Do not examine whether the data determine the long-time modulus (faster)."
)
@click.option(
    "--sampler",
    type=click.Choice(["laplace", "rto"]),
    default="laplace",
    show_default=True,
    help="Normal approximation alone, or with independent draws of the posterior.",
)
@jobs_option
@json_option
def identify(
    session: Path,
    experiments: tuple[str, ...],
    prior: str | None,
    spectrum: str,
    impacts: int,
    no_profile: bool,
    sampler: str,
    jobs: int,
    as_json: bool,
) -> None:
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
    from labpipe import files
    from pipelines import process
    from pipelines.identify import Wish, dataset, document, render
    from pipelines.identify import identify as found_in

    wish = Wish(experiments, prior, spectrum, impacts, not no_profile, sampler)
    found = found_in(session, wish, say=_say, jobs=jobs)
    opened = process.reopen_session(session)
    documents = []
    for one in found:
        stem = STEM + "".join(c if c.isalnum() or c in "-_" else "_" for c in one.material)
        page, result = opened.folder / f"{stem}.html", opened.folder / f"{stem}.nc"
        files.write_dataset(result, dataset(one))
        files.write_text(page, render(opened, one))
        documents.append(document(one) | {"page": str(page), "result": str(result)})
        if not as_json:
            for text in lines(one):
                echo(text)
            echo(f"page: {page}")
    if as_json:
        echo_json(documents)


def _say(text: str) -> None:
    """Tell a terminal what goes on; a file or a pipe gets nothing."""
    if sys.stderr.isatty():
        click.echo(text, err=True)


def lines(found: "Identified") -> list[str]:
    """Return the main results as lines of text."""
    from pipelines.identify import relaxed_text, statements

    return [f"{found.material}: {relaxed_text(found)}", *(f"  {s}" for s in statements(found))]

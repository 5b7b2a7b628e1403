"""Options and output habits that several commands share."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from pipelines.cli import printable

#: Each may hold half a gigabyte; more are for who knows the machine.
_MOST_JOBS = 8

F = TypeVar("F", bound=Callable[..., Any])


def json_option(function: F) -> F:
    """Add ``--json``: one JSON document on stdout and nothing else."""
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")(
        function
    )


def session_argument(function: F) -> F:
    """Add the argument SESSION, a folder that holds session.toml."""
    kind = click.Path(exists=True, file_okay=False, path_type=Path)
    return click.argument("session", type=kind, metavar="SESSION")(function)


def jobs_option(function: F) -> F:
    """Add ``--jobs``: how many experiments are processed at the same time."""

    def usual() -> int:
        from labpipe.workflow.engines import processors

        return min(processors(), _MOST_JOBS)

    return click.option(
        "--jobs", "-j", default=usual, type=click.IntRange(min=0),
        show_default=f"one per processor, at most {_MOST_JOBS}",
        help="Experiments side by side; 0 runs everything in this process.",
    )(function)  # fmt: skip


def cluster_option(function: F) -> F:
    """Add ``--cluster``: a Dask scheduler in place of local processes."""
    return click.option(
        "--cluster", metavar="ADDRESS", help="A Dask scheduler, tcp://host:port, computes instead."
    )(function)


def echo(text: str) -> None:
    """Print text to stdout, stripped of what could repaint the terminal."""
    click.echo(printable(text))


def echo_json(document: Any) -> None:
    """Print one JSON document."""
    click.echo(json.dumps(document, indent=2, ensure_ascii=False, default=str))

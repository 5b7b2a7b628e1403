"""Progress of a run on stderr, and only when it is a terminal."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from labpipe.workflow.results import Event


def is_shown() -> bool:
    """Whether progress may be shown: to a person at a terminal who wants to see it."""
    from pipelines.cli import is_quiet
    from pipelines.commands.options import wants_json

    return sys.stderr.isatty() and not wants_json() and not is_quiet()


@contextmanager
def progress(
    text: str = "", total: float | None = None, *, is_counted: bool = False
) -> Iterator[Callable[..., Any] | None]:
    """Give a function that shows how much of some work is done, as one number, or None without a terminal.

    Without a total only the time is shown, as the end is not known; counted work shows how many pieces of how many.
    The function also takes ``description`` and ``total``, where they change.
    """
    if not is_shown():
        yield None
        return
    from rich import progress as rich
    from rich.console import Console
    from rich.markup import escape

    done: rich.ProgressColumn = rich.SpinnerColumn() if total is None else rich.TaskProgressColumn()
    done = rich.MofNCompleteColumn() if is_counted else done
    clocks = (rich.TimeElapsedColumn(), rich.TextColumn("left"), rich.TimeRemainingColumn(compact=True))
    columns = (rich.TextColumn("{task.description}"), rich.BarColumn(), done, *clocks)
    # stdout stays where it is: a list of results may go into a file while the bar is shown
    with rich.Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        work = bar.add_task(text, total=total)

        def show(completed: float, description: str | None = None, total: float | None = None) -> None:
            bar.update(work, completed=completed, total=total, description=description and escape(description))

        yield show


@contextmanager
def watching() -> "Iterator[Callable[[Event], None] | None]":
    """Give a function that shows the events of a run, or None without a terminal."""
    cached, done, total = Counter[Path](), Counter[Path](), Counter[Path]()
    with progress("planning", is_counted=True) as bar:

        def show(event: "Event") -> None:
            one = event.session
            if event.kind == "planned":
                click.echo(f"{one.name}: {event.message}", err=True)
            # Kept results took no time; counted as work they would promise an end too soon.
            cached[one] += event.kind in ("cached", "kept")
            done[one], total[one] = event.done - cached[one], event.total - cached[one]
            text = f"{event.task.experiment}: {event.task.stage}"
            if bar is not None:
                bar(done.total(), f"{one.name}: {text}" if len(total) > 1 else text, total.total())

        yield None if bar is None else show


@contextmanager
def counted(total: int) -> Iterator[Callable[[str], None] | None]:
    """Give a function that reports by name that a piece of work begins, or None without a terminal."""
    with progress(total=total, is_counted=True) as bar:
        done = count()
        yield None if bar is None else lambda text: bar(next(done), text)

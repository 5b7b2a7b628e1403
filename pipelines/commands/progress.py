"""Progress of a run on stderr, and only when it is a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from labpipe.workflow.runner import Event


@contextmanager
def watching(enabled: bool = True) -> "Iterator[Callable[[Event], None] | None]":
    """Give a function that shows the events of a run, or None where nobody looks."""
    if not enabled or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Remaining())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        overall = bar.add_task("planning", total=None)

        def show(event: "Event") -> None:
            text = escape(f"{event.task.experiment}: {event.task.stage}")
            bar.update(overall, total=event.total, completed=event.done, description=text)

        yield show


@contextmanager
def fraction(text: str) -> "Iterator[Callable[[float], None]]":
    """Give a function that shows a fraction of one long piece of work."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), Remaining())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        work = bar.add_task(text, total=1.0)
        yield lambda done: bar.update(work, completed=done)

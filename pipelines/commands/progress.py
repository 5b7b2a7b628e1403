"""Progress of a run on stderr, and only when it is a terminal."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

    from labpipe.workflow.results import Event


def is_shown() -> bool:
    """Whether progress may be shown: to a person at a terminal who wants to see it."""
    from pipelines.cli import is_quiet
    from pipelines.commands.options import wants_json

    return sys.stderr.isatty() and not wants_json() and not is_quiet()


@contextmanager
def watching() -> "Iterator[Callable[[Event], None] | None]":
    """Give a function that shows the events of a run, or None without a terminal."""
    if not is_shown():
        yield None
        return
    from rich.markup import escape
    from rich.progress import MofNCompleteColumn

    with _bar(MofNCompleteColumn()) as bar:
        overall = bar.add_task("planning", total=None)
        cached, done, total = Counter[Path](), Counter[Path](), Counter[Path]()

        def show(event: "Event") -> None:
            one = event.session
            if event.kind == "planned":
                bar.console.print(escape(f"{one.name}: {event.message}"), highlight=False)
            # Kept results took no time; counted as work they would promise an end too soon.
            cached[one] += event.kind in ("cached", "kept")
            done[one], total[one] = event.done - cached[one], event.total - cached[one]
            text = f"{event.task.experiment}: {event.task.stage}"
            text = escape(f"{one.name}: {text}" if len(total) > 1 else text)
            bar.update(overall, total=total.total(), completed=done.total(), description=text)

        yield show


@contextmanager
def progress(text: str = "", total: float | None = None) -> "Iterator[Callable[[float], None] | None]":
    """Give a function that shows how much of some work is done, or None without a terminal.

    Without a total only the time is shown, as the end is not known.
    """
    if not is_shown():
        yield None
        return
    from rich.progress import SpinnerColumn, TaskProgressColumn

    with _bar(SpinnerColumn() if total is None else TaskProgressColumn()) as bar:
        work = bar.add_task(text, total=total)
        yield lambda done: bar.update(work, completed=done)


@contextmanager
def counted(total: int) -> "Iterator[Callable[[str], None] | None]":
    """Give a function that reports by name that a piece of work begins, or None without a terminal."""
    if not is_shown():
        yield None
        return
    from rich.markup import escape
    from rich.progress import MofNCompleteColumn

    # stdout stays where it is: a list of results may go into a file while the bar is shown
    with _bar(MofNCompleteColumn(), redirect_stdout=False) as bar:
        work = bar.add_task("", total=total)
        done = count()
        yield lambda text: bar.update(work, completed=next(done), description=escape(text))


def _bar(done: "ProgressColumn", *, redirect_stdout: bool = True) -> "Progress":
    """Return a bar on stderr with the work done, the time gone, and the time left."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    clocks = (TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(compact=True))
    columns = (TextColumn("{task.description}"), BarColumn(), done, *clocks)
    return Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=redirect_stdout)

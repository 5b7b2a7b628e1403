"""Options and output common to several commands."""

import functools
import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from labpipe.errors import InputError, SourceError, UsageError
from pipelines.cli import is_quiet, printable

#: Each may hold half a gigabyte; more are for who knows the machine.
_MOST_JOBS = 8

F = TypeVar("F", bound=Callable[..., Any])

FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)
"""Type of an argument: a folder that is there."""
NEW_FILE, NEW_FOLDER = (click.Path(dir_okay=is_dir, file_okay=not is_dir, path_type=Path) for is_dir in (False, True))
"""Types of an argument: a file, or a folder, that is written."""
_JSON = "labpipe.json"  # in the context of the command that runs
json_option = click.option(
    "--json",
    is_flag=True,
    expose_value=False,
    callback=lambda context, _, value: context.meta.update({_JSON: value}),
    help="Print one JSON document.",
)
session_argument = click.argument("session", type=FOLDER, metavar="SESSION")
cluster_option = click.option("--cluster", metavar="ADDRESS", help="Let a Dask scheduler, tcp://host:port, compute.")
keep_option = click.option("--keep", is_flag=True, help="Take results of earlier code as they are, and mark them.")


def _usual_jobs() -> int:
    from labpipe.workflow.engines import processors

    return min(processors(), _MOST_JOBS)


jobs_option = click.option(
    "--jobs",
    "-j",
    default=_usual_jobs,
    type=click.IntRange(min=0),
    show_default=f"one per processor, at most {_MOST_JOBS}",
    help="Experiments side by side; 0 runs everything in this process.",
)


def names_option(*declared: str, help: str) -> Callable[[F], F]:  # noqa: A002  # as click calls it
    """Add an option that takes names: repeated, or several with commas; None where it is not given."""

    def split(context: click.Context, option: click.Parameter, values: Sequence[str]) -> list[str] | None:
        return [name.strip() for value in values for name in value.split(",") if name.strip()] or None

    return click.option(*declared, multiple=True, callback=split, metavar="NAME[,NAME…]", help=help)


def wants_json() -> bool:
    """Whether the command that runs prints one JSON document."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(_JSON))


def emit(document: Any, lines: Iterable[str], *, errors: Iterable[str] = (), code: int = 0) -> None:
    """Print one JSON document, or lines of text and errors instead; end with the exit code where it is not 0.

    Quiet commands print errors alone; lines are made only where they are printed.
    """
    if wants_json():
        click.echo(json.dumps(document, indent=2, ensure_ascii=False, default=str))
    else:
        for line in () if is_quiet() else lines:
            click.echo(printable(line))
        for line in errors:
            click.echo(line, err=True)
    if code:
        click.get_current_context().exit(code)


def members(found: object, *names: str) -> dict[str, Any]:
    """Return members of an object by name, for a document."""
    return {name: getattr(found, name) for name in names}


def reading_options(function: F) -> F:
    """Add ``--instrument`` and the options of readers, for values that a raw file does not hold.

    They come to the function as one dictionary ``reading``, for :func:`instruments.read`. An error
    of a reader names an option as Python does; it is shown as it is typed here.
    """

    @click.option("--instrument", metavar="NAME", help="What wrote the file, where it does not say so: keyence, …")
    @click.option("--columns", help='Any table: \'time = "Time (s)", displacement = "Position (m)"\'.')
    @click.option("--cycle", help='Keyence file: time between samples, e.g. "50 us".')
    @click.option("--unit", "units", multiple=True, help="Keyence file: unit of each output, in order.")
    @click.option("--storage-factor", type=click.IntRange(min=1), help="Keyence file: samples per stored point.")
    @click.option("--option", "others", multiple=True, metavar="NAME=VALUE", help="Another one, e.g. fps=1000.")
    @functools.wraps(function)
    def reading(*args: Any, instrument: str | None, others: tuple[str, ...], **kwargs: Any) -> Any:
        given = {name: kwargs.pop(name) for name in ("columns", "cycle", "units", "storage_factor")}
        given = {name: list(v) if isinstance(v, tuple) else v for name, v in given.items() if v}
        try:
            if instrument is not None or others:
                import instruments

                fps = 1.0 if any(text.startswith("fps=") for text in others) else None  # a film, whatever it is
                found = instruments.by_name(instrument or instruments.identify(kwargs["source"], fps=fps))
                for text in others:
                    name, sign, value = text.partition("=")
                    if not sign:
                        raise UsageError(f'--option reads NAME=VALUE, found "{text}"')
                    given[name] = found.option(name, value)
                given["instrument"] = found.name
            return function(*args, reading=given, **kwargs)
        except SourceError as error:
            error.hint = error.hint and as_typed(error.hint)
            raise
        except InputError as error:
            raise InputError(as_typed(str(error))) from None

    return reading  # type: ignore[return-value]  # click fills in the options


_PYTHON = re.compile(r'\b([a-z][a-z_]*)=(\[[^\]]*\]|"[^"]*"|True|[0-9.]*[0-9])')


def as_typed(hint: str) -> str:
    """Turn options as they are written in Python into those of the command line."""
    import instruments

    def typed(match: re.Match[str]) -> str:
        name, value = match[1], match[2] if " " in match[2] else match[2].strip('"')
        if name not in {"instrument", *instruments.Options.__annotations__}:  # the content of a file is shown as it is
            return match[0]
        if name == "units":
            return " ".join(f"--unit {unit}" for unit in re.findall(r'"([^"]*)"', value))
        if name in ("instrument", "columns", "cycle", "storage_factor"):
            return f"--{name.replace('_', '-')} {value}"
        return f"--option {name}={value.replace('True', 'true')}"

    return _PYTHON.sub(typed, hint)

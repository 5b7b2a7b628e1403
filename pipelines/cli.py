"""The command line ``labpipe``: its commands, and how errors are reported.

Nothing numerical is imported here; each command imports what it needs when it runs, so that
``--help``, ``plan`` and completion answer at once.
"""

import importlib
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import click

from labpipe.errors import ConfigError, InstallationError, LabpipeError, SourceError, StorageError
from labpipe.installation import __version__, foreign_package


@dataclass(frozen=True, slots=True)
class Command:
    """Where a command lives and what it says of itself in the list of commands."""

    target: str
    summary: str


_HOME = "pipelines.commands"
_USAGE = 2  # exit code of a line that cannot be understood
COMMANDS: dict[str, Command] = {
    "demo": Command(f"{_HOME}.system:demo", "Write a synthetic session and process it."),
    "open": Command(f"{_HOME}.system:open_", "Set up, run and read a session in a local page."),
    "init": Command(f"{_HOME}.session:init", "Scan a folder and write a commented session.toml."),
    "inspect": Command(f"{_HOME}.results:inspect", "Show what a file is and its problems."),
    "plan": Command(f"{_HOME}.session:plan", "Show what `process` would run, and why."),
    "process": Command(f"{_HOME}.session:process", "Process a session into results and reports."),
    "note": Command(f"{_HOME}.session:note", "Append a dated note to an experiment."),
    "watch": Command(f"{_HOME}.session:watch", "Process a session while it is being recorded."),
    "acquire": Command(f"{_HOME}.system:acquire", "Record a running sensor into a file."),
    "export": Command(f"{_HOME}.results:export", "Write results as tables, netCDF, or input of other codes."),
    "publish": Command(f"{_HOME}.results:publish", "Write a session as a data package (RO-Crate)."),
    "verify": Command(f"{_HOME}.results:verify", "Check a data package by processing it again."),
    "cite": Command(f"{_HOME}.results:cite", "Print the sources to be cited, as BibTeX."),
    "bundle": Command(f"{_HOME}.results:bundle", "Pack pages and results into one zip to be mailed."),
    "compare": Command(f"{_HOME}.results:compare", "Compare measurement and model on one page."),
    "catalogue": Command(f"{_HOME}.results:catalogue", "List many sessions as one table."),
    "trend": Command(f"{_HOME}.results:trend", "Chart the quantities of many sessions over time."),
    "identify": Command(f"{_HOME}.results:identify", "Identify the material of the experiments."),
    "sensitivity": Command(f"{_HOME}.results:sensitivity", "Show which inputs limit each uncertainty."),
    "figures": Command(f"{_HOME}.system:figures", "Draw the thesis's figures by number."),
    "simulate": Command(f"{_HOME}.simulate:simulate", "Run the bundled simulator alone."),
    "sweep": Command(f"{_HOME}.simulate:sweep", "Map the simulator over its parameters."),
    "sample": Command(f"{_HOME}.system:sample", "Write a synthetic session with its true values."),
    "bench": Command(f"{_HOME}.system:bench", "Measure accuracy against run time of every part."),
    "doctor": Command(f"{_HOME}.system:doctor", "Check the installation; audit a session."),
    "completion": Command(f"{_HOME}.system:completion", "Print the script for bash, zsh or fish."),
}


def _keep_examples(command: click.Command) -> None:
    """Let the lines of examples stand as they are written.

    click wants a backspace for that; docstrings spell it out, because they are raw.
    """
    command.help = (command.help or "").replace("\\b\n", "\b\n")
    for inner in command.commands.values() if isinstance(command, click.Group) else ():
        _keep_examples(inner)


class LazyGroup(click.Group):
    """A group that imports a command only when it is called, not when it is listed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command."""
        entry = COMMANDS.get(cmd_name)
        if entry is None:
            return None
        module, name = entry.target.split(":")
        command: click.Command = getattr(importlib.import_module(module), name)
        _keep_examples(command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Suggest the nearest command for a misspelt one."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            import difflib

            near = difflib.get_close_matches(args[0], COMMANDS, n=1)
            hint = f' Did you mean "{near[0]}"?' if near else " See `labpipe --help`."
            raise click.UsageError(f'There is no command "{args[0]}".{hint}', ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands from the table, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.summary) for name, entry in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(__version__, prog_name="labpipe")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.option("--quiet", is_flag=True, help="Print errors alone; the exit code says how it ended.")
def cli(debug: bool, quiet: bool) -> None:
    """From raw contact-mechanics files to calibrated results, the simulation, and a report.

    \b
    Example:
      labpipe demo                 # a synthetic session, processed
      labpipe init  my-session     # write my-session/session.toml
      labpipe plan  my-session
      labpipe process my-session   # then open my-session/labpipe/reports/
    """  # noqa: D301


def is_quiet() -> bool:
    """Tell whether the command that runs was asked to print errors alone."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.find_root().params.get("quiet"))


def as_document(error: LabpipeError) -> dict[str, Any]:
    """Return an error as the JSON document that ``--json`` prints."""
    document: dict[str, Any] = {"type": type(error).__name__, "message": str(error)}
    if isinstance(error, SourceError):
        document |= {"path": error.path, "line": error.line, "column": error.column}
    if isinstance(error, ConfigError):
        document["problems"] = list(error.problems)
    return {"error": document, "exit_code": error.exit_code}


def printable(text: str) -> str:
    """Strip control characters, which a file's text could use to repaint the terminal."""
    return "".join(c for c in text if c in "\n\t" or (c.isprintable() and c != "\x7f"))


def report_error(error: LabpipeError, wants_json: bool) -> int:
    """Print one error where it belongs and return its exit code."""
    if wants_json:
        click.echo(json.dumps(as_document(error), indent=2))
    else:
        click.echo(f"error: {printable(str(error))}", err=True)
    return error.exit_code


def report_usage(error: click.UsageError, wants_json: bool) -> int:
    """Say what is wrong with the line that was typed, and return the exit code."""
    if wants_json:
        document = {"type": "UsageError", "message": error.format_message()}
        click.echo(json.dumps({"error": document, "exit_code": _USAGE}, indent=2))
    else:
        error.show()
    return _USAGE


class Terminated(BaseException):
    """The system asked the program to end; what is half-done is undone on the way out."""

    def __init__(self, number: int) -> None:
        self.exit_code = 128 + number
        super().__init__(f"signal {number}")


def _end_cleanly() -> None:
    """Let a closed terminal or an order to end undo what is half-done, as Ctrl-C does."""
    import signal

    def stop(number: int, frame: object) -> None:
        del frame
        raise Terminated(number)

    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):  # Windows knows no hang-up
            signal.signal(getattr(signal, name), stop)


def _warn_plainly(is_silent: bool) -> None:
    """Show warnings as sentences, each once; the line of code that raised one is of no use to who reads files."""
    import warnings

    told: set[str] = set()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        text = printable(str(message))
        if not is_silent and text not in told:
            told.add(text)
            click.echo(f"warning: {text}", err=True)

    warnings.showwarning = show


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit code."""
    is_program = arguments is None
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    debug, wants_json = "--debug" in arguments, "--json" in arguments
    if is_program:
        _end_cleanly()
        if not debug:
            _warn_plainly(is_silent="--quiet" in arguments)
    # These are welcome anywhere in the line; click knows them only before the command.
    anywhere = ("--debug", "--quiet")
    arguments = [a for a in anywhere if a in arguments] + [a for a in arguments if a not in anywhere]
    if (clash := foreign_package(["instruments", "calibration"])) is not None:
        sys.exit(report_error(InstallationError(clash), wants_json))
    try:
        code = cli.main(args=arguments, prog_name="labpipe", standalone_mode=False) or 0
    except click.UsageError as error:
        code = report_usage(error, wants_json)
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted; results that were complete are kept", err=True)
        code = 130
    except Terminated as error:
        code = error.exit_code
    except LabpipeError as error:
        if debug:
            raise
        code = report_error(error, wants_json)
    except BrokenPipeError:
        code = 0
    except OSError as error:
        if debug:
            raise
        message = f"{error.filename or 'the file system'}: {error.strerror or error}"
        code = report_error(StorageError(f"{message}; check permission and free space"), wants_json)
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()

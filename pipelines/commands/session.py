"""Commands on a session folder: init, plan, process."""

import itertools
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labpipe.errors import LabpipeError, StorageError
from pipelines.cli import as_document as error_document, printable, report_error
from pipelines.commands.options import (
    cluster_option,
    echo,
    echo_json,
    jobs_option,
    json_option,
    keep_option,
    names_option,
    session_argument,
)
from pipelines.session import PAGE

if TYPE_CHECKING:
    from labpipe.workflow.plan import Row
    from labpipe.workflow.run_result import RunResult
    from pipelines.session import Gap, Verdicts

_STATE_WIDTH = 10
_NEVER_RUN = "never run"


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option("--force", is_flag=True, help="Replace a session.toml that is already there.")
@click.option("--ask/--no-ask", default=None, help="Ask for what no file contains; default: ask at a terminal.")
@click.option(
    "--template",
    multiple=True,
    metavar="KIND",
    help="No scan: the tables of this kind, every value to fill in; makes FOLDER if need be. Repeatable.",
)
@json_option
def init(folder: Path, force: bool, ask: bool | None, template: tuple[str, ...], as_json: bool) -> None:
    r"""Scan FOLDER and write a commented session.toml.

    Instruments are recognised by the content of their files. What the files do not contain (mass,
    radius, material, drop height, inclination of the laser) is asked for; an empty answer leaves a
    line to fill in, marked with FILL, and its experiment waits until it is filled; the others can be
    processed. For a missing calibration record a template is written.

    \b
    Example:
      labpipe init my-session
      labpipe init tomorrow --template ball_drop --template dma
    """
    from pipelines.session import init as verb

    is_person = sys.stdin.isatty() and not as_json
    asker = _Asker() if (is_person if ask is None else ask) else None
    found = verb(folder, replace=force, ask=asker, template=template)
    if as_json:
        echo_json(
            {
                "path": str(found.path),
                "experiments": found.experiments,
                "to_fill": found.gaps,
                "records": [str(p) for p in found.records],
                "unused": found.unused,
            }
        )
        return
    n = len(found.experiments)
    echo(f"wrote {found.path} with {n} experiment{'s' * (n != 1)}")
    for path in found.records:
        is_open = any(line.startswith(path.relative_to(folder).as_posix()) for line in found.gaps)
        echo(f"wrote {path}, a calibration record{' to complete' if is_open else ''}")
    for line in found.gaps:
        echo(f"  to fill in: {line}")
    for line in found.unused:
        echo(f"  not used: {line}")
    echo(f"then: labpipe plan {folder}")


class _Asker:
    """Asks a person; the last answer to the same question is offered for the next one."""

    def __init__(self) -> None:
        self.last: dict[tuple[str, str, str], str] = {}
        self.has_begun = False

    def __call__(self, gap: "Gap") -> str | None:
        """Ask until the answer fits or is empty."""
        from pipelines.session import checked

        if not self.has_begun:
            click.echo("Not in the files: please answer. Enter alone leaves it open, Ctrl-C writes nothing.", err=True)
            self.has_begun = True
        while True:
            default = self.last.get(gap.sort, "")
            answer = click.prompt(printable(gap.question), default=default, show_default=bool(default), err=True)
            if not answer.strip():
                return None
            try:
                self.last[gap.sort] = checked(gap, answer)
            except LabpipeError as error:
                click.echo(f"  {printable(str(error))}", err=True)
                continue
            return self.last[gap.sort]


_TO = names_option("--to", "targets", help="Only these stages and what they need.")
_TOLD = 3  # findings on one experiment that a command prints
_ONLY = names_option("--only", help="Only these experiments and what they need.")
_FULL = click.option("--full", is_flag=True, help="Without shortcuts: read and solve everything.")


@click.command()
@session_argument
@_TO
@_ONLY
@_FULL
@keep_option
@json_option
def plan(
    session: Path, targets: list[str] | None, only: list[str] | None, full: bool, keep: bool, as_json: bool
) -> None:
    r"""Say what `process` would run, and why; nothing is computed.

    A summary comes first, with the experiments that wait and for which lines; then the steps, in one line
    where all of an experiment share one reason.

    \b
    Example:
      labpipe plan my-session --to velocity
    """
    from pipelines import process as verbs

    made = verbs.plan(session, targets, only, full=full, keep=keep)
    exact = verbs.stated_as_exact(made.session)
    if as_json:
        names = ("experiment", "stage", "recording", "state", "reason")
        rows = [{n: getattr(row, n) for n in names} for row in made.rows]
        document = {"rows": rows, "to_run": len(made.to_run), "estimate": made.estimate}
        echo_json(document | {"waiting": made.session.waiting, "exact": exact})
        return
    echo(f"{made.summary}")
    _show_waiting(made.session.waiting)
    for values, stating in exact.items():
        echo(f"counted as exact, since stated without ±: {values} ({', '.join(stating)})")
    for experiment, own in itertools.groupby(made.rows, key=lambda row: row.experiment):
        echo(f"\n{experiment} ({made.session.experiments[experiment].kind})")
        _show_steps(list(own))


def _show_waiting(waiting: "Mapping[str, Sequence[str]]") -> None:
    """Say which experiments wait, and each line that they wait for."""
    for name, lines in waiting.items():
        echo(f"waiting: {name}")
        for line in lines:
            echo(f"  {line}")


def _show_steps(rows: "list[Row]") -> None:
    """Print one row per step; one for all where all are in the same state for the same reason."""
    if len(rows) > 1 and len({(row.state, row.reason) for row in rows}) == 1:
        echo(f"  {rows[0].state:{_STATE_WIDTH}}{f'all {len(rows)} steps':44} {rows[0].reason}".rstrip())
        return
    if all(row.reason.startswith(_NEVER_RUN) for row in rows):
        echo(f"  {'will run':{_STATE_WIDTH}}{f'all {len(rows)} steps':44} {_NEVER_RUN}")
        return
    for row in rows:
        name = row.stage if row.recording is None else f"{row.stage} [{row.recording}]"
        echo(f"  {row.state:{_STATE_WIDTH}}{name:44} {row.reason}".rstrip())


@click.command()
@click.argument(
    "sessions",
    nargs=-1,
    required=True,
    metavar="SESSION...",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
)
@_TO
@_ONLY
@_FULL
@keep_option
@jobs_option
@cluster_option
@click.option("--fail-fast", is_flag=True, help="Stop at the first failure.")
@json_option
def process(
    sessions: tuple[Path, ...], targets: list[str] | None, only: list[str] | None, as_json: bool, **options: Any
) -> None:
    r"""Process session folders: results and one report per experiment.

    What is already there and still true is kept. A failed experiment does not stop the others, nor
    does one with values to fill in or correct, which waits (exit code 1), nor a session that cannot be opened.

    \b
    Example:
      labpipe process my-session
      labpipe process sessions/* --cluster tcp://head:8786
    """
    from pipelines import process as verbs
    from pipelines.commands.progress import watching

    folders = list({folder.resolve(): folder for folder in sessions}.values())
    with watching(enabled=not as_json) as progress:
        ended = dict(verbs.process_all(folders, targets=targets, only=only, progress=progress, **options))
    if len(folders) == 1 and isinstance(error := ended[folders[0]], LabpipeError):
        raise error
    judged = {folder: verbs.verdicts_of(done) for folder, done in ended.items() if not isinstance(done, LabpipeError)}
    codes = {done.exit_code for done in ended.values()}
    waits = any(done.session.waiting for done in ended.values() if not isinstance(done, LabpipeError))
    if waits or any(found.is_impossible for found in judged.values()):
        codes = (codes - {0}) | {1}
    code = _common_code(codes)
    ended = {folder: ended[folder] for folder in folders if folder in ended}
    if as_json:
        documents = [as_document(done, folder, judged.get(folder)) for folder, done in ended.items()]
        echo_json(documents[0] if len(folders) == 1 else {"sessions": documents, "exit_code": code})
    else:
        for folder, done in ended.items():
            if len(folders) > 1:
                echo(f"{folder}:")
            summarise(done, judged.get(folder))
    click.get_current_context().exit(code)


def _common_code(codes: set[int]) -> int:
    """Return the exit code of several sessions.

    Examples
    --------
    >>> _common_code({3}), _common_code({0, 3}), _common_code({0, 5})
    (3, 1, 5)
    """
    if StorageError.exit_code in codes:
        return StorageError.exit_code
    return codes.pop() if len(codes) == 1 else 1


def as_document(outcome: "RunResult | LabpipeError", folder: Path, judged: "Verdicts | None" = None) -> dict[str, Any]:
    """Return a run, or why there was none, as one JSON document."""
    if isinstance(outcome, LabpipeError):
        return {"session": str(folder), **error_document(outcome)}
    return {
        "session": str(outcome.session.root),
        "steps": [
            {
                "experiment": o.task.experiment,
                "stage": o.task.stage,
                "recording": o.task.recording,
                "state": o.state,
                "message": o.message,
            }
            for o in outcome.outcomes
        ],
        "experiments": [] if judged is None else judged.document(),
        "findings": [] if judged is None else judged.notes_document(),
        "reports": {name: str(path) for name, path in outcome.reports.items()},
        "waiting": outcome.session.waiting,
        "exit_code": outcome.exit_code
        or int(bool(outcome.session.waiting) or (judged is not None and judged.is_impossible)),
    }


def summarise(outcome: "RunResult | LabpipeError", judged: "Verdicts | None" = None) -> None:
    """Say how a run ended and where its reports are."""
    if isinstance(outcome, LabpipeError):
        report_error(outcome, wants_json=False)
        return
    count = Counter(o.state for o in outcome.outcomes)
    echo(", ".join(f"{n} {state}" for state, n in sorted(count.items())) or "nothing to do")
    for o in outcome.failures:
        click.echo(f"failed: {o.task}: {o.message}", err=True)
    for one in () if judged is None else judged.experiments:
        if one.state == "waiting":  # its lines are told below, with those that nobody judged
            continue
        grave = [f"{f.message} [{f.place}]" if f.place else f.message for f in one.findings if f.level != "note"]
        more = f"; and {len(grave) - _TOLD} more on its page" if len(grave) > _TOLD else ""
        told = "; ".join(grave[:_TOLD]) + more
        model = f", model: {one.model}" if one.model != "none" else ""
        echo(f"{one.experiment}: believable: {one.believable}{model}{told and f' ({told})'}")
        # what a note hints at stands on the page
        if likely := one.cause if told else next(iter(one.suspects), ""):
            echo(f"  likely: {likely}")
    for note in () if judged is None else judged.notes:
        echo(f"note: {note.message}: {note.cause}")
    _show_waiting(outcome.session.waiting)
    for path in outcome.reports.values():
        echo(f"report: {path}")
    if (overview := outcome.session.folder / PAGE).is_file():
        echo(f"all experiments: {overview}")

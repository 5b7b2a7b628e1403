"""Commands on a session folder: init, plan, process, watch."""

import itertools
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labpipe.errors import LabpipeError, StorageError
from labpipe.notebook import text_table
from labpipe.workflow.exclusions import exclusions
from pipelines import session as verbs
from pipelines.cli import as_document as error_document, printable, report_error
from pipelines.commands.options import (
    FOLDER,
    NEW_FOLDER,
    cluster_option,
    emit,
    jobs_option,
    json_option,
    keep_option,
    members,
    names_option,
    session_argument,
    wants_json,
)
from pipelines.commands.progress import watching

if TYPE_CHECKING:
    from labpipe.workflow.results import RunResult
    from labpipe.workflow.session import Session
    from pipelines.session import Gap, Verdicts

_NEVER_RUN = "never run"
_SHOWN = 3  # findings on one experiment that a command prints


@click.command()
@click.argument("folder", type=NEW_FOLDER)
@click.option("--force", is_flag=True, help="Replace a session.toml that is already there.")
@click.option("--ask/--no-ask", default=None, help="Ask for what no file contains; default: ask at a terminal.")
@click.option("--template", multiple=True, metavar="KIND", help="No scan: the tables of this kind, to be filled in.")
@json_option
def init(folder: Path, force: bool, ask: bool | None, template: tuple[str, ...]) -> None:
    r"""Scan FOLDER and write a commented session.toml.

    Instruments are recognised by the content of their files. Values that the files do not contain (mass,
    radius, material, drop height, inclination of the laser) are asked for; once for all experiments
    of a specimen. An empty answer leaves a line to fill in, marked with FILL, and its experiment waits until it is
    filled; the others can be processed. For a missing calibration record a template is written.

    \b
    Example:
      labpipe init my-session
      labpipe init tomorrow --template ball_drop --template dma
    """
    is_person = sys.stdin.isatty() and not wants_json()
    asker = _Asker() if (is_person if ask is None else ask) else None
    found = verbs.init(folder, replace=force, ask=asker, template=template)
    lines = [f"wrote {found.path} with {len(found.experiments)} experiment{'s' * (len(found.experiments) != 1)}"]
    for path in found.records:
        is_open = any(line.startswith(path.relative_to(folder).as_posix()) for line in found.gaps)
        lines.append(f"wrote {path}, a calibration record{' to complete' if is_open else ''}")
    lines += [f"  to fill in: {line}" for line in found.gaps]
    lines += [f"  not used: {line}" for line in found.unused]
    document = members(found, "path", "experiments", "records", "unused") | {"to_fill": found.gaps}
    emit(document, [*lines, f"then: labpipe plan {folder}"])


class _Asker:
    """Asks a person; who calibrated is offered again for the next record, and no other answer."""

    def __init__(self) -> None:
        self.who = ""
        self.has_ended = False

    def __call__(self, gap: "Gap") -> str | None:
        """Ask until the answer fits or leaves the value open."""
        if gap.number == 1:
            click.echo("Not in the files: please answer. Enter or - leaves a value open, -- this and all others;\n"
                       "Ctrl-C writes nothing.", err=True)  # fmt: skip
        while not self.has_ended:
            default = self.who if gap.record and gap.key == "who" else ""
            answer = click.prompt(printable(gap.question), default=default, show_default=bool(default), err=True)
            self.has_ended = answer.strip() == "--"
            if answer.strip() in ("", "-", "--"):
                return None
            try:
                found = verbs.checked(gap, answer)
            except LabpipeError as error:
                click.echo(f"  {printable(str(error))}", err=True)
                continue
            if found != answer.strip():
                click.echo(f"  = {printable(found).replace(' degC', ' °C')}", err=True)
            self.who = found if gap.key == "who" else self.who
            return found
        return None


_TO = names_option("--to", "targets", help="Only these stages and what they need.")
_ONLY = names_option("--only", help="Only these experiments and what they need.")
_FULL = click.option("--full", is_flag=True, help="Without shortcuts: read and solve everything.")


@click.command()
@session_argument
@_TO
@_ONLY
@_FULL
@keep_option
@json_option
def plan(session: Path, **options: Any) -> None:
    r"""List the steps that `process` would run, and why; nothing is computed.

    A summary comes first, with the experiments that wait and for which lines; then the steps, in one line
    where all of an experiment share one reason.

    \b
    Example:
      labpipe plan my-session --to velocity
    """
    made = verbs.plan(session, **options)
    exact, waiting = verbs.stated_as_exact(made.session), made.session.waiting
    rows = [members(row, "experiment", "stage", "recording", "state", "reason") for row in made.rows]
    lines = [f"{made.summary}", *_waiting(waiting)]
    lines += [f"counted as exact, since stated without ±: {v} ({', '.join(stating)})" for v, stating in exact.items()]
    left_out = excluded_in(made.session)
    for experiment, own in itertools.groupby(made.rows, key=lambda row: row.experiment):
        steps = list(own)
        is_new = all(row.reason.startswith(_NEVER_RUN) for row in steps)
        states = [("will run", _NEVER_RUN) if is_new else (row.state, row.reason) for row in steps]
        names_of = [row.stage if row.recording is None else f"{row.stage} [{row.recording}]" for row in steps]
        if len(steps) > 1 and len(set(states)) == 1:  # one line for all
            states, names_of = states[:1], [f"all {len(steps)} steps"]
        table = [(state, name, reason) for (state, reason), name in zip(states, names_of, strict=True)]
        about = made.session.experiments[experiment]
        lines += ["", *text_table(f"{experiment} ({about.kind})", table, most=None).splitlines()]
        lines += [f"  excluded  {text}" for text in left_out.get(experiment, ())]
        changes = about.overrides.items()
        lines += [f"  laboratory.toml has {name} = {old}, the session {new}" for name, (old, new) in changes]
    document = {"rows": rows, "to_run": len(made.to_run), "estimate": made.estimate, "excluded": left_out}
    emit(document | {"waiting": waiting, "exact": exact}, lines)


def excluded_in(session: "Session") -> dict[str, list[str]]:
    """Return the exclusions of every experiment that has any, in words."""
    found = {name: [str(one) for one in exclusions(e.settings)] for name, e in session.experiments.items()}
    return {name: texts for name, texts in found.items() if texts}


def _waiting(waiting: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Name the experiments that wait, and each line that they wait for."""
    for name, lines in waiting.items():
        yield f"waiting: {name}"
        yield from (f"  {line}" for line in lines)


@click.command()
@click.argument("sessions", nargs=-1, required=True, metavar="SESSION...", type=FOLDER)
@_TO
@_ONLY
@_FULL
@keep_option
@click.option("--out", type=NEW_FOLDER, help="Work folder for the results of a SESSION that is only read.")
@jobs_option
@cluster_option
@json_option
def process(sessions: tuple[Path, ...], out: Path | None, **options: Any) -> None:
    r"""Process session folders: results and one report per experiment.

    Results that are still true are kept. A failed experiment does not stop the others, nor
    does one with values to fill in or correct, which waits (exit code 1), nor a session that cannot be opened.

    \b
    Example:
      labpipe process my-session
      labpipe process sessions/* --cluster tcp://head:8786
      labpipe process /archive/2024-05 --out 2024-05    # then: labpipe compare 2024-05
    """
    if out is not None:
        if len(sessions) > 1:
            raise click.UsageError("--out is the work folder of one session; process each by itself")
        sessions = (verbs.work_folder(sessions[0], out),)
    folders = list({folder.resolve(): folder for folder in sessions}.values())
    with watching() as progress:
        ended = dict(verbs.process_all(folders, progress=progress, **options))
    if len(folders) == 1 and isinstance(error := ended[folders[0]], LabpipeError):
        raise error
    judged = {folder: verbs.verdicts_of(done) for folder, done in ended.items() if not isinstance(done, LabpipeError)}
    ended = {folder: ended[folder] for folder in folders if folder in ended}
    documents = [as_document(done, folder, judged.get(folder)) for folder, done in ended.items()]
    codes = {document["exit_code"] for document in documents}
    code = StorageError.exit_code if StorageError.exit_code in codes else codes.pop() if len(codes) == 1 else 1
    said = ([[f"{folder}:"] * (len(folders) > 1), summary(done, judged.get(folder))] for folder, done in ended.items())
    lines = itertools.chain.from_iterable(itertools.chain.from_iterable(said))
    emit(documents[0] if len(folders) == 1 else {"sessions": documents, "exit_code": code}, lines, code=code)


def as_document(outcome: "RunResult | LabpipeError", folder: Path, judged: "Verdicts | None" = None) -> dict[str, Any]:
    """Return a run, or why there was none, as one JSON document."""
    if isinstance(outcome, LabpipeError):
        return {"session": str(folder), **error_document(outcome)}
    names = ("experiment", "stage", "recording")
    steps = [members(one.task, *names) | members(one, "state", "message") for one in outcome.outcomes]
    is_doubtful = bool(outcome.session.waiting) or (judged is not None and judged.is_impossible)
    return {
        "session": outcome.session.root,
        "steps": steps,
        "experiments": [] if judged is None else judged["experiments"],
        "findings": [] if judged is None else judged["findings"],
        "reports": outcome.reports,
        "waiting": outcome.session.waiting,
        "excluded": excluded_in(outcome.session),
        "exit_code": outcome.exit_code or int(is_doubtful),
    }


def summary(outcome: "RunResult | LabpipeError", judged: "Verdicts | None" = None) -> Iterator[str]:
    """Say how a run ended and where its reports are; failures go to stderr."""
    if isinstance(outcome, LabpipeError):
        report_error(outcome, wants_json=False)
        return
    yield f"steps: {outcome.summary}"
    for o in outcome.failures:
        click.echo(f"failed: {o.task}: {o.message}", err=True)
    left_out = excluded_in(outcome.session)
    for one in () if judged is None else judged.experiments:
        if one.state == "waiting":  # its lines follow below, with those that nobody judged
            continue
        grave = [f"{f.message} [{f.place}]" if f.place else f.message for f in one.findings if f.level != "note"]
        more = f"; and {len(grave) - _SHOWN} more on its page" if len(grave) > _SHOWN else ""
        said = "; ".join(grave[:_SHOWN]) + more
        model = f", model: {one.model}" if one.model != "none" else ""
        yield f"{one.experiment}: believable: {one.believable}{said and f' ({said})'}{model}"
        if (known := outcome.session.variants.get(one.experiment)) is not None:
            yield f"  variant of {known.base}: {', '.join(known.changed)}"
        yield from (f"  excluded: {text}" for text in left_out.get(one.experiment, ()))
        # the cause of a note is on the page
        if likely := one.cause if said else next(iter(one.suspects), ""):
            yield f"  likely: {likely}"
    for note in () if judged is None else judged.notes:
        yield f"note: {note.message}: {note.cause}"
    yield from _waiting(outcome.session.waiting)
    yield from (f"report: {path}" for path in outcome.reports.values())
    if (overview := outcome.session.folder / verbs.PAGE).is_file():
        yield f"all experiments: {overview}"


@click.command()
@session_argument
@click.argument("experiment")
@click.argument("text")
@click.option("--who", default="", help="Whose note it is; default: the operator of the session.")
@json_option
def note(session: Path, experiment: str, text: str, who: str) -> None:
    r"""Append a note with the day of today to EXPERIMENT in session.toml; its page shows it.

    \b
    Example:
      labpipe note my-session acrylic_7mm "sphere cleaned with ethanol"
    """
    made = verbs.note(session, experiment, text, who=who)
    lines = [f"noted on {made.on}; its page shows it after: labpipe process {session}"]
    emit({"experiment": experiment} | members(made, "on", "who", "text"), lines)


@click.command()
@session_argument
@click.option("--every", type=click.FloatRange(min=0.01), default=2.0, help="Seconds between checks of the folder.")
@click.option("--looks", type=click.IntRange(min=2), default=3, help="Checks that must find a file unchanged.")
@click.option("--until-done", is_flag=True, help="End once every experiment is processed.")
@click.option("--jobs", "-j", default=1, type=click.IntRange(min=0), help="0 runs everything in this process.")
@json_option
def watch(session: Path, every: float, looks: int, until_done: bool, jobs: int) -> None:
    r"""Process each experiment of SESSION as soon as its files are complete; end with Ctrl-C.

    The folder is polled, so it may be on a network share. A file is complete when it is unchanged
    over several checks and its content is complete. The watch may be stopped and restarted at any
    time; nothing is computed twice.

    \b
    Example:
      labpipe watch my-session
    """
    watcher = verbs.watch(session, looks=looks, jobs=jobs)
    failed = False
    try:
        while True:
            for news in watcher.look():
                failed |= news.state == "failed"
                clock = datetime.now().astimezone().strftime("%H:%M:%S")
                if not wants_json():
                    emit(None, [f"{clock}  {news.experiment or 'session'}: {news.state}: {news.text}"])
            if until_done and watcher.is_done:
                break
            time.sleep(every)
    finally:
        states = watcher.states.items()
        emit({"experiments": {n: {"state": s, "text": t} for n, (s, t) in states}}, ())
    click.get_current_context().exit(int(failed))

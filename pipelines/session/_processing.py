"""The verbs that process a session: plan, process, judge, watch, and show its reports."""

from __future__ import annotations

import contextlib
import json
import re
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from labpipe import files
from labpipe.errors import InputError, LabpipeError, SourceError, UsageError
from labpipe.workflow.document import parse
from labpipe.workflow.exclusions import concerning, files_of
from labpipe.workflow.graph import FILE
from labpipe.workflow.plan import Plan, page_name, plan as make_plan
from labpipe.workflow.results import Results
from labpipe.workflow.session import FILE_NAME, Experiment, Session
from labpipe.workflow.watch import LOOKS, Watcher
from pipelines.experiments import JUDGEMENT, KINDS, Derived, function
from pipelines.session._overview import COMPARISON_PAGE, write_overview
from pipelines.session._results import SCHEMAS, SETTINGS, STAGES, load, needed, opened, reopen_session
from pipelines.session._stated import fill

if TYPE_CHECKING:
    from labpipe.report import Report
    from labpipe.workflow.results import Event, RunResult
    from labpipe.workflow.runner import Options
    from pipelines.session._comparison import Comparison
    from pipelines.session._verdicts import Verdicts

_HEAD = re.compile(r"^[ \t]*\[[ \t]*session[ \t]*\][^\n]*\n", re.MULTILINE)
_PNG_END = b"IEND\xaeB`\x82"
_READINGS = "readings"
"""Name of the stage that reads one file of an experiment, with the options in its settings."""


def plan(
    folder: str | Path,
    targets: Iterable[str] | None = None,
    only: Iterable[str] | None = None,
    *,
    full: bool = False,
    keep: bool | None = False,
) -> Plan:
    """List the steps that :func:`process` would run, and why; nothing numerical is imported.

    Parameters
    ----------
    folder, targets, only, full, keep
        As of :func:`process`.

    Returns
    -------
    Plan
        One row per step: up to date, or to be run and why.

    Examples
    --------
    >>> plan("my-session", "velocity").summary  # doctest: +SKIP
    '4 of 12 steps would run'
    """
    return make_plan(reopen_session(folder), STAGES, targets, only, full=full, keep=keep)


def process(
    folder: str | Path,
    targets: Iterable[str] | None = None,
    only: Iterable[str] | None = None,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    full: bool = False,
    keep: bool | None = False,
    out: str | Path | None = None,
    progress: Callable[[Event], None] | None = None,
) -> RunResult:
    """Compute the results that a session lacks, and write its reports.

    Parameters
    ----------
    folder : path-like
        The session folder; results go to ``FOLDER/labpipe``.
    targets, only : str or iterable of str, optional
        Stages and experiments that are wanted; all by default.
    jobs : int
        Experiments computed side by side; 0 computes in this process.
    cluster : str, optional
        Address of a Dask scheduler, ``tcp://host:port``, whose workers compute instead, under the same paths.
    full : bool
        Without the shortcuts that skip parts that a scene does not need.
    keep : bool or None
        Take results of earlier code as they are, and say so on every page; with None, those that an earlier run took.
    out : path-like, optional
        A work folder for the results of a session in which nothing may be written; taken in its place from then on.
    progress : callable, optional
        Called with every event of the run.

    Returns
    -------
    RunResult
        Outcome of every task, and the reports by experiment. The page of all is ``FOLDER/labpipe/index.html``.

    Examples
    --------
    >>> done = process("my-session", only="acrylic_7mm", jobs=4)  # doctest: +SKIP
    >>> done.failures, done.reports["acrylic_7mm"]  # doctest: +SKIP
    """
    options: Options = {"targets": targets, "only": only, "full": full, "keep": keep, "progress": progress}
    options |= {"jobs": jobs, "cluster": cluster}
    if out is not None:
        folder = work_folder(folder, out)
    ((_, done),) = process_all([folder], **options)
    if isinstance(done, LabpipeError):
        raise done
    return done


def work_folder(session: str | Path, out: str | Path) -> Path:
    """Make a folder for the results of a session in which nothing may be written; return it.

    It holds a copy of ``session.toml`` that names the session (``files`` in ``[session]``), and is taken by every
    command and function in the session's place. A folder that is there already is used as it is: its copy may have
    been changed.
    """
    source, target = Path(session).resolve(), Path(out).resolve()
    original = source / FILE_NAME
    if not original.is_file():
        raise SourceError(original, "there is no such file", hint="Name the folder of a session.")
    if target.is_relative_to(source):
        raise UsageError(f"--out {out} lies in the session; name a folder outside it, or leave out --out")
    copy = target / FILE_NAME
    if copy.is_file():
        known = parse(copy).tree.get("session", {}).get("files", "")
        if not known or (target / known).resolve() != source:
            raise UsageError(f"--out {out}: its {FILE_NAME} is of {known or 'a session itself'}; name another folder")
        return target
    text = original.read_text("utf-8-sig")
    line = f"files = {json.dumps(source.as_posix(), ensure_ascii=False)}  # raw files and records: only read\n"
    changed, count = _HEAD.subn(lambda found: found[0] + line, text, count=1)
    files.write_text(copy, changed if count else f"{text.rstrip()}\n\n[session]\n{line}")
    return target


def process_all(
    folders: Iterable[str | Path], **options: Unpack[Options]
) -> Generator[tuple[Path, RunResult | LabpipeError]]:
    """Process many sessions, their experiments side by side; options are those of :func:`process`.

    Yields a folder, and how its run ended or why it cannot be processed; the others go on.
    """
    from labpipe.workflow.runner import run_all

    refused: list[tuple[Path, LabpipeError]] = []
    given: dict[Path, Path] = {}  # by the whole path that a session has, as the caller calls it

    def sessions_of() -> Iterator[Session]:
        for folder in map(Path, folders):
            try:
                session = reopen_session(folder)
                given[session.root] = folder
                yield session
            except LabpipeError as error:
                refused.append((folder, error))

    options["schemas"] = SCHEMAS
    has_processes = bool(options.get("jobs", 1)) and not options.get("cluster")
    for session, done in run_all(sessions_of(), STAGES, **options):
        if not isinstance(done, LabpipeError):
            _finish(session, done, done.plan, has_processes)
        yield given[session.root], done
    yield from refused


def processed_for(folder: str | Path, wanted: Iterable[tuple[Experiment, Derived]], *, jobs: int = 1) -> Results:
    """Process the steps behind values derived from experiments, and open the results; a failure is an InputError."""
    session = reopen_session(folder)
    targets = [target for experiment, derived in wanted for target in needed(session, experiment, derived)]
    run = process(folder, targets, {target.split("/")[0] for target in targets}, jobs=jobs, keep=None)
    for outcome in run.failures:
        raise InputError(f"{outcome.task}: {outcome.message}")
    return opened(folder)


def compare(
    folder: str | Path, *, jobs: int = 1, keep: bool | None = None, progress: Callable[[Event], None] | None = None
) -> Comparison:
    """Compare measurement and model of every experiment of a session, on one page.

    Missing results are processed first. The page is ``FOLDER/labpipe/compare.html``.

    Parameters
    ----------
    folder : path-like
        The session folder.
    jobs, keep, progress
        As of :func:`labpipe.process`; kept are by default the results that an earlier run kept.

    Returns
    -------
    Comparison
        Rows with the measured and the simulated value of each quantity, and the page.

    Examples
    --------
    >>> for row in compare("my-session").rows:  # doctest: +SKIP
    ...     print(row.experiment, row.quantity, row.measured, row.model)
    """
    from pipelines.experiments.shared import judgements
    from pipelines.experiments.shared.comparison_rows import Row
    from pipelines.session._comparison import Comparison, compared, write_comparison
    from pipelines.session._verdicts import stored_verdicts

    session = reopen_session(folder)
    every = session.experiments.values()
    judged = [e.name for e in every if any(s.name == JUDGEMENT for s in STAGES[e.kind])]
    wanted = [target for e in every if (made := KINDS[e.kind].rows) for target in needed(session, e, made)]
    wanted += [f"{name}/{JUDGEMENT}" for name in judged]
    names = {target.split("/")[0] for target in wanted}
    run = process(folder, wanted, names, jobs=jobs, keep=keep, progress=progress) if wanted else None
    results = opened(folder)
    verdicts = stored_verdicts(results)
    rows, failed, absent = list[Row](), dict[str, str](), dict[str, str]()
    for outcome in run.failures if run else ():
        name = outcome.task.experiment
        likely = verdicts[name].cause if name in verdicts else ""
        cause = f". Likely: {likely}" if likely else ""
        failed.setdefault(name, f"{str(outcome.task).removeprefix(f'{name}/')}: {outcome.message}{cause}")
    for name in (name for name in session.experiments if name not in failed):
        keys = results.plan.of(name).keys
        kept = tuple(dict.fromkeys(f"{task.experiment}/{task.stage}" for task, key in keys.items() if key.kept))
        own = [replace(row, kept=kept) for row in compared(results, name) or []]
        rows += own
        if not own:
            absent[name] = "it has no model: session.toml names nothing to simulate"
    whole = []
    for name in (name for name in judged if name not in failed):
        head = {"believable": verdicts[name].believable, "cause": verdicts[name].cause, "experiment": name}
        whole.append(head | judgements.compared(results.result(name, JUDGEMENT)))
    found = Comparison(tuple(rows), failed, absent, session.folder / COMPARISON_PAGE, tuple(whole))
    write_comparison(session, found, verdicts)
    return found


def _finish(session: Session, done: RunResult, plan: Plan | None, has_processes: bool = False) -> None:
    """Keep the verdicts on experiments that failed, and write the pages of variants and of the session.

    Where processes have worked, one more of them writes it, which has NumPy loaded.
    """
    from labpipe.workflow.engines import Died, elsewhere

    if session.variants:
        from pipelines.session._comparison import write_variants

        write_variants(session, {o.experiment for o in done.outcomes if o.state == "done"})
    if done.failures:
        from pipelines.session._verdicts import verdicts_of

        verdicts_of(done)
    if has_processes and any(outcome.state == "done" for outcome in done.outcomes):
        with contextlib.suppress(Died):
            elsewhere(partial(write_overview, session, STAGES, plan))
            return
    write_overview(session, STAGES, plan)


def watch(folder: str | Path, *, looks: int = LOOKS, jobs: int = 1) -> Watcher:
    """Watch a session that is still being recorded; process each experiment that has become complete.

    Parameters
    ----------
    folder : path-like
        The session folder; files, and session.toml itself, may come later.
    looks : int
        Looks in a row that must find a file unchanged.
    jobs : int
        0 computes in this process.

    Returns
    -------
    Watcher
        Call its ``look()`` again and again; each call yields the news.

    Examples
    --------
    >>> for news in watch("my-session").look():  # doctest: +SKIP
    ...     print(news.experiment, news.state, news.text)
    """

    def run_one(session: Session, name: str) -> RunResult:
        from labpipe.workflow.runner import run

        done = run(session, STAGES, only=[name], jobs=jobs, schemas=SCHEMAS)
        _finish(load(session.root, may_wait=True), done, None)
        return done

    return Watcher(Path(folder), SETTINGS, STAGES, _missing_part, run_one, looks, fill=fill)


def _missing_part(experiment: Experiment, path: Path) -> str | None:
    """Return the missing part of a file that has stopped growing, or None when it is complete.

    A copy may pause for longer than anybody waits, so the file is read as the analysis would read it.
    """
    import xarray as xr

    import instruments

    if path.suffix.lower() == ".png":
        return None if path.read_bytes().endswith(_PNG_END) else f"{path}: the picture has no end"
    try:
        with warnings.catch_warnings(action="ignore"):  # shown when the file is processed
            if path.suffix.lower() == ".toml":
                parse(path)
                return None
            own = [
                (field, name) for field, name in files_of(experiment.settings) if path.as_posix().endswith(f"/{name}")
            ]
            name, inputs = own[0][1] if own else "", {f"{FILE}{field.partition('[')[0]}" for field, _ in own}
            stages = (s for s in KINDS[experiment.kind].stages if s.name == _READINGS and len(s.inputs) == 1)
            reader: Any = next((function(s.function) for s in stages if s.inputs[0] in inputs), None)
            settings = concerning(experiment.settings, [name])
            found: Any = reader(path, settings=settings) if reader else instruments.read(path)
    except LabpipeError as error:
        return str(error)
    if isinstance(found, xr.Dataset):
        return None
    absent = int((~found.valid).sum())
    return f"{path}: {absent} of {len(found)} frames are not there" if absent else None


def report(folder: str | Path, experiment: str) -> Report:
    """Return the report of an experiment; a notebook shows it.

    Parameters
    ----------
    folder : path-like
        The session folder.
    experiment : str
        Its name.

    Returns
    -------
    Report
        ``path`` is the page, ``html`` its text.

    Examples
    --------
    >>> report("my-session", "acrylic_7mm")  # doctest: +SKIP
    """
    from labpipe.report import Report

    session = reopen_session(folder)
    path = session.folder / page_name(experiment)
    if experiment not in session.experiments or not path.is_file():
        known = f"experiments: {', '.join(session.experiments)}"
        raise InputError(f'there is no report of "{experiment}" yet; run: labpipe process {folder} ({known})')
    return Report(experiment, path)


def verdict(
    folder: str | Path, targets: Iterable[str] | None = None, only: Iterable[str] | None = None, *, jobs: int = 1
) -> Verdicts:
    """Judge a session: is each record believable, and does the model agree.

    Parameters
    ----------
    folder : path-like
        The session folder; results that it lacks are processed first.
    targets, only, jobs
        As of :func:`process`. With stages, the measurement is judged by the results that there are.

    Returns
    -------
    Verdicts

    Examples
    --------
    >>> for one in verdict("my-session").experiments:  # doctest: +SKIP
    ...     print(one.experiment, one.believable, one.model)
    """
    from pipelines.session._verdicts import verdicts_of

    return verdicts_of(process(folder, targets, only, jobs=jobs))

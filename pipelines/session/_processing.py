"""The verbs that process a session: plan, process, judge, watch, and show its reports."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from labpipe.errors import InputError, LabpipeError
from labpipe.workflow.plan import Plan, plan as make_plan
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from labpipe.workflow.watch import LOOKS, Settling, Watcher
from pipelines.experiments import Derived
from pipelines.session._overview import write_overview
from pipelines.session._results import SCHEMAS, SETTINGS, STAGES, load, needed, opened, reopen_session
from pipelines.session._stated import fill

if TYPE_CHECKING:
    from labpipe.report import Report
    from labpipe.workflow.results import Event, RunResult
    from labpipe.workflow.runner import Options
    from pipelines.session._verdicts import Verdicts


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
    folder : path-like
        The session folder.
    targets, only : str or iterable of str, optional
        Stages and experiments that are wanted; all by default.
    full : bool
        Plan for a run without shortcuts.
    keep : bool or None
        Take results of earlier code as they are; with None, those that an earlier run took.

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
        Address of a Dask scheduler, ``tcp://host:port``, whose workers compute instead; the
        session must lie under the same path for all of them.
    full : bool
        Without the shortcuts that skip parts that a scene does not need.
    keep : bool or None
        Take results of earlier code as they are where nothing else has changed, and say so on
        every page; with None, those that an earlier run took. By default all is made again.
    out : path-like, optional
        A work folder for the results of a session in which nothing may be written. It is made, names the session,
        and is taken in the session's place from then on.
    progress : callable, optional
        Called with every event of the run.

    Returns
    -------
    RunResult
        Outcome of every task, the ledger, and the reports by experiment. The page of the whole
        session is ``FOLDER/labpipe/index.html``.

    Examples
    --------
    >>> done = process("my-session", only="acrylic_7mm", jobs=4)  # doctest: +SKIP
    >>> done.failures, done.reports["acrylic_7mm"]  # doctest: +SKIP
    """
    options: Options = {"targets": targets, "only": only, "full": full, "keep": keep, "progress": progress}
    options |= {"jobs": jobs, "cluster": cluster}
    if out is not None:
        from pipelines.session._elsewhere import work_folder

        folder = work_folder(folder, out)
    ((_, done),) = process_all([folder], **options)
    if isinstance(done, LabpipeError):
        raise done
    return done


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


def _finish(session: Session, done: RunResult, plan: Plan | None, has_processes: bool = False) -> None:
    """Keep the verdicts on experiments that failed, and write the page of the session.

    Where processes have worked, one more of them writes it, which has NumPy loaded. Variants get a page of their own
    with their base.
    """
    if session.variants:
        from pipelines.session._comparison import write_variants

        write_variants(session, {o.experiment for o in done.outcomes if o.state == "done"})
    from labpipe.workflow.engines import Call, Died, elsewhere

    if done.failures:
        from pipelines.session._verdicts import verdicts_of

        verdicts_of(done)
    if has_processes and any(outcome.state == "done" for outcome in done.outcomes):
        whole = replace(session, root=session.root.absolute())
        with contextlib.suppress(Died):
            elsewhere(Call(f"{write_overview.__module__}:{write_overview.__name__}", (whole, STAGES, plan)))
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
    from pipelines.session._arrivals import missing_part

    def run_one(session: Session, name: str) -> RunResult:
        from labpipe.workflow.runner import run

        done = run(session, STAGES, only=[name], jobs=jobs, schemas=SCHEMAS)
        _finish(load(session.root, may_wait=True), done, None)
        return done

    return Watcher(Path(folder), SETTINGS, STAGES, missing_part, run_one, Settling(looks), fill=fill)


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
    from labpipe.workflow.plan import page_name

    session = reopen_session(folder)
    path = session.folder / page_name(experiment)
    if experiment not in session.experiments or not path.is_file():
        known = ", ".join(session.experiments)
        message = f'there is no report of "{experiment}" yet; run: labpipe process {folder} (experiments: {known})'
        raise InputError(message)
    return Report(experiment, path)


def verdict(
    folder: str | Path, targets: Iterable[str] | None = None, only: Iterable[str] | None = None, *, jobs: int = 1
) -> Verdicts:
    """Judge a session: is each record believable, and does the model agree.

    Parameters
    ----------
    folder : path-like
        The session folder; results that it lacks are processed first.
    targets, only : str or iterable of str, optional
        Stages and experiments that are wanted; all by default. With stages, the measurement is
        judged by the results that there are.
    jobs : int
        Experiments computed side by side.

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

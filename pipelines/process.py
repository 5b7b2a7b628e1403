"""The verbs: open a session, plan it, process it, check its store.

What the command line does, Python does with these; each returns objects to look at.
"""

from collections.abc import Callable, Generator, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import ConfigError, InputError, LabpipeError, SourceError, UsageError
from labpipe.workflow import session as sessions
from labpipe.workflow.plan import Plan
from labpipe.workflow.plan import plan as make_plan
from labpipe.workflow.session import Session
from labpipe.workflow.watch import LOOKS, Settling, Watcher
from pipelines.stages import KINDS

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.report import Report
    from labpipe.workflow.runner import Event, RunResult
    from pipelines.export import Exported

SETTINGS = {name: kind.settings for name, kind in KINDS.items()}
STAGES = {name: kind.stages for name, kind in KINDS.items()}


def open_session(folder: str | Path) -> Session:
    """Read and check the ``session.toml`` of a folder.

    Parameters
    ----------
    folder : path-like
        The session folder.

    Returns
    -------
    Session
        Title, operator, and the experiments with their typed settings.

    Raises
    ------
    SourceError
        The folder holds no session.toml.
    ConfigError
        The file holds mistakes; all of them are listed with their lines.
    """
    path = Path(folder) / sessions.FILE_NAME
    if not path.is_file():
        raise SourceError(
            path, "there is no such file", hint=f"Write one with `labpipe init {folder}`."
        )
    return sessions.load(path, SETTINGS)


def reopen_session(folder: str | Path) -> Session:
    """Open a session as :func:`open_session`, but once processed let it lack files.

    In a session that was never processed a file that is not there is a mistake in session.toml,
    told with all others. Later it has been lost: its experiment fails and says so, the others go
    on.

    Parameters
    ----------
    folder : path-like
        The session folder.
    """
    try:
        return open_session(folder)
    except ConfigError as all_mistakes:
        try:
            session = sessions.load(folder, SETTINGS, may_wait=True)
        except ConfigError:
            raise all_mistakes from None
        if not (session.folder / "store").is_dir():
            raise
        return session


def plan(
    folder: str | Path,
    targets: Iterable[str] | None = None,
    only: Iterable[str] | None = None,
    *,
    full: bool = False,
) -> Plan:
    """Say what :func:`process` would run, and why; nothing numerical is imported.

    Parameters
    ----------
    folder : path-like
        The session folder.
    targets, only : str or iterable of str, optional
        Stages and experiments that are wanted; all by default.
    full : bool
        Plan for a run without shortcuts.
    """
    return make_plan(reopen_session(folder), STAGES, targets, only, full=full)


def process(
    folder: str | Path,
    targets: Iterable[str] | None = None,
    only: Iterable[str] | None = None,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    full: bool = False,
    fail_fast: bool = False,
    progress: "Callable[[Event], None] | None" = None,
) -> "RunResult":
    """Compute what a session lacks, and write its reports.

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
        Without the shortcuts that skip what a scene does not need.
    fail_fast : bool
        Stop at the first failure instead of going on with the other experiments.
    progress : callable, optional
        Called with every event of the run.

    Returns
    -------
    RunResult
        Outcome of every task, the ledger, and the reports by experiment. The page of the whole
        session is ``FOLDER/labpipe/index.html``.
    """
    ((_, done),) = process_all(
        [folder], targets, only, jobs=jobs, cluster=cluster,
        full=full, fail_fast=fail_fast, progress=progress,
    )  # fmt: skip
    if isinstance(done, LabpipeError):
        raise done
    return done


def process_all(
    folders: Iterable[str | Path],
    targets: Iterable[str] | None = None,
    only: Iterable[str] | None = None,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    full: bool = False,
    fail_fast: bool = False,
    progress: "Callable[[Event], None] | None" = None,
) -> "Generator[tuple[Path, RunResult | LabpipeError]]":
    """Process many sessions, their experiments side by side.

    Parameters
    ----------
    folders : iterable of path-like
        Session folders; each is opened when there is room for its experiments.
    targets, only, jobs, cluster, full, fail_fast, progress
        See :func:`process`.

    Yields
    ------
    tuple
        A folder, and how its run ended or why it cannot be processed; the others go on.

    Examples
    --------
    >>> for folder, done in process_all(["monday", "tuesday"], jobs=4):  # doctest: +SKIP
    ...     print(folder, done)
    """
    from labpipe.workflow.runner import run_all
    from pipelines.overview import write_overview
    from pipelines.schemas import SCHEMAS

    refused: list[tuple[Path, LabpipeError]] = []

    def opened() -> Iterator[Session]:
        for folder in map(Path, folders):
            try:
                yield reopen_session(folder)
            except LabpipeError as error:
                refused.append((folder, error))
                if fail_fast:
                    return

    for session, done in run_all(
        opened(), STAGES, jobs=jobs, cluster=cluster, targets=targets, only=only,
        fail_fast=fail_fast, full=full, schemas=SCHEMAS, progress=progress,
    ):  # fmt: skip
        if not isinstance(done, LabpipeError):
            write_overview(session, STAGES)
        yield session.root, done
    yield from refused


def watch(folder: str | Path, *, looks: int = LOOKS, jobs: int = 1) -> Watcher:
    """Watch a session that is still being recorded; process what has become complete.

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
        Call its ``look()`` again and again; each call yields what is new.

    Examples
    --------
    >>> for news in watch("my-session").look():  # doctest: +SKIP
    ...     print(news.experiment, news.state, news.text)
    """
    from pipelines.arrivals import missing_part

    def run_one(session: Session, name: str) -> "RunResult":
        from labpipe.workflow.runner import run
        from pipelines.overview import write_overview
        from pipelines.schemas import SCHEMAS

        done = run(session, STAGES, only=[name], jobs=jobs, schemas=SCHEMAS)
        write_overview(sessions.load(session.root, SETTINGS, may_wait=True), STAGES)
        return done

    settling = Settling(looks)
    return Watcher(Path(folder), SETTINGS, STAGES, missing_part, run_one, settling)


def result(
    folder: str | Path, experiment: str, stage: str, recording: str | None = None
) -> "xr.Dataset":
    """Return one stored result of a processed session.

    Parameters
    ----------
    folder : path-like
        The session folder.
    experiment, stage : str
        Names, for example ``"acrylic_1p5mm"`` and ``"bounces"``.
    recording : str, optional
        The file, for stages that run once per recording.

    Raises
    ------
    InputError
        The result is missing or out of date.
    """
    from labpipe.workflow.runner import open_result

    return open_result(reopen_session(folder), STAGES, experiment, stage, recording)


def results(folder: str | Path, experiment: str) -> "xr.DataTree":
    """Return all results of an experiment that are up to date, as one tree.

    Parameters
    ----------
    folder : path-like
        The session folder.
    experiment : str
        Its name.

    Returns
    -------
    DataTree
        One node per stage; below it one per recording for stages that run per recording, by the
        stem of the file (by its whole name where two have the same).

    Raises
    ------
    InputError
        There is none.
    UsageError
        There is no such experiment.
    """
    import xarray as xr

    from labpipe.workflow.plan import CACHED

    made = plan(folder, only=[experiment])
    found: dict[str, xr.Dataset] = {}
    for row in made.rows:
        is_wanted = row.experiment == experiment and row.state == CACHED
        if is_wanted and made.tasks[row.task].stage.output == "dataset":
            node = f"/{row.stage}"
            if row.recording is not None:
                stem = Path(row.recording).stem
                is_taken = f"{node}/{stem}" in found
                node += f"/{row.recording.replace('/', '_') if is_taken else stem}"
            found[node] = result(folder, experiment, row.stage, row.recording)
    if not found:
        message = (
            f"{experiment} has no result that is up to date; run: labpipe process {folder} "
            f"--only {experiment}"
        )
        raise InputError(message)
    return xr.DataTree.from_dict(found, name=experiment)


def report(folder: str | Path, experiment: str) -> "Report":
    """Return the report of an experiment; a notebook shows it.

    Parameters
    ----------
    folder : path-like
        The session folder.
    experiment : str
        Its name.

    Raises
    ------
    InputError
        There is none yet.
    """
    from labpipe.report import Report
    from labpipe.workflow.plan import page_name

    session = reopen_session(folder)
    path = session.folder / page_name(experiment)
    if experiment not in session.experiments or not path.is_file():
        known = ", ".join(session.experiments)
        message = (
            f'there is no report of "{experiment}" yet; run: labpipe process {folder} '
            f"(experiments: {known})"
        )
        raise InputError(message)
    return Report(experiment, path)


def export(
    source: str | Path,
    format: str = "csv",  # noqa: A002
    *,
    only: Iterable[str] | None = None,
    stages: Iterable[str] = (),
    out: str | Path | None = None,
    replace: bool = False,
    reading: dict[str, Any] | None = None,
) -> "Exported":
    """Write stored results, or one raw file, for programs that read no netCDF.

    Parameters
    ----------
    source : path-like
        A session folder, or a file (or folder of images) of a known instrument.
    format : {"csv", "nc", "mat", "json"}
        Of the files; csv has one table per set of dimensions, with a row of units.
    only, stages : iterable of str, optional
        Experiments and steps of a session; all by default.
    out : path-like, optional
        Folder; default ``SESSION/labpipe/export``, or the current one for a raw file.
    replace : bool
        Replace files of the same name; in the default folder of a session they always are.
    reading : dict, optional
        What a raw file leaves unsaid, such as ``{"cycle": "50 us"}``.

    Returns
    -------
    Exported
        The files, and the results that were left out because they are not up to date.

    Raises
    ------
    InputError
        No wanted result is up to date.
    UsageError
        A name is unknown, or a file is there and may not be replaced.
    """
    from pipelines.export import FOLDER, Target, export_file, export_results

    place = Path(source)
    if not (place / sessions.FILE_NAME).is_file() and not _is_unknown_folder(place):
        options = dict(reading or {})
        return export_file(place, Target(Path(out or "."), format, replace), options)
    if reading:
        message = "options of a raw file (cycle, units) do not go with a session folder"
        raise UsageError(message)
    session = reopen_session(place)
    ours = session.folder / FOLDER
    target = Target(Path(out) if out else ours, format, replace or out is None)
    names, experiments = tuple(stages), tuple(only or ())
    made = make_plan(session, STAGES, names or None, experiments or None)
    return export_results(
        made, names, experiments, target,
        lambda row: result(place, row.experiment, row.stage, row.recording),
    )  # fmt: skip


def _is_unknown_folder(place: Path) -> bool:
    """Tell a folder that should have been a session from one that holds a film."""
    import instruments

    if not place.is_dir():
        return False
    try:
        instruments.identify(place)
    except SourceError:
        return True
    return False


def check_store(folder: str | Path) -> list[str]:
    """Read every stored result of a session and name the damaged ones."""
    from labpipe.workflow.store import Store

    return Store(reopen_session(folder).folder).check()

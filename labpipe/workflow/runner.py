"""Run what a plan says: experiments side by side, each failure on its own, nothing half-done."""

from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import replace
from typing import TypedDict, Unpack

from labpipe.errors import LabpipeError
from labpipe.schema import Schema
from labpipe.workflow import engines, provenance
from labpipe.workflow._session_run import SessionRun
from labpipe.workflow._worker import Job, check_schemas
from labpipe.workflow.plan import make_plan, wanted_tasks
from labpipe.workflow.run_result import Event, RunResult
from labpipe.workflow.session import Session
from labpipe.workflow.store import Store
from labpipe.workflow.tasks import Stages, spell_out


class Options(TypedDict, total=False):
    """What :func:`run_all` is asked for."""

    jobs: int
    cluster: str | None
    targets: Iterable[str] | None
    only: Iterable[str] | None
    fail_fast: bool
    full: bool
    paranoid: bool
    keep: bool | None
    schemas: Mapping[str, Schema] | None
    progress: Callable[[Event], None] | None


def run(session: Session, stages: Stages, **options: Unpack[Options]) -> RunResult:
    """Compute what one session lacks.

    Parameters
    ----------
    session, stages, **options
        See :func:`run_all`.

    Returns
    -------
    RunResult
        A failure of a stage is in it, not raised.

    Raises
    ------
    UsageError, ConfigError, InputError
        The run cannot begin.
    StorageError
        Nothing can be written at all.
    KeyboardInterrupt
        After the workers have ended; everything finished until then is kept.
    """
    ((_, ended),) = run_all([session], stages, **options)
    if isinstance(ended, LabpipeError):
        raise ended
    return ended


def run_all(
    sessions: Iterable[Session],
    stages: Stages,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    targets: Iterable[str] | None = None,
    only: Iterable[str] | None = None,
    fail_fast: bool = False,
    full: bool = False,
    paranoid: bool = False,
    keep: bool | None = False,
    schemas: Mapping[str, Schema] | None = None,
    progress: Callable[[Event], None] | None = None,
) -> Generator[tuple[Session, RunResult | LabpipeError]]:
    """Compute what sessions lack, experiments of all of them side by side.

    Parameters
    ----------
    sessions : iterable of Session
        See :func:`labpipe.workflow.session.load`. One is asked for when there is room for it.
    stages : mapping
        The stages of every kind of experiment.
    jobs : int
        Experiments computed at the same time, each in a process. 0 computes in this process, for
        looking into a stage with a debugger; equal bytes are promised from 1 up, because only a
        process of its own can hold the libraries to one thread.
    cluster : str, optional
        Address of a Dask scheduler whose workers compute instead; sessions must lie under the same
        path for all of them.
    targets, only : str or iterable of str, optional
        See :func:`labpipe.workflow.plan.plan`.
    fail_fast : bool
        Stop everything at the first failure; sessions that have not begun are left out.
    full : bool
        Without shortcuts; stages that declare ``shortcuts`` are told.
    paranoid : bool
        Read every file again instead of trusting size, times and inode.
    keep : bool or None
        Take results of earlier code as they are; with None, those that an earlier run took.
    schemas : mapping, optional
        The schemas that stages name.
    progress : callable, optional
        Told every :class:`Event`; its counts are those of its session.

    Yields
    ------
    tuple
        A session, and how its run ended or why it could not begin, as soon as that is known.

    Raises
    ------
    InputError, UsageError
        The stages do not fit the schemas, or there is no such engine.
    KeyboardInterrupt
        As for :func:`run`.
    """
    engine = engines.choose(jobs, cluster)
    check_schemas(stages, schemas or {})

    def begin(session: Session) -> SessionRun:
        store = Store(session.folder, paranoid=paranoid)
        store.clean()
        tasks = spell_out(session, stages)
        wanted = wanted_tasks(session, tasks, targets, only)
        made = make_plan(session, tasks, wanted, store, full=full, keep=keep)
        store.remember()
        template = Job(
            session=replace(session, root=session.root.absolute()),
            stages=stages,
            schemas=dict(schemas or {}),
            experiment="",
            wanted=frozenset(),
            full=full,
            paranoid=paranoid,
            keep=keep,
            fail_fast=fail_fast,
            program=provenance.program() if made.to_run else {},
            failures={},
        )
        state = SessionRun(made, store, template, progress, is_whole=len(made.tasks) == len(tasks))
        state.begin(jobs)
        return state

    queue = iter(sessions)
    under_way: list[SessionRun] = []
    must_stop = False
    try:
        with engine.crew() as crew:
            while not must_stop:
                for state in [state for state in under_way if state.is_over]:
                    under_way.remove(state)
                    yield state.plan.session, state.end()
                for state in under_way:
                    state.give(crew)
                if crew.room and (session := next(queue, None)) is not None:
                    try:
                        under_way.append(begin(session))
                    except LabpipeError as error:
                        yield session, error
                    continue
                if not under_way:
                    return
                for (state, experiment), answer in crew.ended():
                    state.take(experiment, answer)
                must_stop = any(state.must_stop() for state in under_way)
        while under_way:  # stopped at the first failure
            state = under_way.pop(0)
            yield state.plan.session, state.end()
    except BaseException as error:
        for state in under_way:
            state.leave(error)
        raise

"""Run what a plan says: experiments side by side, each failure on its own, nothing half-done."""

import contextlib
import datetime
import json
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypedDict, Unpack

from labpipe import files
from labpipe.errors import LabpipeError, StorageError
from labpipe.schema import Schema
from labpipe.workflow import code, engines, provenance
from labpipe.workflow._ledger import LedgerRow, summarise
from labpipe.workflow._log import LOG
from labpipe.workflow._worker import DONE, FAILED, SKIPPED, WORK, Failure, Job, Outcome, check_schemas
from labpipe.workflow.engines import Call, Crew, Died
from labpipe.workflow.graph import imports_of
from labpipe.workflow.plan import READY, Plan, make_plan, page_name, wanted_tasks
from labpipe.workflow.run_result import Event, RunResult
from labpipe.workflow.session import Session
from labpipe.workflow.store import Store
from labpipe.workflow.tasks import Stages, TaskId, spell_out

_TRIES = 2
"""Processes that a task may kill before it has failed."""


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

    def begin(session: Session) -> _SessionRun:
        store = Store(session.folder, paranoid=paranoid)
        store.clean()
        tasks = spell_out(session, stages)
        wanted = wanted_tasks(session, tasks, targets, only)
        made = make_plan(session, tasks, wanted, store, full=full, keep=keep)
        store.index.save()
        code.save()
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
        state = _SessionRun(made, store, template, progress, is_whole=len(made.tasks) == len(tasks))
        state.begin(jobs)
        return state

    queue = iter(sessions)
    under_way: list[_SessionRun] = []
    must_stop = False
    try:
        with engine.crew() as crew:
            while not must_stop:
                for state in [state for state in under_way if state.is_over]:
                    under_way.remove(state)
                    yield state.plan.session, state.end()
                for state in under_way:
                    if not any(one.runs_suspect for one in under_way):
                        state.give(crew)
                if (
                    crew.room
                    and not any(one.runs_suspect for one in under_way)
                    and (session := next(queue, None)) is not None
                ):
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


# --- one session ---------------------------------------------------------------------------------


def _bytes(path: Path) -> int:
    """Size of a file or folder; nothing where it cannot be read, which its stage will say."""
    try:
        parts = files.files_below(path) if path.is_dir() else [path]
        return sum(part.stat().st_size for part in parts)
    except OSError:
        return 0


@dataclass(slots=True, eq=False)
class _SessionRun:
    """The run of one session while it goes on.

    ``waiting`` holds experiments to run with those that must end before them, ``running`` those
    given to a process with the task that it is at, ``killed`` tasks that have killed their workers.
    """

    plan: Plan
    store: Store
    template: Job
    progress: Callable[[Event], None] | None
    is_whole: bool
    outcomes: dict[TaskId, Outcome] = field(default_factory=dict)
    waiting: dict[str, set[str]] = field(default_factory=dict)
    running: dict[str, TaskId | None] = field(default_factory=dict)
    deaths: Counter[tuple[str, TaskId | None]] = field(default_factory=Counter)
    killed: dict[TaskId, str] = field(default_factory=dict)
    held: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    # --- telling ---

    def log(self, event: str, **details: Any) -> None:
        """Append to the log; the time stands there and nowhere else."""
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": now, "event": event, **details}, ensure_ascii=False)
        files.append_line(self.plan.session.folder / LOG, line)

    def tell(self, name: str, value: Any) -> None:
        """Take an event of a worker."""
        if name == "started":
            self.log("started", **value._asdict())
            self._show("started", value, "")
            return
        outcome: Outcome = value
        known = self.outcomes.get(outcome.task)
        if known is not None and known.state == DONE:
            return  # a second pass finds in the store what the first one computed
        self.outcomes[outcome.task] = outcome
        self.log("ended", **asdict(outcome))
        self._show(outcome.state, outcome.task, outcome.message)

    def _show(self, kind: str, task: TaskId, message: str) -> None:
        if self.progress is not None:
            total = max(len(self.plan.rows), len(self.outcomes))
            root = self.plan.session.root
            self.progress(Event(kind, task, len(self.outcomes), total, message, root))

    # --- running ---

    @property
    def is_over(self) -> bool:
        """Whether nothing is left to give or to wait for."""
        return not self.waiting and not self.running

    @property
    def suspects(self) -> set[str]:
        """Experiments that were under way when a process died; each runs alone, so that a second death is its own."""
        return {experiment for experiment, _ in self.deaths}

    @property
    def runs_suspect(self) -> bool:
        """Whether an experiment must be left alone now."""
        return not self.suspects.isdisjoint(self.running)

    def begin(self, jobs: int) -> None:
        """Write the beginning into the log, and find out what is to be done."""
        with contextlib.ExitStack() as held:
            held.callback(self.store.clean)  # after an interrupt; otherwise nothing is there
            held.enter_context(self.store.writing())
            to_run = len(self.plan.to_run)
            self.log("run started", tasks=len(self.plan.rows), to_run=to_run, jobs=jobs)
            if to_run:
                self._show("planned", self.plan.to_run[0].task, self.plan.summary)
            self.take_cached()
            self.held = held.pop_all()
        self.waiting = self._longest_first(self._needs())

    def end(self) -> RunResult:
        """Write the end into the log and sum up."""
        self.skip_rest()
        result = self.result()
        self.log("run finished", exit_code=result.exit_code)
        self.held.close()
        return result

    def leave(self, error: BaseException) -> None:
        """Write into the log what stopped everything."""
        with self.held, contextlib.suppress(StorageError):
            self.log("run interrupted", error=type(error).__name__)

    def take_cached(self) -> None:
        """Experiments with nothing to do need no worker."""
        busy = {row.experiment for row in self.plan.to_run}
        known = {name: self.store.latest(name) for name in {row.experiment for row in self.plan.rows} - busy}
        for row in self.plan.rows:
            key = self.plan.keys[row.task].value
            if row.experiment in busy or key is None:
                continue
            last = self.plan.last(row.task)
            if known[row.experiment].get((row.stage, row.recording)) != last:
                with self.store.experiment(row.experiment):
                    self.store.note_latest(row.task, *last)
            self.tell("ended", Outcome(*row.task, row.state, key))

    def must_stop(self) -> bool:
        """Whether a failure ends the whole run."""
        return self.template.fail_fast and any(o.state == FAILED for o in self.outcomes.values())

    def give(self, crew: Crew) -> None:
        """Hand out as many experiments as there is room for and wait for no other."""
        ready = [n for n, needs in self.waiting.items() if not needs & (self.waiting.keys() | self.running.keys())]
        suspects = [n for n in ready if n in self.suspects]
        chosen = [n for n in ready if n not in suspects][: crew.room]
        if suspects and not chosen and crew.is_idle:
            chosen = suspects[:1]
        for experiment in chosen:
            del self.waiting[experiment]
            own = {n: text for n, text in self.killed.items() if n.experiment == experiment}
            job = self._job(experiment, own)
            imports = imports_of(self.plan.tasks[row.task].stage for row in self.plan.to_run)
            call = Call(WORK, (job,), tells=True, imports=imports)
            crew.give((self, experiment), call, partial(self._hear, experiment))
            self.running[experiment] = None

    def take(self, experiment: str, answer: "list[Outcome] | Died") -> None:
        """Take how the call of an experiment ended."""
        blamed = self.running.pop(experiment)
        if isinstance(answer, Died):
            self._try_again(experiment, blamed, str(answer))
            return
        for outcome in answer:
            if self.outcomes.get(outcome.task) != outcome:  # not heard of before
                self.tell("ended", outcome)

    def _hear(self, experiment: str, event: tuple[str, Any]) -> None:
        """Take an event of a worker, and know what it is at."""
        name, value = event
        if name == "started":
            task = TaskId(*value)
            self.running[experiment] = task
            self.tell(name, task)
        else:
            self.running[experiment] = None
            self.tell(name, Outcome(**value))

    def _try_again(self, experiment: str, blamed: TaskId | None, how: str) -> None:
        """Give an experiment whose worker died another try; results up to then are in the store.

        A task that kills a second worker has failed, and the rest goes on without it; an
        experiment that kills two outside its tasks has failed as a whole.
        """
        self.log("worker died", experiment=experiment, task=blamed, message=how)
        self.deaths[experiment, blamed] += 1
        if self.deaths[experiment, blamed] < _TRIES:
            self.waiting[experiment] = set()
        elif blamed is not None and blamed not in self.killed:
            self.killed[blamed] = how
            self.waiting[experiment] = set()
        else:
            for row in self.plan.to_run:
                if row.experiment == experiment and row.task not in self.outcomes:
                    self.tell("ended", Outcome(*row.task, FAILED, message=how, exit_code=1, is_of_run=True))

    def _needs(self) -> dict[str, set[str]]:
        """Experiments to run, in order, each with those that must end before it."""
        needs: dict[str, set[str]] = {row.experiment: set() for row in self.plan.to_run}
        for row in self.plan.to_run:
            others = {before.experiment for before in self.plan.tasks[row.task].before}
            needs[row.experiment] |= (others - {row.experiment}) & needs.keys()
        return needs

    def _job(self, experiment: str, killed: Mapping[TaskId, str]) -> Job:
        """Make the job of an experiment, with what has failed in others or killed its workers."""
        known = {
            o.task: Failure(o.message, o.is_of_run)
            for o in self.outcomes.values()
            if o.state in (FAILED, SKIPPED) and o.experiment != experiment
        }
        return replace(
            self.template,
            experiment=experiment,
            wanted=frozenset(r.task for r in self.plan.rows if r.experiment == experiment),
            failures=known | {task: Failure(how, is_of_run=True) for task, how in killed.items()},
        )

    def _longest_first(self, waiting: dict[str, set[str]]) -> dict[str, set[str]]:
        """Sort experiments by what they and those behind them have to read, the most first.

        So the last ones to run are short, and all workers end together. The bytes of the files
        are all that is known of an experiment before it has run.
        """
        size = dict.fromkeys(waiting, 0)
        for row in self.plan.to_run:
            names = self.plan.tasks[row.task].files
            size[row.experiment] += sum(_bytes(self.plan.session.root / name) for name in names)
        behind = dict.fromkeys(waiting, 0)
        for name in reversed(waiting):  # the plan lists inputs first
            for needed in waiting[name]:
                behind[needed] = max(behind[needed], size[name] + behind[name])
        return dict(sorted(waiting.items(), key=lambda item: size[item[0]] + behind[item[0]], reverse=True))

    def skip_rest(self) -> None:
        """Account for what a stop after the first failure left undone."""
        for row in self.plan.rows:
            if row.task not in self.outcomes:
                message = "stopped after the first failure"
                self.tell("ended", Outcome(*row.task, SKIPPED, message=message))

    def result(self) -> RunResult:
        """Sum up."""
        order = {row.task: position for position, row in enumerate(self.plan.rows)}
        outcomes = sorted(self.outcomes.values(), key=lambda o: order.get(o.task, len(order)))
        records = ((o, self.store.record(o.key)) for o in outcomes if o.key is not None)
        work = [(o.experiment, o.stage, r.work) for o, r in records if r is not None]
        names = list(dict.fromkeys(o.experiment for o in outcomes))
        rows = tuple(self._tasks_row(name, outcomes) for name in names)
        pages = {n: self.plan.session.folder / page_name(n) for n in names}
        return RunResult(
            self.plan.session,
            tuple(outcomes),
            rows + summarise(work),
            {name: path for name, path in pages.items() if path.is_file()},
            self.plan if self.is_whole and not (self.plan.to_run or self.template.full) else None,
        )

    def _tasks_row(self, name: str, outcomes: list[Outcome]) -> LedgerRow:
        states = [o.state for o in outcomes if o.experiment == name]
        return LedgerRow(name, "", "tasks", states.count(DONE), sum(map(states.count, READY)))

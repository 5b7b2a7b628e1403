"""Runs by a plan: experiments side by side, each failure on its own, nothing half-done."""

import contextlib
import secrets
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, TypedDict, Unpack

import msgspec

from labpipe import files
from labpipe.errors import LabpipeError, StorageError
from labpipe.schema import Schema
from labpipe.workflow import engines, provenance
from labpipe.workflow._worker import Job
from labpipe.workflow.context import DONE, FAILED, SKIPPED, Outcome
from labpipe.workflow.engines import Crew, Died
from labpipe.workflow.graph import Stages, TaskId, imports_of
from labpipe.workflow.plan import Plan, page_name, plan
from labpipe.workflow.results import Event, RunResult
from labpipe.workflow.session import Session
from labpipe.workflow.store import LOG, Store, events_after, log


class Options(TypedDict, total=False):
    """Options of :func:`run_all`; ``targets`` to ``keep`` are those of :func:`labpipe.workflow.plan.plan`.

    ``jobs`` are the experiments computed at the same time, each in a process; default 1. 0 computes in this process,
    for a debugger; equal bytes are promised from 1 up, because only a process of its own can hold the libraries to one
    thread. ``cluster`` is the address of a Dask scheduler whose workers compute instead. ``schemas`` are those that
    stages name. ``progress`` is called with every :class:`Event`.
    """

    jobs: int
    cluster: str | None
    targets: Iterable[str] | None
    only: Iterable[str] | None
    full: bool
    keep: bool | None
    schemas: Mapping[str, Schema] | None
    progress: Callable[[Event], None] | None


def run(session: Session, stages: Stages, **options: Unpack[Options]) -> RunResult:
    """Compute the missing results of one session, by :class:`Options`; a failure of a stage is in the result.

    Raises UsageError, ConfigError, InputError: the run cannot begin; StorageError: nothing can be written at all;
    KeyboardInterrupt: after the workers have ended; everything finished until then is kept.
    """
    ((_, ended),) = run_all([session], stages, **options)
    if isinstance(ended, LabpipeError):
        raise ended
    return ended


def run_all(
    sessions: Iterable[Session], stages: Stages, **options: Unpack[Options]
) -> Generator[tuple[Session, RunResult | LabpipeError]]:
    """Compute the missing results of sessions, experiments of all of them side by side; see :class:`Options`.

    Sessions are asked for when there is room. Yields each with the end of its run, or why it could not begin.

    Raises InputError, UsageError: there is no such engine; KeyboardInterrupt: as for :func:`run`.
    """
    jobs, schemas, full = options.get("jobs", 1), options.get("schemas") or {}, options.get("full", False)
    engine = engines.choose(jobs, options.get("cluster"))

    def begin(session: Session) -> _SessionRun:
        store, chosen = Store(session.folder), (options.get("targets"), options.get("only"))
        files.remove_orphans(session.folder, is_deep=True)
        made = plan(session, stages, *chosen, full=full, keep=options.get("keep", False), store=store)
        store.index.save()
        is_final = chosen == (None, None) and not (made.to_run or full)
        program = provenance.program() if made.to_run else {}
        state = _SessionRun(made, store, schemas, options.get("progress"), is_final, program)
        state.begin(jobs)
        return state

    queue = iter(sessions)
    under_way: list[_SessionRun] = []
    try:
        with engine as crew:
            while True:
                for state in [state for state in under_way if not state.waiting and not state.running]:
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
                for state in under_way:
                    state.hear()
    except BaseException as error:
        for state in under_way:
            with contextlib.suppress(StorageError):
                log(state.plan.session, "run interrupted", error=type(error).__name__)
                files.remove_orphans(state.plan.session.folder, is_deep=True)
        raise


@dataclass(slots=True, eq=False)
class _SessionRun:
    """The run of one session while it goes on.

    ``is_final`` says that the plan still holds after the run. ``waiting`` has experiments to run with those that must
    end before them, ``running`` those given to a process with the task that it is at; ``heard`` are the bytes of the
    log that have been read.
    """

    plan: Plan
    store: Store
    schemas: Mapping[str, Schema]
    progress: Callable[[Event], None] | None
    is_final: bool
    program: Mapping[str, Any]
    mark: str = field(default_factory=lambda: secrets.token_hex(8))
    outcomes: dict[TaskId, Outcome] = field(default_factory=dict)
    waiting: dict[str, set[str]] = field(default_factory=dict)
    running: dict[str, TaskId | None] = field(default_factory=dict)
    heard: int = 0

    def show(self, kind: str, task: TaskId, message: str = "") -> None:
        """Hand an event to whoever follows the progress."""
        if self.progress is not None:
            done, total = len(self.outcomes), len(self.plan.rows)
            self.progress(Event(kind, task, done, total, message, self.plan.session.root))

    def note(self, outcome: Outcome) -> None:
        """Take the end of a task, once; a second pass finds results of the first one in the store."""
        known = self.outcomes.get(outcome.task)
        if known != outcome and (known is None or known.state != DONE):
            self.outcomes[outcome.task] = outcome
            self.show(outcome.state, outcome.task, outcome.message)

    def job(self, experiment: str) -> Job:
        """Make the job of an experiment."""
        failures = {task: one for task, one in self.outcomes.items() if one.state in (FAILED, SKIPPED)}
        return Job(self.plan.of(experiment), self.schemas, self.program, self.mark, failures)

    # --- beginning and end ---

    def begin(self, jobs: int) -> None:
        """Write the beginning into the log, and find out which experiments need a process, in which order."""
        plan = self.plan
        log(plan.session, "run started", tasks=len(plan.rows), to_run=len(plan.to_run), jobs=jobs)
        if plan.to_run:
            self.show("planned", plan.to_run[0].task, plan.summary)
        needs: dict[str, set[str]] = {row.experiment: set() for row in plan.to_run}
        size = dict.fromkeys(needs, 0)  # bytes to read are all that is known before a run
        for experiment in dict.fromkeys(row.experiment for row in plan.rows if row.experiment not in needs):
            for outcome in self.job(experiment).work():
                self.note(outcome)
        self.heard = (plan.session.folder / LOG).stat().st_size
        for row in plan.to_run:
            others = {other.experiment for other in plan.tasks[row.task].before}
            others.add(plan.session.experiments[row.experiment].base)  # a variant takes results of its base
            needs[row.experiment] |= (others - {row.experiment}) & needs.keys()
            size[row.experiment] += sum(entry["size"] for entry in plan.keys[row.task].files)
        # those with most to read first, so that all processes end together
        self.waiting = dict(sorted(needs.items(), key=lambda item: size[item[0]], reverse=True))

    def end(self) -> RunResult:
        """Write the end into the log and sum up."""
        outcomes = tuple(self.outcomes[row.task] for row in self.plan.rows)
        pages = {row.experiment: self.plan.session.folder / page_name(row.experiment) for row in self.plan.rows}
        reports = {name: path for name, path in pages.items() if path.is_file()}
        result = RunResult(self.plan.session, outcomes, reports, self.plan if self.is_final else None)
        log(self.plan.session, "run finished", exit_code=result.exit_code)
        return result

    # --- running ---

    def give(self, crew: Crew) -> None:
        """Hand out as many experiments as there is room for and wait for no other."""
        ready = [n for n, needs in self.waiting.items() if not needs & (self.waiting.keys() | self.running.keys())]
        for experiment in ready[: crew.room]:
            del self.waiting[experiment]
            self.running[experiment] = None
            imports = imports_of(self.plan.tasks[row.task].stage for row in self.plan.to_run)
            crew.give((self, experiment), self.job(experiment).work, imports)

    def hear(self) -> None:
        """Take the events that workers have written into the log, and know the tasks that they are at."""
        self.heard, found = events_after(self.plan.session, self.heard, self.mark)
        for event in found:
            task = TaskId(event["experiment"], event["stage"], event["recording"])
            is_start = event["event"] == "started"
            if task.experiment in self.running:
                self.running[task.experiment] = task if is_start else None
            if is_start:
                self.show("started", task)
            else:
                self.note(msgspec.convert(event, Outcome))

    def take(self, experiment: str, answer: list[Outcome] | Died) -> None:
        """Take the end of an experiment.

        Where two workers died over it, the task that it was at has failed, and the rest goes on; between tasks all has.
        """
        self.hear()
        blamed = self.running.pop(experiment)
        if not isinstance(answer, Died):
            for outcome in answer:
                self.note(outcome)
            return
        log(self.plan.session, "worker died", experiment=experiment, task=blamed, message=str(answer))
        left = [r.task for r in self.plan.to_run if r.experiment == experiment and r.task not in self.outcomes]
        if blamed is not None and blamed not in self.outcomes:
            self.waiting[experiment] = set()
            left = [blamed]
        for task in left:
            outcome = Outcome(*task, FAILED, message=str(answer), exit_code=1, is_of_run=True)
            log(self.plan.session, "ended", **asdict(outcome))
            self.note(outcome)

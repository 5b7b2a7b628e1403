"""Run what a plan says: experiments side by side, each failure on its own, nothing half-done."""

import datetime
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import InputError, StorageError
from labpipe.schema import Schema
from labpipe.workflow import pool, provenance
from labpipe.workflow.ledger import LedgerRow, summarise
from labpipe.workflow.plan import CACHED, Plan, make_plan, page_name, wanted_tasks
from labpipe.workflow.processes import Died
from labpipe.workflow.results import Results, read
from labpipe.workflow.session import Session, html_table
from labpipe.workflow.store import Store
from labpipe.workflow.tasks import Stages, TaskId, spell_out
from labpipe.workflow.worker import DONE, FAILED, SKIPPED, Job, Outcome, check_schemas, run_job

if TYPE_CHECKING:
    import xarray as xr

LOG = "run.jsonl"


@dataclass(frozen=True, slots=True)
class Event:
    """Told to the ``progress`` of a run.

    ``kind`` is ``started`` or how the task ended (``done``, ``cached``, ``failed``, ``skipped``);
    ``done`` of ``total`` tasks of the run have ended.
    """

    kind: str
    task: TaskId
    done: int
    total: int
    message: str = ""


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended.

    ``reports`` are the pages by experiment, where there is one. ``ledger`` holds the counts of
    all results and, per experiment with an empty stage name, tasks run (done) and cached (skipped).
    """

    session: Session
    outcomes: tuple[Outcome, ...]
    ledger: tuple[LedgerRow, ...]
    reports: Mapping[str, Path]

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """Tasks that failed; those skipped because of them are not among them."""
        return tuple(outcome for outcome in self.outcomes if outcome.state == FAILED)

    @property
    def exit_code(self) -> int:
        """What the command line returns.

        0 when nothing failed; 5 when something could not be written; the common code when every
        experiment failed with the same one; otherwise 1.
        """
        codes = {outcome.exit_code for outcome in self.failures}
        if not codes:
            return 0
        if StorageError.exit_code in codes:
            return StorageError.exit_code
        experiments = {outcome.experiment for outcome in self.outcomes}
        has_all_failed = experiments == {outcome.experiment for outcome in self.failures}
        return codes.pop() if has_all_failed and len(codes) == 1 else 1

    def dataset(self, experiment: str, stage: str, recording: str | None = None) -> "xr.Dataset":
        """Return a result.

        Raises
        ------
        InputError
            There is no such result.
        StoreError
            It is damaged.
        """
        wanted = TaskId(experiment, stage, recording)
        for outcome in self.outcomes:
            if outcome.task == wanted and outcome.key is not None:
                return read(Store(self.session.folder), outcome.key, wanted)
        message = f"{wanted} gave no result in this run"
        raise InputError(message)

    def _repr_html_(self) -> str:
        names = ("experiment", "stage", "recording", "state", "message")
        rows = [[getattr(o, name) or "" for name in names] for o in self.outcomes]
        count = {o.state: 0 for o in self.outcomes}
        for outcome in self.outcomes:
            count[outcome.state] += 1
        summary = ", ".join(f"{n} {state}" for state, n in sorted(count.items()))
        return html_table(f"{self.session.title}: {summary or 'nothing to do'}", names, rows)


def run(
    session: Session,
    stages: Stages,
    *,
    jobs: int = 1,
    targets: Iterable[str] | None = None,
    only: Iterable[str] | None = None,
    fail_fast: bool = False,
    full: bool = False,
    paranoid: bool = False,
    schemas: Mapping[str, Schema] | None = None,
    progress: Callable[[Event], None] | None = None,
) -> RunResult:
    """Compute what a session lacks.

    Parameters
    ----------
    session : Session
        See :func:`labpipe.workflow.session.load`.
    stages : mapping
        The stages of every kind of experiment.
    jobs : int
        Experiments computed at the same time, each in its own process. 0 computes in this
        process, for looking into a stage with a debugger; equal bytes are promised from 1 up,
        because only a process of its own can hold the libraries to one thread.
    targets, only : str or iterable of str, optional
        See :func:`labpipe.workflow.plan.plan`.
    fail_fast : bool
        Stop everything at the first failure.
    full : bool
        Without shortcuts; stages that declare ``shortcuts`` are told.
    paranoid : bool
        Read every file again instead of trusting size, times and inode.
    schemas : mapping, optional
        The schemas that stages name.
    progress : callable, optional
        Told every :class:`Event`.

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
    if jobs < 0:
        message = f"jobs must be at least 0, found {jobs}"
        raise InputError(message)
    check_schemas(stages, schemas or {})
    store = Store(session.folder, paranoid=paranoid)
    store.clean()
    tasks = spell_out(session, stages)
    made = make_plan(session, tasks, wanted_tasks(session, tasks, targets, only), store, full=full)
    if made.to_run:
        store.index.save()
    template = Job(
        session=session,
        stages=stages,
        schemas=dict(schemas or {}),
        experiment="",
        wanted=frozenset(),
        full=full,
        paranoid=paranoid,
        fail_fast=fail_fast,
        program=provenance.program() if made.to_run else {},
        failures={},
    )
    state = _State(made, store, template, progress)
    try:
        with store.writing():
            state.all(jobs)
    finally:
        store.clean()  # after an interrupt; otherwise there is nothing to remove
    return state.result()


def open_result(
    session: Session,
    stages: Stages,
    experiment: str,
    stage: str,
    recording: str | None = None,
    *,
    full: bool = False,
) -> "xr.Dataset":
    """Return an up-to-date stored result without running anything.

    Raises
    ------
    UsageError
        The experiment or stage is unknown.
    InputError
        The result is missing or out of date; run first.
    StoreError
        It is damaged.
    """
    store = Store(session.folder)
    tasks = spell_out(session, stages)
    wanted_tasks(session, tasks, [f"{experiment}/{stage}"], [experiment])
    task = TaskId(experiment, stage, recording)
    known = frozenset(n for n in tasks if n[:2] == task[:2])
    made = make_plan(session, tasks, known & {task} or known, store, full=full)
    return Results(made).result(experiment, stage, recording)


def events(session: Session) -> Iterator[dict[str, Any]]:
    """Go through the log of all runs; lines that a kill left incomplete are passed over."""
    path = session.folder / LOG
    if not path.is_file():
        return
    for line in path.read_text("utf-8", errors="replace").splitlines():
        try:
            event = json.loads(line)
        except ValueError:
            continue
        if isinstance(event, dict):
            yield event


def _bytes(path: Path) -> int:
    """Size of a file or folder; nothing where it cannot be read, which its stage will say."""
    try:
        parts = files.files_below(path) if path.is_dir() else [path]
        return sum(part.stat().st_size for part in parts)
    except OSError:
        return 0


@dataclass(slots=True)
class _State:
    """A run while it goes on."""

    plan: Plan
    store: Store
    template: Job
    progress: Callable[[Event], None] | None
    outcomes: dict[TaskId, Outcome] = field(default_factory=dict)

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
            self.progress(Event(kind, task, len(self.outcomes), total, message))

    # --- running ---

    def all(self, jobs: int) -> None:
        """Run everything, and write the beginning and the end into the log."""
        to_run = len(self.plan.to_run)
        self.log("run started", tasks=len(self.plan.rows), to_run=to_run, jobs=jobs)
        try:
            self.take_cached()
            if jobs:
                self.in_processes(jobs)
            else:
                self.here()
            self.skip_rest()
        except BaseException as error:
            self.log("run interrupted", error=type(error).__name__)
            raise
        self.log("run finished", exit_code=self.result().exit_code)

    def take_cached(self) -> None:
        """Experiments with nothing to do need no process."""
        busy = {row.experiment for row in self.plan.to_run}
        for row in self.plan.rows:
            key = self.plan.keys[row.task].value
            if row.experiment in busy or key is None:
                continue
            if self.store.latest(row.experiment).get((row.stage, row.recording)) != key:
                with self.store.experiment(row.experiment):
                    self.store.note_latest(row.task, key)
            self.tell("ended", Outcome(*row.task, CACHED, key))

    def waiting(self) -> dict[str, set[str]]:
        """Experiments to run, in order, each with those that must end before it."""
        needs: dict[str, set[str]] = {row.experiment: set() for row in self.plan.to_run}
        for row in self.plan.to_run:
            others = {before.experiment for before in self.plan.tasks[row.task].before}
            needs[row.experiment] |= (others - {row.experiment}) & needs.keys()
        return needs

    def job(self, experiment: str, failures: Mapping[TaskId, str] | None = None) -> Job:
        """Make the job of an experiment, with what has failed in others."""
        known = {
            o.task: o.message
            for o in self.outcomes.values()
            if o.state in (FAILED, SKIPPED) and o.experiment != experiment
        }
        return replace(
            self.template,
            experiment=experiment,
            wanted=frozenset(r.task for r in self.plan.rows if r.experiment == experiment),
            failures=known | dict(failures or {}),
        )

    def must_stop(self) -> bool:
        """Whether a failure ends the whole run."""
        return self.template.fail_fast and any(o.state == FAILED for o in self.outcomes.values())

    def here(self) -> None:
        """Run in this process, one experiment after the other."""
        for experiment in self._in_order():
            if not self.must_stop():
                run_job(self.job(experiment), self.tell)

    def _in_order(self) -> list[str]:
        """Experiments to run; the plan lists inputs first."""
        return list(dict.fromkeys(row.experiment for row in self.plan.to_run))

    def _longest_first(self, waiting: dict[str, set[str]]) -> dict[str, set[str]]:
        """Sort experiments by what they and those behind them have to read, the most first.

        So the last ones to run are short, and all processes end together. The bytes of the files
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
        return dict(
            sorted(waiting.items(), key=lambda item: size[item[0]] + behind[item[0]], reverse=True)
        )

    def in_processes(self, jobs: int) -> None:
        """Run every experiment in a process of its own, at most ``jobs`` at a time."""
        waiting = self._longest_first(self.waiting())
        running: list[pool.Worker] = []
        stages = [self.plan.tasks[row.task].stage for row in self.plan.to_run]
        preload = sorted({stage.function.partition(":")[0] for stage in stages})
        preload += sorted({name for stage in stages for name in stage.imports})
        if any(stage.output == "page" for stage in stages):
            preload += pool.PRELOADED_TO_DRAW
        try:
            while (waiting or running) and not self.must_stop():
                busy = {worker.job.experiment for worker in running}
                ready = [n for n, needs in waiting.items() if not needs & (busy | waiting.keys())]
                for experiment in ready[: jobs - len(running)]:
                    del waiting[experiment]
                    running.append(pool.Worker(self.job(experiment), preload))
                for worker in pool.wait(running):
                    running += self._take(worker, running, preload)
        finally:
            for worker in running:
                worker.stop()

    def _take(
        self, worker: pool.Worker, running: list[pool.Worker], preload: list[str]
    ) -> list[pool.Worker]:
        """Take one event; return the worker that goes on when this one died."""
        try:
            event = worker.receive()
        except Died as death:
            running.remove(worker)
            worker.stop()
            return self._go_on(worker, str(death), preload)
        if event is None:
            running.remove(worker)
            worker.stop()
        elif event[0] == "started":
            worker.current = event[1]
            self.tell(*event)
        else:
            worker.current = None
            self.tell(*event)
        return []

    def _go_on(self, worker: pool.Worker, how: str, preload: list[str]) -> list[pool.Worker]:
        """Count the task that killed its process as failed and go on with the rest.

        A process that dies outside a task would die again; its experiment ends here.
        """
        if worker.current is None or worker.current in worker.job.failures:
            for row in self.plan.to_run:
                if row.experiment == worker.job.experiment and row.task not in self.outcomes:
                    self.tell("ended", Outcome(*row.task, FAILED, message=how, exit_code=1))
            return []
        failures = {
            name: text
            for name, text in worker.job.failures.items()
            if name.experiment == worker.job.experiment
        }
        job = self.job(worker.job.experiment, failures | {worker.current: how})
        return [pool.Worker(job, preload)]

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
        )

    def _tasks_row(self, name: str, outcomes: list[Outcome]) -> LedgerRow:
        states = [o.state for o in outcomes if o.experiment == name]
        return LedgerRow(name, "", "tasks", states.count(DONE), states.count(CACHED))

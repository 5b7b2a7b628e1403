"""One experiment, task by task: read the inputs, call the function, check and store the result."""

import importlib
import platform
import time
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from labpipe import files
from labpipe.errors import NO_INPUT, InputError, LabpipeError, SourceError, StageError, StoreError
from labpipe.plugins import PluginWarning
from labpipe.schema import Schema, check
from labpipe.workflow import _ledger, code, provenance
from labpipe.workflow._keys import Key, describe_file
from labpipe.workflow.context import Context, Failed, Kept, RawFile, Warned
from labpipe.workflow.plan import READY, Plan, make_plan, page_name
from labpipe.workflow.session import Session
from labpipe.workflow.store import Caught, Record, Store
from labpipe.workflow.tasks import Argument, Stages, Task, TaskId, ancestors, spell_out, stage_name

if TYPE_CHECKING:
    import xarray as xr

DONE, FAILED, SKIPPED = "done", "failed", "skipped"

_SPARE = 1.5
"""Free space asked for, relative to the size expected of a result."""
_SMALLEST = 1 << 20
"""Bytes asked for when nothing is known of a result's size."""

_OURS = ("work", "provenance")
"""Attributes that belong to one result and must not travel into the next one made of it."""


class Failure(NamedTuple):
    """Why a task gave no result, whether the run was at fault rather than what it was given, and the error's reason."""

    text: str
    is_of_run: bool = False
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Job:
    """What a worker is told: the session, the experiment, and the tasks wanted of it.

    ``failures`` are tasks that have failed already, elsewhere or in a process that died.
    """

    session: Session
    stages: Stages
    schemas: Mapping[str, Schema]
    experiment: str
    wanted: frozenset[TaskId]
    full: bool
    paranoid: bool
    keep: bool | None
    fail_fast: bool
    program: Mapping[str, Any]
    failures: Mapping[TaskId, Failure]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How one task ended: ``done``, ``cached``, ``kept``, ``failed`` or ``skipped``; written into the log.

    ``key`` finds the result in the store (None where there is none). ``message`` says why there
    is none; ``exit_code`` and ``error`` (the class) tell what went wrong, ``details`` where;
    ``is_of_run`` that the run was at fault, which tells nothing about what was recorded.
    ``reason`` is the error's. ``seconds`` passed on the clock, ``processor_seconds`` on all cores of this process.
    """

    experiment: str
    stage: str
    recording: str | None
    state: str
    key: str | None = None
    message: str = ""
    exit_code: int = 0
    error: str = ""
    details: str = ""
    seconds: float = 0.0
    processor_seconds: float = 0.0
    is_of_run: bool = False
    reason: str = ""

    @property
    def task(self) -> TaskId:
        """The task that ended."""
        return TaskId(self.experiment, self.stage, self.recording)


Emit = Callable[[str, Any], None]
"""Takes ``"started"`` with a TaskId or ``"ended"`` with an Outcome."""

WORK = "labpipe.workflow._worker:work"
"""What a crew is given to call with a job."""


class _StartAgain(Exception):  # noqa: N818 (not an error: the plan is made anew)
    """An input changed, or a stored one was damaged, so that the plan no longer holds.

    A task causes this once; the second time it fails.
    """

    def __init__(self, task: TaskId) -> None:
        self.task = task
        super().__init__(str(task))


def work(job: Job, *, tell: Callable[[Any], None]) -> list[Outcome]:
    """Compute what an experiment lacks; tell each event in plain values, return all outcomes.

    Raises
    ------
    InputError
        The session is not there, on a machine that does not share its folder.
    """
    if not job.session.root.is_dir():
        raise InputError(
            f"{platform.node()} sees no folder {job.session.root}; "
            "a session must lie under the same path on every machine"
        )
    outcomes: list[Outcome] = []

    def emit(name: str, value: Any) -> None:
        if name == "ended":
            outcomes.append(value)
        tell([name, msgspec.to_builtins(value)])

    run_job(job, emit)
    return outcomes


def run_job(job: Job, emit: Emit) -> None:
    """Compute what an experiment lacks, under its lock, and tell how every task ended.

    Another process that computes the same experiment is waited for, and its results are used.
    """
    ended: set[TaskId] = set()

    def tell(name: str, value: Any) -> None:
        if name == "ended":
            ended.add(value.task)
        emit(name, value)

    try:
        _attempts(job, tell)
    except LabpipeError as error:
        # Outside a task, as when the lock or the list of last keys cannot be written.
        for task in sorted(job.wanted - ended, key=str):
            kind = type(error).__name__
            emit("ended", Outcome(*task, FAILED, None, str(error), error.exit_code, kind, is_of_run=error.is_of_run))


def _attempts(job: Job, emit: Emit) -> None:
    store = Store(job.session.folder, paranoid=job.paranoid)
    tasks = spell_out(job.session, job.stages)
    with store.writing(), store.experiment(job.experiment):
        retried: set[TaskId] = set()
        is_finished = False
        while not is_finished:  # at most once for every task
            made = make_plan(job.session, tasks, job.wanted, store, full=job.full, keep=job.keep)
            try:
                _Run(job, store, made, emit, frozenset(retried), dict(job.failures)).all()
                is_finished = True
            except _StartAgain as again:
                retried.add(again.task)
        store.index.save()


class _Clock(NamedTuple):
    """Moment at which a task began."""

    wall: float
    processor: float

    @classmethod
    def now(cls) -> "_Clock":
        return cls(time.perf_counter(), time.process_time())

    def until_now(self) -> "_Clock":
        """Return what has passed since."""
        wall, processor = self.now()
        return _Clock(wall - self.wall, processor - self.processor)


@dataclass(slots=True)
class _Run:
    """One pass over the rows of one experiment."""

    job: Job
    store: Store
    plan: Plan
    emit: Emit
    retried: frozenset[TaskId]
    failures: dict[TaskId, Failure]
    stopped: bool = field(default=False)
    passed: dict[TaskId, Any] = field(default_factory=dict)

    def all(self) -> None:
        for row in self.plan.rows:
            if row.experiment != self.job.experiment:
                continue
            if row.state in READY:
                last = self.plan.last(row.task)
                self.store.note_latest(row.task, *last)
                self.emit("ended", Outcome(*row.task, row.state, last.key))
                continue
            outcome = self._one(self.plan.tasks[row.task])
            if outcome.state in (FAILED, SKIPPED):
                self.failures[row.task] = Failure(outcome.message, outcome.is_of_run, outcome.reason)
                self.stopped |= self.job.fail_fast
            self.emit("ended", outcome)

    def _one(self, task: Task) -> Outcome:
        if task.id in self.job.failures:
            text, is_of_run, reason = self.job.failures[task.id]
            return Outcome(*task.id, FAILED, message=text, exit_code=1, is_of_run=is_of_run, reason=reason)
        if self.stopped:
            return Outcome(*task.id, SKIPPED, message="stopped after the first failure", is_of_run=True)
        missing = self._missing(task)
        is_page = task.stage.output == "page" and task.stage.context
        if missing and not (is_page or task.stage.tolerant):
            is_of_run = any(self.failures[name].is_of_run for name in missing)
            return Outcome(
                *task.id, SKIPPED, message=f"{missing[0]} gave no result", is_of_run=is_of_run, reason=NO_INPUT
            )
        self.emit("started", task.id)
        begun = _Clock.now()
        try:
            key = self._page_or_result(task)
        except _StartAgain:
            raise
        except LabpipeError as error:
            return self._failed(task, error, str(error), error.exit_code, begun)
        except (Exception, SystemExit) as error:
            # A stage is foreign code to the runner: whatever it raises ends this task alone.
            text = f"unexpected {type(error).__name__}: {error}"
            return self._failed(task, error, text, StageError.exit_code, begun)
        seconds, processor = begun.until_now()
        return Outcome(*task.id, DONE, key, seconds=seconds, processor_seconds=processor)

    def _failed(self, task: Task, error: BaseException, text: str, code: int, begun: "_Clock") -> Outcome:
        details = "".join(traceback.format_exception(error))
        seconds, processor = begun.until_now()
        return Outcome(
            *task.id,
            FAILED,
            message=self._relative(text),
            exit_code=code,
            error=type(error).__name__,
            details=details,
            seconds=seconds,
            processor_seconds=processor,
            # what a step did not expect is a mistake of its own, and tells nothing about a record
            is_of_run=not isinstance(error, LabpipeError) or error.is_of_run,
            reason=error.reason if isinstance(error, LabpipeError) else "",
        )

    def _missing(self, task: Task) -> list[TaskId]:
        """List inputs without a result: they failed, or another experiment has not made them."""
        for name in task.before:
            value = self.plan.keys[name].value
            if name.experiment == self.job.experiment or name in self.failures:
                continue
            if value is None or self.store.state(value) != "stored":
                self.failures[name] = Failure(f"{name} gave no result", is_of_run=True, reason=NO_INPUT)
        failed = [name for name in task.before if name in self.failures]
        return [name for name in failed if name in task.required or self.failures[name].is_of_run]

    def _relative(self, text: str) -> str:
        """Write paths relative to the session, so that a moved folder gives the same text."""
        return text.replace(f"{self.job.session.root}/", "")

    # --- one call ---

    def _page_or_result(self, task: Task) -> str | None:
        key = self.plan.keys[task.id]
        is_page = task.stage.output == "page"
        state = "absent" if key.value is None else self.store.state(key.value)
        if key.value is not None and state == "damaged":
            self.store.quarantine(key.value)
        if is_page and key.value is not None and state == "stored":
            self._publish(task, str(self._read(task, key.value)))
            self._keep(task.id, key.value)
            return key.value
        if key.problem:
            raise InputError(key.problem)
        if not is_page and key.value is None and not task.stage.tolerant:
            raise StageError(*task.id[:2], "an input has no key; run again")
        self._require_space(task)
        result, caught = self._call(task, key)
        failed = [name for name in ancestors(self.plan.tasks, task.id) if name in self.failures]
        if is_page and (failed or key.value is None):
            # Not stored: the page of an experiment that failed is made again in every run.
            self._publish(task, self._text(task, result))
            return None
        if task.stage.tolerant and (failed or key.value is None):
            self.passed[task.id] = result
            return None
        if is_page:
            record = self.store.write(key.ingredients, self._text(task, result), warnings=caught)
            self._publish(task, self._text(task, result))
        else:
            record = self._store(task, key, result, caught)
        self._keep(task.id, record.key)
        return record.key

    def _call(self, task: Task, key: Key) -> tuple[Any, tuple[Caught, ...]]:
        """Call the function; start again when a file changed before it returned or failed."""
        function = _import(task)
        self._refuse_changed(task, key)
        arguments = [self._argument(task, argument) for argument in task.arguments]
        keywords: dict[str, Any] = {"settings": self.job.session.experiments[task.id.experiment].settings}
        if task.stage.context:
            keywords["context"] = self._context(task)
        if task.stage.shortcuts:
            keywords["full"] = self.job.full
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", PluginWarning)  # of the installation, not of the result
            try:
                result = function(*arguments, **keywords)
            finally:
                code.refuse_changed()
                self._refuse_changed(task, key)
        return result, self._caught(raised)

    def _refuse_changed(self, task: Task, key: Key) -> None:
        for argument in key.ingredients["inputs"]:
            for known in argument.get("files", ()):
                found = describe_file(self.job.session.root, known["name"], self.store.index)
                if found == known:
                    continue
                if task.id not in self.retried:
                    raise _StartAgain(task.id)
                hint = "wait until it is complete, or copy it here first, and run again"
                message = "still being written: its content changed while it was read"
                error = SourceError(known["name"], message, hint=hint)
                error.is_of_run = True  # the same file may be whole the next time
                raise error

    def _argument(self, task: Task, argument: Argument) -> Any:
        values: list[Any]
        if argument.files:
            values = [self.job.session.root / name for name in argument.files]
        else:
            values = [self._input(task, name) for name in argument.tasks]
        return argument.arranged(values)

    def _input(self, task: Task, name: TaskId) -> Any:
        value = self.plan.keys[name].value
        if name in self.passed:
            return self.passed[name]
        if name in self.failures or value is None:
            return None
        result = self._read(task, value)
        if task.stage.output == "dataset" and not isinstance(result, str):
            for attribute in _OURS:
                result.attrs.pop(attribute, None)
        return result

    def _read(self, task: Task, key: str) -> "xr.Dataset | str":
        try:
            return self.store.read(key)
        except StoreError:
            if task.id in self.retried:
                raise
            raise _StartAgain(task.id) from None

    def _caught(self, raised: list[warnings.WarningMessage]) -> tuple[Caught, ...]:
        """Warnings for the report; those for programmers say nothing about the data."""
        quiet = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)
        found: dict[tuple[str, str], int] = {}
        for warning in raised:
            if not issubclass(warning.category, quiet):
                entry = (warning.category.__name__, self._relative(str(warning.message)))
                found[entry] = found.get(entry, 0) + 1
        return tuple(Caught(*entry, count) for entry, count in found.items())

    # --- what is kept ---

    def _store(self, task: Task, key: Key, result: Any, caught: tuple[Caught, ...]) -> Record:
        import xarray as xr

        if not isinstance(result, xr.Dataset):
            raise StageError(*task.id[:2], f"must return a Dataset, returned {type(result).__name__}")
        schema = self.job.schemas.get(task.stage.schema or "", Schema(task.stage.name))
        work = _ledger.counts(result.attrs.get("work"))
        about = provenance.of_task(self.job.program, self.plan.tasks, self.plan.keys, task.id)
        attributes = {"provenance": files.canonical(about)}
        if work:
            attributes["work"] = files.canonical(work)
        result = check(result, schema).assign_attrs(attributes)
        return self.store.write(key.ingredients, result, warnings=caught, work=work)

    def _text(self, task: Task, result: Any) -> str:
        if not isinstance(result, str):
            raise StageError(*task.id[:2], f"must return the text of a page, returned {type(result).__name__}")
        return result

    def _publish(self, task: Task, page: str) -> None:
        files.write_text(self.job.session.folder / page_name(task.id.experiment), page)

    def _keep(self, task_id: TaskId, key: str | None) -> None:
        if key is not None:
            self.store.note_latest(task_id, key)

    def _require_space(self, task: Task) -> None:
        """Ask for the space of the last result of this task, or of the results it is made of."""
        last = self.store.last(task.id)
        sizes = [self._size(None if last is None else last.key)]
        if not sizes[0]:
            sizes = [self._size(self.plan.keys[name].value) for name in task.before]
        files.require_space(self.store.root, int(_SPARE * max(sum(sizes), _SMALLEST)))

    def _size(self, key: str | None) -> int:
        record = None if key is None else self.store.record(key)
        return 0 if record is None else record.size

    # --- what a page is told ---

    def _context(self, task: Task) -> Context:
        session, keys = self.job.session, self.plan.keys
        behind = ancestors(self.plan.tasks, task.id)
        records = {
            name: record
            for name in behind
            if name not in self.failures
            and (value := keys[name].value) is not None
            and (record := self.store.record(value)) is not None
        }
        return Context(
            experiment=task.id.experiment,
            kind=session.experiments[task.id.experiment].kind,
            title=session.title,
            operator=session.operator,
            notes=session.notes,
            synthetic=session.synthetic,
            ledger=_ledger.summarise((n.experiment, n.stage, r.work) for n, r in records.items()),
            warnings=tuple(
                Warned(stage_name(task, name), name.recording, w.category, w.text, w.count)
                for name, record in records.items()
                for w in record.warnings
            ),
            failures=tuple(
                Failed(stage_name(task, name), name.recording, *self.failures[name])
                for name in behind
                if name in self.failures
            ),
            inputs=tuple(RawFile(**entry) for entry in provenance.raw_files(keys[name] for name in behind)),
            provenance=provenance.of_task(self.job.program, self.plan.tasks, keys, task.id),
            kept=tuple(
                Kept(stage_name(task, name), name.recording, changed)
                for name, changed in self.plan.kept(task.id).items()
            ),
        )


def _import(task: Task) -> Callable[..., Any]:
    module, _, name = task.stage.function.partition(":")
    try:
        function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, SyntaxError) as error:
        raise StageError(*task.id[:2], f"{task.stage.function} cannot be imported: {error}") from error
    return function


def check_schemas(stages: Stages, schemas: Mapping[str, Schema]) -> None:
    """Refuse a stage that names a schema which the run is not given.

    Raises
    ------
    InputError
        Naming every such stage.
    """
    known = [(kind, stage) for kind, sequence in stages.items() for stage in sequence if stage.schema is not None]
    problems = [
        f'stage "{stage.name}" of "{kind}" names the unknown schema "{stage.schema}"'
        for kind, stage in known
        if stage.schema not in schemas
    ]
    if problems:
        raise InputError("; ".join(problems))

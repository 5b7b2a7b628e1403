"""One experiment, task by task: read the inputs, call the function, check and store the result."""

import importlib
import platform
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

from labpipe import files
from labpipe.errors import NO_INPUT, InputError, LabpipeError, SourceError, StageError
from labpipe.plugins import PluginWarning
from labpipe.schema import Schema, check
from labpipe.workflow import code, provenance
from labpipe.workflow.context import Context, Failed, Kept, Warned, counts, summarise
from labpipe.workflow.exclusions import EXCLUDE, concerning
from labpipe.workflow.graph import Stages, Task, TaskId, ancestors
from labpipe.workflow.plan import READY, Key, Plan, code_changed, describe_file, page_name, plan
from labpipe.workflow.session import Session
from labpipe.workflow.store import Caught, Store, log

DONE, FAILED, SKIPPED = "done", "failed", "skipped"

_OURS = ("work", "provenance")
"""Attributes that belong to one result and must not travel into the next one made of it."""
_FOR_PROGRAMMERS = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)
"""Warnings that say nothing about the data."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of one task: ``done``, ``cached``, ``kept``, ``failed`` or ``skipped``; written into the log.

    ``key`` finds the result in the store. Where there is none ``message`` says why; ``exit_code``, ``error`` (the
    class), ``reason`` and ``is_of_run`` are those of the error, ``details`` its place. ``seconds`` passed on the clock.
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
    is_of_run: bool = False
    reason: str = ""

    @property
    def task(self) -> TaskId:
        """The task that ended."""
        return TaskId(self.experiment, self.stage, self.recording)


@dataclass(frozen=True, slots=True)
class Job:
    """Everything that the processes of one run of a session share; ``run`` marks their events in its log."""

    session: Session
    stages: Stages
    schemas: Mapping[str, Schema]
    full: bool
    keep: bool | None
    program: Mapping[str, Any]
    run: str = ""


def work(job: Job, experiment: str, wanted: frozenset[TaskId], failures: Mapping[TaskId, Outcome]) -> list[Outcome]:
    """Compute the wanted results of an experiment that are missing, under its lock.

    Another process that computes the same experiment is waited for, and its results are used. ``failures`` are tasks
    that have failed already, elsewhere or in a process that died. The beginning and the end of every task are written
    into the log, from which the run learns of them; they are returned too, for a machine that sees the log too late.

    Raises InputError: the session is not there; StorageError: the log cannot be written.
    """
    if not job.session.files.is_dir():
        raise InputError(
            f"{platform.node()} sees no folder {job.session.files}; "
            "a session must lie under the same path on every machine"
        )
    ended: dict[TaskId, Outcome] = {}

    def emit(event: str, value: TaskId | Outcome) -> None:
        log(job.session, event, run=job.run, **(asdict(value) if isinstance(value, Outcome) else value._asdict()))
        if isinstance(value, Outcome):
            ended[value.task] = value

    try:
        store = Store(job.session.folder)
        with store.writing(), store.experiment(experiment):
            made = plan(job.session, job.stages, wanted, full=job.full, keep=job.keep, store=store)
            _Run(job, experiment, store, made, emit, dict(failures)).all()
            store.index.save()
    except LabpipeError as error:  # outside a task, as when the lock or the list of last keys cannot be written
        kind = type(error).__name__
        for task in sorted(wanted - ended.keys(), key=str):
            emit("ended", Outcome(*task, FAILED, None, str(error), error.exit_code, kind, is_of_run=error.is_of_run))
    return list(ended.values())


@dataclass(slots=True)
class _Run:
    """One pass over the rows of one experiment; ``passed`` holds Datasets that are handed on and not kept."""

    job: Job
    experiment: str
    store: Store
    plan: Plan
    emit: Callable[[str, TaskId | Outcome], None]
    failures: dict[TaskId, Outcome]
    passed: dict[TaskId, Any] = field(default_factory=dict)

    def all(self) -> None:
        for row in self.plan.rows:
            if row.experiment != self.experiment:
                continue
            if row.state in READY:
                last = self.plan.last(row.task)
                self.store.note_latest(row.task, *last)
                outcome = Outcome(*row.task, row.state, last.key)
            else:
                outcome = self.failures.get(row.task) or self._outcome(self.plan.tasks[row.task])
            if outcome.state in (FAILED, SKIPPED):
                self.failures[row.task] = outcome
            self.emit("ended", outcome)

    def _outcome(self, task: Task) -> Outcome:
        """Compute one task, unless an input is missing."""
        failed = [name for name in task.before if name in self.failures]
        missing = [name for name in failed if name in task.required or self.failures[name].is_of_run]
        if missing and not task.stage.context:
            is_of_run = any(self.failures[name].is_of_run for name in missing)
            text = f"{missing[0]} gave no result"
            return Outcome(*task.id, SKIPPED, message=text, is_of_run=is_of_run, reason=NO_INPUT)
        self.emit("started", task.id)
        begun = time.perf_counter()
        try:
            key = self._made(task)
        except (Exception, SystemExit) as error:
            # A stage is foreign code to the runner: whatever it raises ends this task alone.
            # Unless it is one of ours, the mistake is the step's, not a record's.
            ours = (
                error if isinstance(error, LabpipeError) else StageError(f"unexpected {type(error).__name__}: {error}")
            )
            return Outcome(
                *task.id,
                FAILED,
                message=self._relative(str(ours)),
                exit_code=ours.exit_code,
                error=type(error).__name__,
                details="".join(traceback.format_exception(error)),
                seconds=time.perf_counter() - begun,
                is_of_run=ours.is_of_run,
                reason=ours.reason,
            )
        return Outcome(*task.id, DONE, key, seconds=time.perf_counter() - begun)

    def _relative(self, text: str) -> str:
        """Write paths relative to the session, so that a moved folder gives the same text."""
        return text.replace(f"{self.job.session.files}/", "").replace(f"{self.job.session.root}/", "")

    def _made(self, task: Task) -> str | None:
        """Return the key of a result, made or found now; None where it rests on failures and is not kept."""
        key, stage = self.plan.keys[task.id], task.stage
        is_page, page = stage.output == "page", self.job.session.folder / page_name(task.id.experiment)
        state = "absent" if key.value is None else self.store.state(key.value)
        if state == "damaged":
            self.store.quarantine(key.value or "")
        elif is_page and state == "stored":  # but not in its place
            files.write_text(page, str(self.store.read(key.value or "")))
            self.store.note_latest(task.id, key.value or "")
            return key.value
        if key.problem:
            raise InputError(key.problem)
        # half as much again as the last result of this task, or the results that it is made of; 1 MiB at least
        last, before = self.store.last(task.id), [self.plan.keys[name].value for name in task.before]
        sizes = [0 if one is None else self.store.size(one) for one in (last and last.key, *before)]
        files.require_space(self.store.root, 3 * max(sizes[0] or sum(sizes), 1 << 20) // 2)
        result, caught = self._call(task, key)
        if is_page:
            files.write_text(page, result)
        is_on_failures = any(name in self.failures for name in ancestors(self.plan.tasks, task.id))
        if (is_on_failures or key.value is None) and (is_page or stage.context):  # made again in every run
            self.passed[task.id] = result
            return None
        work = {}
        if not is_page:
            work = counts(result.attrs.get("work"))
            about = provenance.of_task(self.job.program, self.plan.tasks, self.plan.keys, task.id)
            attributes = {"provenance": files.canonical(about)} | ({"work": files.canonical(work)} if work else {})
            schema = self.job.schemas.get(stage.schema or "", Schema(stage.name))
            result = check(result, schema).assign_attrs(attributes)
        record = self.store.write(key.ingredients, result, warnings=caught, work=work)
        self.store.note_latest(task.id, record.key)
        return record.key

    # --- one call ---

    def _call(self, task: Task, key: Key) -> tuple[Any, tuple[Caught, ...]]:
        """Call the function, and refuse its result where a file has changed before it returned or failed."""
        import xarray as xr

        function = _import(task)
        arguments = [argument.arranged(partial(self._value, task)) for argument in task.arguments]
        settings = self.job.session.experiments[task.id.experiment].settings
        is_narrow = EXCLUDE in task.stage.parameters
        keywords: dict[str, Any] = {"settings": concerning(settings, task.files) if is_narrow else settings}
        if task.stage.context:
            keywords["context"] = self._context(task, key)
        if task.stage.shortcuts:
            keywords["full"] = self.job.full
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", PluginWarning)  # of the installation, not of the result
            try:
                result = function(*arguments, **keywords)
            finally:
                code.refuse_changed()
                for known in (file for argument in key.ingredients["inputs"] for file in argument.get("files", ())):
                    if describe_file(self.job.session.files, known["name"], self.store.index) != known:
                        problem = "still being written: its content changed while it was read"
                        hint = "wait until it is complete, or copy it here first, and run again"
                        changed = SourceError(known["name"], problem, hint=hint)
                        changed.is_of_run = True  # the same file may be whole the next time
                        raise changed
        expected = str if task.stage.output == "page" else xr.Dataset
        if not isinstance(result, expected):
            name = f"{task.id.experiment}: {task.id.stage}"
            raise StageError(f"{name}: must return a {expected.__name__}, returned {type(result).__name__}")
        found = Counter(
            (warning.category.__name__, self._relative(str(warning.message)))
            for warning in raised
            if not issubclass(warning.category, _FOR_PROGRAMMERS)
        )
        return result, tuple(Caught(*entry, count) for entry, count in found.items())

    def _value(self, task: Task, slot: TaskId | str) -> Any:
        """Return the value of a slot for the function of a task; None for a result that is not there."""
        if isinstance(slot, str):
            return self.job.session.files / slot
        value, result = self.plan.keys[slot].value, self.passed.get(slot)
        if result is None and slot not in self.failures and value is not None:
            result = self.store.read(value)
            if task.stage.output == "dataset" and not isinstance(result, str):
                for attribute in _OURS:
                    result.attrs.pop(attribute, None)
        return result

    def _context(self, task: Task, key: Key) -> Context:
        """Return the context of a page: the run behind it."""
        keys, behind = self.plan.keys, ancestors(self.plan.tasks, task.id)
        of = {name: (name.seen_from(task.id), name.recording) for name in behind}
        values = {name: keys[name].value for name in behind if name not in self.failures}
        found = {name: self.store.record(value) for name, value in values.items() if value is not None}
        records = {name: record for name, record in found.items() if record is not None}
        failed = {name: self.failures[name] for name in behind if name in self.failures}
        return Context(
            **key.ingredients["session"],
            kind=key.ingredients["kind"],
            ledger=summarise((n.experiment, n.stage, record.work) for n, record in records.items()),
            warnings=tuple(
                Warned(*of[n], w.category, w.text, w.count) for n, record in records.items() for w in record.warnings
            ),
            failures=tuple(Failed(*of[n], one.message, one.is_of_run, one.reason) for n, one in failed.items()),
            provenance=provenance.of_task(self.job.program, self.plan.tasks, keys, task.id),
            kept=tuple(Kept(*of[n], code_changed(keys[n].kept)) for n in behind if keys[n].kept),
        )


def _import(task: Task) -> Callable[..., Any]:
    """Return the function of a task."""
    module, _, name = task.stage.function.partition(":")
    try:
        function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, SyntaxError) as error:
        text = f"{task.id.experiment}: {task.id.stage}: {task.stage.function} cannot be imported: {error}"
        raise StageError(text) from error
    return function

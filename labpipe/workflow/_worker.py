"""One experiment, task by task: read the inputs, call the function, check and store the result."""

import importlib
import platform
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from labpipe import files
from labpipe.errors import MISSING, NO_INPUT, InputError, LabpipeError, SourceError, StageError
from labpipe.plugins import PluginWarning
from labpipe.schema import Schema, check
from labpipe.workflow import code, provenance
from labpipe.workflow.context import DONE, FAILED, SKIPPED, Outcome, counts
from labpipe.workflow.exclusions import EXCLUDE, concerning
from labpipe.workflow.graph import Task, TaskId, lineage
from labpipe.workflow.plan import CACHED, READY, Key, Plan, describe_file, page_name, state_of
from labpipe.workflow.store import Caught, Last, Store, log

_OURS = ("work", "provenance")
"""Attributes that belong to one result and must not travel into the next one made of it."""
_FOR_PROGRAMMERS = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)
"""Warnings that say nothing about the data."""


@dataclass(slots=True)
class Job:
    """The rows of one experiment in a plan, to be brought to their ends: all that a process is given.

    ``run`` marks the events of a run in the log, and ``failures`` are tasks that have failed already, elsewhere or in a
    process that died. ``passed`` holds results that are handed on and not kept.
    """

    plan: Plan
    schemas: Mapping[str, Schema]
    program: Mapping[str, Any]
    run: str
    failures: dict[TaskId, Outcome]
    ended: list[Outcome] = field(default_factory=list)
    passed: dict[TaskId, Any] = field(default_factory=dict)
    store: Store = field(init=False)

    def work(self) -> list[Outcome]:
        """Compute the results that are missing, under the lock of the experiment; return the end of every task.

        Another process that computes the same experiment is waited for, and its results are used. The beginning and
        the end of a task are written into the log, from which the run learns of them; ends are returned too, for a
        machine that sees the log too late.

        Raises InputError: the session is not there; StorageError: the log cannot be written.
        """
        session, rows, experiment = self.plan.session, self.plan.rows, self.plan.rows[0].experiment
        if not session.files.is_dir():
            raise InputError(
                f"{platform.node()} sees no folder {session.files}; "
                "a session must lie under the same path on every machine"
            )
        store = self.store = Store(session.folder)
        try:
            with store.experiment(experiment):
                ready = {row.task: self.plan.keys[row.task].last for row in rows if row.state in READY}
                store.note_latest(experiment, ready)
                for row in rows:
                    last = ready.get(row.task)
                    self.end(Outcome(*row.task, row.state, last.key) if last else self._outcome(row.task))
                store.index.save()
        except LabpipeError as error:  # outside a task, as when the lock or the list of last keys cannot be written
            kind = type(error).__name__
            for row in rows[len(self.ended) :]:
                self.end(Outcome(*row.task, FAILED, None, str(error), error.exit_code, kind, is_of_run=error.is_of_run))
        return self.ended

    def end(self, outcome: Outcome) -> None:
        """Write the end of a task into the log."""
        if outcome.state in (FAILED, SKIPPED):
            self.failures[outcome.task] = outcome
        log(self.plan.session, "ended", run=self.run, **asdict(outcome))
        self.ended.append(outcome)

    def _outcome(self, name: TaskId) -> Outcome:
        """Compute one task, unless it has failed already, or has a result by now, or an input is missing."""
        if name in self.failures:
            return self.failures[name]
        task, key = self.plan.tasks[name], self.plan.keys[name]
        state = state_of(self.plan.session, self.store, task, key)
        if state == "stored":
            self.store.note_latest(name.experiment, {name: key.last})
            return Outcome(*name, CACHED, key.value)
        failed = [before for before in task.before if before in self.failures]
        missing = [before for before in failed if before in task.required or self.failures[before].is_of_run]
        if missing and not task.stage.context:
            is_of_run = any(self.failures[before].is_of_run for before in missing)
            text = f"{missing[0]} gave no result"
            return Outcome(*name, SKIPPED, message=text, is_of_run=is_of_run, reason=NO_INPUT)
        log(self.plan.session, "started", run=self.run, **name._asdict())
        begun = time.perf_counter()
        try:
            made = self._made(task, key, state)
        except (Exception, SystemExit) as error:
            # A stage is foreign code to the runner: whatever it raises ends this task alone.
            # Unless it is one of ours, the mistake is the step's, not a record's.
            kind = type(error).__name__
            ours = error if isinstance(error, LabpipeError) else StageError(f"unexpected {kind}: {error}")
            return Outcome(
                *name,
                FAILED,
                message=self._relative(str(ours)),
                exit_code=ours.exit_code,
                error=kind,
                details="".join(traceback.format_exception(error)),
                seconds=time.perf_counter() - begun,
                is_of_run=ours.is_of_run,
                reason=ours.reason,
            )
        return Outcome(*name, DONE, made, seconds=time.perf_counter() - begun)

    def _relative(self, text: str) -> str:
        """Write paths relative to the session, so that a moved folder gives the same text."""
        return text.replace(f"{self.plan.session.files}/", "").replace(f"{self.plan.session.root}/", "")

    def _made(self, task: Task, key: Key, state: str) -> str | None:
        """Return the key of a result, made or found now; None where it rests on failures and is not kept."""
        stage, store = task.stage, self.store
        is_page, page = stage.output == "page", self.plan.session.folder / page_name(task.id.experiment)
        if key.problem:
            raise InputError(key.problem).because(MISSING if key.problem.startswith(MISSING) else "")
        if state == "damaged":
            store.quarantine(key.value or "")
        elif state == "unpublished":
            files.write_text(page, str(store.read(key.value or "")))
            store.note_latest(task.id.experiment, {task.id: key.last})
            return key.value
        last = store.latest(task.id.experiment).get(task.id)
        known = store.record(last.key) if last else None
        # half as much again as last time
        files.require_space(store.root, max(known.size if known else 0, 1 << 20) * 3 // 2)
        result, caught = self._call(task, key)
        if is_page:
            files.write_text(page, result)
        is_passed_on = self._rests_on_failures(task.id) or key.value is None
        if is_passed_on and (is_page or stage.context):  # made again in every run
            self.passed[task.id] = result
            return None
        work = {}
        if not is_page:
            work = counts(result.attrs.get("work"))
            about = provenance.of_task(self.program, self.plan, task.id)
            attributes = {"provenance": files.canonical(about)} | ({"work": files.canonical(work)} if work else {})
            schema = self.schemas[stage.schema] if stage.schema else Schema(stage.name)
            result = check(result, schema).assign_attrs(attributes)
        record = store.write(key.ingredients, result, warnings=caught, work=work)
        store.note_latest(task.id.experiment, {task.id: Last(record.key)})
        return record.key

    def _rests_on_failures(self, name: TaskId) -> bool:
        """Whether a task, or one behind it, has failed."""
        return any(behind in self.failures for behind in lineage(self.plan.tasks, name))

    # --- one call ---

    def _call(self, task: Task, key: Key) -> tuple[Any, tuple[Caught, ...]]:
        """Call the function, and refuse its result where a file has changed before it returned or failed."""
        import xarray as xr

        function = _import(task)
        arguments = [argument.arranged(lambda slot: self._value(task, slot)) for argument in task.arguments]
        settings = self.plan.session.experiments[task.id.experiment].settings
        is_narrow = EXCLUDE in task.stage.parameters
        keywords: dict[str, Any] = {"settings": concerning(settings, task.files) if is_narrow else settings}
        if task.stage.context:
            failed = [self.failures[name] for name in lineage(self.plan.tasks, task.id) if name in self.failures]
            about = provenance.of_task(self.program, self.plan, task.id)
            keywords["context"] = provenance.context_of(self.plan, self.store, task.id, failed, about)
        if task.stage.shortcuts:
            keywords["full"] = key.ingredients["full"]
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", PluginWarning)  # of the installation, not of the result
            try:
                result = function(*arguments, **keywords)
            finally:
                code.refuse_changed(task.stage.function, key.ingredients["code"])
                for known in key.files:
                    if describe_file(self.plan.session.files, known["name"], self.store.index) != known:
                        problem = "still being written: its content has changed since the run began"
                        hint = "wait until it is complete, or copy it here first, and run again"
                        changed = SourceError(known["name"], problem, hint=hint)
                        changed.is_of_run = True  # the same file may be whole the next time
                        raise changed
        expected = str if task.stage.output == "page" else xr.Dataset
        if not isinstance(result, expected):
            text = f"must return a {expected.__name__}, returned {type(result).__name__}"
            raise StageError(f"{task.id.experiment}: {task.id.stage}: {text}")
        found = Counter(
            (warning.category.__name__, self._relative(str(warning.message)))
            for warning in raised
            if not issubclass(warning.category, _FOR_PROGRAMMERS)
        )
        return result, tuple(Caught(*entry, count) for entry, count in found.items())

    def _value(self, task: Task, slot: TaskId | str) -> Any:
        """Return the value of a slot for the function of a task; None for a result that is not there."""
        if isinstance(slot, str):
            return self.plan.session.files / slot
        value, result = self.plan.keys[slot].value, self.passed.get(slot)
        if result is not None or value is None or slot in self.failures:
            return result
        # what rests on failures is not kept
        if not self._rests_on_failures(slot) or self.store.record(value) is not None:
            result = self.store.read(value)
            if task.stage.output == "dataset" and not isinstance(result, str):
                for attribute in _OURS:
                    result.attrs.pop(attribute, None)
        return result


def _import(task: Task) -> Callable[..., Any]:
    """Return the function of a task."""
    module, _, name = task.stage.function.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, SyntaxError) as error:
        text = f"{task.id.experiment}: {task.id.stage}: {task.stage.function} cannot be imported: {error}"
        raise StageError(text) from error

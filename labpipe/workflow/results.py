"""The one reader of results of a session, as of one plan; and the events and the outcome of a run."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import InputError, LabpipeError, StorageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.context import FAILED, Outcome
from labpipe.workflow.graph import Argument, TaskId
from labpipe.workflow.plan import READY, Plan, wanted_tasks
from labpipe.workflow.session import Experiment, Session
from labpipe.workflow.store import Store

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, slots=True)
class Results:
    """Results of a session that are up to date by a plan made after them, read from its store."""

    plan: Plan

    @property
    def experiments(self) -> Mapping[str, Experiment]:
        """The session's experiments by name."""
        return self.plan.session.experiments

    def up_to_date(self, task: TaskId) -> "xr.Dataset | None":
        """Return the result of a task; None when there is none, or it is damaged, or a page."""
        try:
            return self.result(*task)
        except LabpipeError:  # the next run makes it again
            return None

    def first(self, experiment: str, stage: str) -> "xr.Dataset | None":
        """Return the result of a stage of an experiment, for its first recording; None where it is not there."""
        row = next((row for row in self.plan.rows if (row.experiment, row.stage) == (experiment, stage)), None)
        return None if row is None else self.up_to_date(row.task)

    def result(self, experiment: str, stage: str, recording: str | None = None) -> "xr.Dataset":
        """Return one result, of a stage that runs per recording that of one file.

        Raises UsageError: the experiment or stage is unknown; InputError: the result is missing or out of date;
        StoreError: it is damaged.
        """
        task = TaskId(experiment, stage, recording)
        if task not in self.plan.tasks:
            wanted_tasks(self.plan.session, self.plan.tasks, [f"{experiment}/{stage}"], [experiment])
            known = ", ".join(f'"{n.recording}"' for n in self.plan.tasks if n[:2] == task[:2] and n.recording)
            text = f'is one result of all recordings; ask for it without "{recording}"'
            text = f"has a result for each recording; name one of them: {known}" if known else text
            raise InputError(f"{experiment}/{stage} {text}")
        row = next(row for row in self.plan.rows if row.task == task)
        key = self.plan.keys[task].value
        if row.state not in READY or key is None:
            raise InputError(f"{task} has no up-to-date result ({row.reason}); run labpipe process first")
        if self.plan.tasks[task].stage.output == "page":
            raise InputError(f"{task} is a page; open it in a browser")
        return Store(self.plan.session.folder).read(key)  # type: ignore[return-value]

    def values(self, arguments: Iterable[Argument], *, may_lack: bool = False) -> list[Any]:
        """Return the arguments of a function: Datasets and paths, lists of them, or None, perhaps for missing ones."""
        folder = self.plan.session.files
        result: Callable[[TaskId], Any] = self.up_to_date if may_lack else lambda task: self.result(*task)
        return [a.arranged(lambda slot: folder / slot if isinstance(slot, str) else result(slot)) for a in arguments]


@dataclass(frozen=True, slots=True)
class Event:
    """An event for the ``progress`` of a run, after which ``done`` of ``total`` tasks of its session have ended.

    ``kind`` is ``planned`` (once, with the number of tasks to run and the time expected, and the first task),
    ``started``, or how the task ended (``done``, ``cached``, ``kept``, ``failed``, ``skipped``).
    """

    kind: str
    task: TaskId
    done: int
    total: int
    message: str
    session: Path


@dataclass(frozen=True, slots=True, repr=False)
class RunResult(ShownAsTable):
    """How a run ended.

    ``reports`` are the pages by experiment, where there is one. ``plan`` is that of the run where it is one of the
    whole session, nothing was left to do and no shortcut refused, so that it still holds; otherwise None.
    """

    session: Session
    outcomes: tuple[Outcome, ...]
    reports: Mapping[str, Path]
    plan: Plan | None = None

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """Tasks that failed; those skipped because of them are not among them."""
        return tuple(outcome for outcome in self.outcomes if outcome.state == FAILED)

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: that of all failures if they have one and nothing else was done, or 1.

        0 when nothing failed; 5 when something could not be written.
        """
        codes = {outcome.exit_code for outcome in self.failures}
        if not codes or StorageError.exit_code in codes:
            return StorageError.exit_code if codes else 0
        has_all_failed = {o.experiment for o in self.outcomes} == {o.experiment for o in self.failures}
        return codes.pop() if has_all_failed and len(codes) == 1 else 1

    @property
    def summary(self) -> str:
        """Say in one line how many steps ended how."""
        count = Counter(o.state for o in self.outcomes)
        return ", ".join(f"{n} {s}" for s, n in sorted(count.items())) or "nothing to do"

    def _shown(self) -> Shown:
        rows = [("failed", str(o.task), o.message) for o in self.failures]
        rows += [("report", name, str(path)) for name, path in self.reports.items()]
        return Shown(f"{self.session.title}: {self.summary}", ("outcome", "of", "message"), rows)

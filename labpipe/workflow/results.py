"""The one reader of results of a session, as of one plan."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import InputError, LabpipeError
from labpipe.workflow.graph import Argument, Stages, TaskId
from labpipe.workflow.plan import READY, Plan, Row, plan, wanted_tasks
from labpipe.workflow.session import Experiment, Session
from labpipe.workflow.store import Store

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, slots=True)
class Results:
    """Results of a session that are up to date by a plan made after them, read from its store."""

    plan: Plan

    @property
    def folder(self) -> Path:
        """The session's folder."""
        return self.plan.session.root

    @property
    def experiments(self) -> Mapping[str, Experiment]:
        """The session's experiments by name."""
        return self.plan.session.experiments

    def up_to_date(self, row: Row) -> "xr.Dataset | None":
        """Return the result of a row; None when there is none, or it is damaged, or a page."""
        try:
            return self.result(*row.task)
        except LabpipeError:  # the next run makes it again
            return None

    def first(self, experiment: str, stage: str) -> "xr.Dataset | None":
        """Return the result of a stage of an experiment, for its first recording; None where it is not there."""
        row = next((row for row in self.plan.rows if (row.experiment, row.stage) == (experiment, stage)), None)
        return None if row is None else self.up_to_date(row)

    def result(self, experiment: str, stage: str, recording: str | None = None) -> "xr.Dataset":
        """Return one result, of a stage that runs per recording that of one file.

        Raises UsageError: the experiment or stage is unknown; InputError: the result is missing or out of date;
        StoreError: it is damaged.
        """
        task = TaskId(experiment, stage, recording)
        if task not in self.plan.tasks:
            wanted_tasks(self.plan.session, self.plan.tasks, [f"{experiment}/{stage}"], [experiment])
            known = ", ".join(f'"{n.recording}"' for n in self.plan.tasks if n[:2] == task[:2] and n.recording)
            if not known:
                text = f'is one result of all recordings; ask for it without "{recording}"'
            elif recording is None:
                text = f"has a result for each recording; name one of them: {known}"
            else:
                text = f'has no recording "{recording}"; there are {known}'
            raise InputError(f"{experiment}/{stage} {text}")
        row = next(row for row in self.plan.rows if row.task == task)
        key = self.plan.keys[task].value
        if row.state not in READY or key is None:
            raise InputError(f"{task} has no up-to-date result ({row.reason}); run labpipe process first")
        store, is_page = Store(self.plan.session.folder), self.plan.tasks[task].stage.output == "page"
        if is_page or isinstance(found := store.read(key), str):
            raise InputError(f"{task} is a page; open it in a browser")
        return found

    def values(self, arguments: Sequence[Argument]) -> list[Any]:
        """Return the arguments of a function: Datasets and paths, lists of them, or None."""

        def value(slot: TaskId | str) -> Any:
            return self.plan.session.files / slot if isinstance(slot, str) else self.result(*slot)

        return [argument.arranged(value) for argument in arguments]


def open_result(
    session: Session, stages: Stages, experiment: str, stage: str, recording: str | None = None
) -> "xr.Dataset":
    """Return an up-to-date stored result without running anything; errors are those of :meth:`Results.result`."""
    made = plan(session, stages, [f"{experiment}/{stage}"], [experiment], keep=None)
    return Results(made).result(experiment, stage, recording)

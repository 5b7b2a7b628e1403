"""Events of a run, and its outcome."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from labpipe.errors import StorageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow._worker import FAILED, Outcome
from labpipe.workflow.graph import TaskId
from labpipe.workflow.plan import Plan
from labpipe.workflow.session import Session


@dataclass(frozen=True, slots=True)
class Event:
    """An event for the ``progress`` of a run.

    ``kind`` is ``planned`` (once, with the number of tasks to run and the time expected, and the first
    task), ``started``, or how the task ended (``done``, ``cached``, ``kept``, ``failed``,
    ``skipped``); ``done`` of ``total`` tasks of its session have ended.
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
        """Exit code of the command line.

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

    @property
    def summary(self) -> str:
        """Say in one line how many steps ended how."""
        count = Counter(o.state for o in self.outcomes)
        return ", ".join(f"{n} {s}" for s, n in sorted(count.items())) or "nothing to do"

    def _shown(self) -> Shown:
        rows = [("failed", str(o.task), o.message) for o in self.failures]
        rows += [("report", name, str(path)) for name, path in self.reports.items()]
        return Shown(f"{self.session.title}: {self.summary}", ("outcome", "of", "message"), rows)

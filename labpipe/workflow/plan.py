"""Plan of a run: its tasks with the reason of each; nothing numerical is imported for it."""

from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, field

from labpipe.errors import SourceError, UsageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow._keys import Key, changes, make_keys
from labpipe.workflow.context import code_changed
from labpipe.workflow.fields import suggest
from labpipe.workflow.session import Session
from labpipe.workflow.store import Last, Store, last_seconds
from labpipe.workflow.tasks import Stages, Task, TaskId, ancestors, spell_out, stage_name

CACHED, KEPT, WILL_RUN, WAITS = "cached", "kept", "will run", "waits"
READY = (CACHED, KEPT)
"""States of results that can be used."""
_COLUMNS = ("experiment", "stage", "recording", "state", "reason")
_MOST_REASONS = 3
"""Reasons shown in one row; the rest is counted."""


@dataclass(frozen=True, slots=True)
class Row:
    """One task of a plan.

    ``state`` is ``cached`` (nothing to do), ``kept`` (of earlier code, and taken as it is),
    ``will run``, or ``waits`` (it will run after another).
    """

    experiment: str
    stage: str
    recording: str | None
    state: str
    reason: str
    summary: str

    @property
    def task(self) -> TaskId:
        """The task of the row."""
        return TaskId(self.experiment, self.stage, self.recording)


@dataclass(frozen=True, slots=True, repr=False)
class Plan(ShownAsTable):
    """The tasks behind the wanted ones, inputs first, with the state of each and why."""

    session: Session
    rows: tuple[Row, ...]
    tasks: Mapping[TaskId, Task] = field(repr=False)
    keys: Mapping[TaskId, Key] = field(repr=False)

    @property
    def to_run(self) -> tuple[Row, ...]:
        """Rows without a result."""
        return tuple(row for row in self.rows if row.state not in READY)

    def last(self, task: TaskId) -> Last:
        """Return the last result, to be remembered, of a task that has one."""
        key = self.keys[task]
        return Last(key.value or "", key.taken_for)

    def kept(self, *wanted: TaskId) -> dict[TaskId, tuple[str, ...]]:
        """Results of earlier code behind some tasks, with the changed code since."""
        behind = [*ancestors(self.tasks, *wanted), *wanted]
        return {name: self.keys[name].kept for name in behind if self.keys[name].kept}

    @property
    def estimate(self) -> str:
        """How long the rest may take, by the last run of every step; empty when nothing is known.

        Steps that run side by side count one after the other.
        """
        known = last_seconds(self.session) if self.to_run else {}
        found = [known[row.task] for row in self.to_run if row.task in known]
        new = len(self.to_run) - len(found)
        if not found:
            return ""
        unknown = f", without {new} that never ran" if new else ""
        seconds = sum(found)
        if seconds < 100:
            text = f"{max(seconds, 1.0):.0f} s"
        else:
            text = f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
        return f"about {text} (last time{unknown})"

    @property
    def summary(self) -> str:
        """Say in one line how much would run, and how long that may take."""
        waiting = len(self.session.waiting)
        parts = [f"{len(self.to_run)} of {len(self.rows)} steps would run", self.estimate]
        parts += [f"{waiting} experiment{'s wait' if waiting > 1 else ' waits'}"] * bool(waiting)
        return ", ".join(part for part in parts if part)

    def _shown(self) -> Shown:
        rows = [[getattr(row, name) or "" for name in _COLUMNS] for row in self.rows]
        return Shown(f"{self.session.title}: {self.summary}", _COLUMNS, rows)


def plan(
    session: Session,
    stages: Stages,
    targets: Iterable[str] | None = None,
    only: Iterable[str] | None = None,
    *,
    full: bool = False,
    keep: bool | None = False,
) -> Plan:
    """Plan a run.

    Parameters
    ----------
    session : Session
        See :func:`labpipe.workflow.session.load`.
    stages : mapping
        The stages of every kind of experiment.
    targets : iterable of str, optional
        Stages whose results are wanted, ``velocity`` or ``acrylic/velocity``; default all.
    only : iterable of str, optional
        Experiments whose results are wanted; default all. Results of others that they need are made too.
    full : bool
        Plan for a run without shortcuts.
    keep : bool or None
        Take results of earlier code as they are; with None, those that an earlier run took.

    Returns
    -------
    Plan
        One row per task.

    Raises
    ------
    UsageError
        A target or an experiment is unknown.
    ConfigError, InputError
        The experiments, or the stages, do not fit together.
    """
    store = Store(session.folder)
    tasks = spell_out(session, stages)
    wanted = wanted_tasks(session, tasks, targets, only)
    made = make_plan(session, tasks, wanted, store, full=full, keep=keep)
    if store.root.is_dir():
        store.index.save()
    return made


def make_plan(
    session: Session,
    tasks: Mapping[TaskId, Task],
    wanted: Set[TaskId],
    store: Store,
    *,
    full: bool = False,
    keep: bool | None = False,
) -> Plan:
    """Make the plan for some tasks out of all; see :func:`plan`."""
    behind = wanted | set(ancestors(tasks, *wanted))
    tasks = {name: task for name, task in tasks.items() if name in behind}
    keys = make_keys(session, tasks, store, full=full, keep=keep)
    states = {name: _state(session, store, tasks[name], keys[name]) for name in tasks}
    needed: set[TaskId] = set()
    waiting = [name for name in wanted if states[name] != "stored"]
    while waiting:
        name = waiting.pop()
        needed.add(name)
        if states[name] == "unpublished":
            continue
        # What takes the context reports on everything behind it, so all of that must be there.
        inputs = ancestors(tasks, name) if tasks[name].stage.context else tasks[name].before
        waiting += [one for one in inputs if states[one] != "stored" and one not in needed]
    rows = []
    for name, task in tasks.items():
        if name in needed:
            rows.append(_row_to_run(store, task, keys[name], states[name], needed))
        elif states[name] == "stored":
            changed = keys[name].kept
            rows.append(Row(*name, KEPT if changed else CACHED, code_changed(changed), task.stage.summary))
    return Plan(session, tuple(rows), tasks, keys)


def wanted_tasks(
    session: Session, tasks: Mapping[TaskId, Task], targets: Iterable[str] | None, only: Iterable[str] | None
) -> frozenset[TaskId]:
    """Pick the tasks that targets and experiments name; one name may stand alone.

    Raises
    ------
    UsageError
        A name is unknown.
    """
    experiments, asked = (
        None if given is None else {given} if isinstance(given, str) else set(given) for given in (only, targets)
    )
    experiments = set(session.experiments) if experiments is None else experiments
    for name in sorted(experiments - set(session.experiments)):
        if name in session.waiting:
            message = f'"{name}" waits for these lines of its settings:\n  ' + "\n  ".join(session.waiting[name])
            raise UsageError(message)
        raise UsageError(f'there is no experiment "{name}"{suggest(name, session.experiments)}')
    chosen = frozenset(name for name in tasks if name.experiment in experiments)
    if asked is None:
        return chosen
    names = {n.stage for n in tasks} | {f"{n.experiment}/{n.stage}" for n in tasks}
    for name in sorted(asked - names):
        raise UsageError(f'there is no stage "{name}"{suggest(name, names)}')
    return frozenset(n for n in chosen if {n.stage, f"{n.experiment}/{n.stage}"} & asked)


def page_name(experiment: str) -> str:
    """Name of an experiment's report inside ``SESSION/labpipe``."""
    return f"reports/{experiment}.html"


def _state(session: Session, store: Store, task: Task, key: Key) -> str:
    """Return ``stored``, ``absent``, ``damaged``, ``unreadable`` or, for a page, ``unpublished``."""
    if key.value is None:
        return "unreadable" if key.problem else "absent"
    state = store.state(key.value)
    if state != "stored" or task.stage.output != "page":
        return state
    record = store.record(key.value)
    try:
        published = store.index.digest(session.folder / page_name(task.id.experiment))
    except SourceError:
        return "unpublished"
    if record is not None and record.digest == published:
        return "stored"
    amended = store.amended().get(task.id.experiment, {})
    return "stored" if (amended.get("key"), amended.get("digest")) == (key.value, published) else "unpublished"


def _row_to_run(store: Store, task: Task, key: Key, state: str, needed: Set[TaskId]) -> Row:
    """Say why a task will run."""
    waiting = [] if state == "unpublished" else [before for before in task.before if before in needed]
    if state == "unpublished":
        reasons = [f"{page_name(task.id.experiment)} is missing or was changed"]
    elif state == "unreadable":
        reasons = [key.problem]
    elif state == "damaged":
        reasons = ["result damaged"]
    elif (last := store.last(task.id)) is None:
        reasons = ["never run"]
    else:
        record = store.record(last.key)
        reasons = changes(record.ingredients, key.ingredients, is_waiting=bool(waiting)) if record else []
    reasons += sorted({f"upstream {stage_name(task, before)} will run" for before in waiting})
    text = "; ".join(reasons[:_MOST_REASONS] or ["result is gone"])
    if len(reasons) > _MOST_REASONS:
        text += f"; and {len(reasons) - _MOST_REASONS} more"
    return Row(*task.id, WAITS if waiting else WILL_RUN, text, task.stage.summary)

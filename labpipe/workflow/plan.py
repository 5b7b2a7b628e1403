"""What a run would do, and why, row by row; nothing numerical is imported for it."""

from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, field
from typing import Any

from labpipe import files
from labpipe.errors import SourceError, UsageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.units import Quantity
from labpipe.workflow import code
from labpipe.workflow._keys import Key, code_changes, make_keys
from labpipe.workflow.context import code_changed
from labpipe.workflow.fields import show, suggest
from labpipe.workflow.session import Session
from labpipe.workflow.store import Last, Store
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
        """Return what is to be remembered as the last result of a task that has one."""
        key = self.keys[task]
        return Last(key.value or "", key.taken_for)

    def kept(self, *wanted: TaskId) -> dict[TaskId, tuple[str, ...]]:
        """Results of earlier code behind some tasks, with what has changed in the code since."""
        behind = [*ancestors(self.tasks, *wanted), *wanted]
        return {name: self.keys[name].kept for name in behind if self.keys[name].kept}

    @property
    def estimate(self) -> str:
        """How long the rest may take, by the last run of every step; empty when nothing is known.

        Steps that run side by side count one after the other.
        """
        from labpipe.workflow._log import last_seconds

        known = last_seconds(self.session) if self.to_run else {}
        found = [known[row.task] for row in self.to_run if row.task in known]
        new = len(self.to_run) - len(found)
        if not found:
            return ""
        unknown = f", without {new} that never ran" if new else ""
        return f"about {duration(sum(found))} (last time{unknown})"

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
    """Say what a run would do.

    Parameters
    ----------
    session : Session
        See :func:`labpipe.workflow.session.load`.
    stages : mapping
        The stages of every kind of experiment.
    targets : iterable of str, optional
        Stages whose results are wanted, ``velocity`` or ``acrylic/velocity``; default all.
    only : iterable of str, optional
        Experiments whose results are wanted; default all. What they need of others is done too.
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
        code.save()
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
    needed = _needed(tasks, wanted, states)
    rows = tuple(
        _row(store, task, keys, states, needed)
        for name, task in tasks.items()
        if name in needed or states[name] == "stored"
    )
    return Plan(session, rows, tasks, keys)


def wanted_tasks(
    session: Session, tasks: Mapping[TaskId, Task], targets: Iterable[str] | None, only: Iterable[str] | None
) -> frozenset[TaskId]:
    """Pick the tasks that targets and experiments name; one name may stand alone.

    Raises
    ------
    UsageError
        A name is unknown.
    """
    experiments = set(session.experiments) if only is None else _names(only)
    for name in sorted(experiments - set(session.experiments)):
        if name in session.waiting:
            message = f'"{name}" waits for these lines of its settings:\n  ' + "\n  ".join(session.waiting[name])
            raise UsageError(message)
        raise UsageError(f'there is no experiment "{name}"{suggest(name, session.experiments)}')
    chosen = frozenset(name for name in tasks if name.experiment in experiments)
    if targets is None:
        return chosen
    names = {n.stage for n in tasks} | {f"{n.experiment}/{n.stage}" for n in tasks}
    asked = _names(targets)
    for name in sorted(asked - names):
        raise UsageError(f'there is no stage "{name}"{suggest(name, names)}')
    return frozenset(n for n in chosen if {n.stage, f"{n.experiment}/{n.stage}"} & asked)


def _names(given: Iterable[str]) -> set[str]:
    """Take one name for a list of one, not for its letters."""
    return {given} if isinstance(given, str) else set(given)


def page_name(experiment: str) -> str:
    """Name of an experiment's report inside ``SESSION/labpipe``."""
    return f"reports/{experiment}.html"


def _state(session: Session, store: Store, task: Task, key: Key) -> str:
    """Tell ``stored``, ``absent``, ``damaged``, ``unreadable`` or, for a page, ``unpublished``."""
    if key.value is None:
        return "unreadable" if key.problem else "absent"
    state = store.state(key.value)
    if state == "stored" and task.stage.output == "page":
        record = store.record(key.value)
        try:
            published = store.index.digest(session.folder / page_name(task.id.experiment))
        except SourceError:
            return "unpublished"
        if record is not None and record.digest == published:
            return "stored"
        amended = store.amended().get(task.id.experiment, {})
        return "stored" if (amended.get("key"), amended.get("digest")) == (key.value, published) else "unpublished"
    return state


def _needed(tasks: Mapping[TaskId, Task], wanted: Set[TaskId], states: Mapping[TaskId, str]) -> set[TaskId]:
    """Tasks that must run: the wanted ones without a result, and what those need."""
    needed: set[TaskId] = set()
    waiting = [name for name in wanted if states[name] != "stored"]
    while waiting:
        name = waiting.pop()
        needed.add(name)
        if states[name] == "unpublished":
            continue
        # What takes the context reports on everything behind it, so all of that must be there.
        behind = ancestors(tasks, name) if tasks[name].stage.context else tasks[name].before
        waiting += [b for b in behind if states[b] != "stored" and b not in needed]
    return needed


# --- reasons -----------------------------------------------------------------------------------


def _row(
    store: Store, task: Task, keys: Mapping[TaskId, Key], states: Mapping[TaskId, str], needed: set[TaskId]
) -> Row:
    if task.id not in needed:
        changed = keys[task.id].kept
        state = KEPT if changed else CACHED
        return Row(*task.id, state, code_changed(changed), task.stage.summary)
    state = states[task.id]
    if state == "unpublished":
        reason = f"{page_name(task.id.experiment)} is missing or was changed"
        return Row(*task.id, WILL_RUN, reason, task.stage.summary)
    waiting = [before for before in task.before if before in needed]
    reasons = []
    if state == "unreadable":
        reasons = [keys[task.id].problem]
    elif state == "damaged":
        reasons = ["result damaged"]
    else:
        reasons = _changes(store, task, keys[task.id], is_waiting=bool(waiting))
    upstream = sorted({f"upstream {stage_name(task, b)} will run" for b in waiting})
    reasons = [*reasons, *upstream] or ["result is gone"]
    text = "; ".join(reasons[:_MOST_REASONS])
    if len(reasons) > _MOST_REASONS:
        text += f"; and {len(reasons) - _MOST_REASONS} more"
    return Row(*task.id, WAITS if waiting else WILL_RUN, text, task.stage.summary)


def _changes(store: Store, task: Task, key: Key, *, is_waiting: bool) -> list[str]:
    """Say what differs from the last result of the same task.

    For a task that waits, the task it waits for says what changed upstream.
    """
    last = store.last(task.id)
    if last is None:
        return ["never run"]
    record = store.record(last.key)
    if record is None:
        return []
    old, new = record.ingredients, key.ingredients
    changes = []
    if changed := code_changes(old, new):
        changes.append(code_changed(changed))
    changes += _parameter_changes(old["parameters"], new["parameters"])
    changes += _file_changes(_files(old), _files(new))
    if old.get("full") != new.get("full"):
        changes.append(f"full {_shown(old.get('full'))} -> {_shown(new.get('full'))}")
    old_session, new_session = old.get("session", {}), new.get("session", {})
    changes += [f"session {k} changed" for k in new_session if old_session.get(k) != new_session[k]]
    if old["kind"] != new["kind"]:
        changes.append("stored for another kind")
    if old.get("kept") != new.get("kept"):
        changes.append("other results of earlier code are kept")
    if not changes and [i["input"] for i in old["inputs"]] != [i["input"] for i in new["inputs"]]:
        changes.append("the stage takes other inputs")
    if not changes and not is_waiting:
        changes += [
            f"upstream {after['input']} changed"
            for before, after in zip(old["inputs"], new["inputs"], strict=True)
            if before.get("keys") != after.get("keys")
        ]
    return changes


def duration(seconds: float) -> str:
    """Write a time for people.

    Examples
    --------
    >>> duration(0.4), duration(42.0), duration(200.0), duration(9000.0)
    ('1 s', '42 s', '3 min', '2.5 h')
    """
    if seconds < 100:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def _parameter_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    names = [*new, *(name for name in old if name not in new)]
    # What is stored has lists where settings have tuples; compared is what would be stored.
    return [
        f"parameter {name} changed {_shown(old.get(name))} -> {_shown(new.get(name))}"
        for name in names
        if files.canonical(old.get(name)) != files.canonical(new.get(name))
    ]


def _files(ingredients: Mapping[str, Any]) -> dict[str, str]:
    return {f["name"]: f["sha256"] for i in ingredients["inputs"] for f in i.get("files", ())}


def _file_changes(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    changes = [f"input {n} changed" for n in new if n in old and old[n] != new[n]]
    changes += [f"input {name} added" for name in new if name not in old]
    return changes + [f"input {name} removed" for name in old if name not in new]


def _shown(value: Any) -> str:
    """Write a parameter for people; a quantity is stored as value, uncertainty, SI unit."""
    is_quantity = isinstance(value, list) and len(value) == 3 and isinstance(value[2], str)
    if is_quantity and all(isinstance(v, int | float) for v in value[:2]):
        return show(Quantity(*value))
    if value is None:
        return "none"
    text = value if isinstance(value, str) else files.canonical(value)
    return text if len(text) <= 60 else text[:60] + "…"

"""Plan of a run: its tasks with the reason of each; nothing numerical is imported for it.

A result is found by its key: the code of the packages that its stage belongs to, the parameters, the contents of the
files and the keys of the other inputs. Equal key, equal result.
"""

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from labpipe import files
from labpipe.errors import MISSING, InputError, SourceError, UsageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.units import Quantity
from labpipe.workflow.code import behind
from labpipe.workflow.exclusions import EXCLUDE, files_of
from labpipe.workflow.fields import suggest
from labpipe.workflow.graph import Stage, Stages, Task, TaskId, ends, lineage, spell_out
from labpipe.workflow.session import FILE_NAME, Session
from labpipe.workflow.store import Last, Store, key_of, last_seconds

CACHED, KEPT, WILL_RUN, WAITS = "cached", "kept", "will run", "waits"
READY = (CACHED, KEPT)
"""States of results that can be used."""
_COLUMNS = ("experiment", "stage", "recording", "state", "reason")
_MOST_REASONS = 3
"""Reasons, and packages, shown in one row; the rest is counted."""


@dataclass(frozen=True, slots=True)
class Key:
    """A task's key with its ingredients; ``value`` is None when a file cannot be read.

    Where an earlier result is ``kept`` this names the code that has changed since; the key is then that of the earlier
    one, ``taken_for`` the present one.
    """

    value: str | None
    ingredients: Mapping[str, Any]
    problem: str = ""
    kept: tuple[str, ...] = ()
    taken_for: str | None = None

    @property
    def last(self) -> Last:
        """The last result, to be remembered, of a task that has one."""
        return Last(self.value or "", self.taken_for)

    @property
    def files(self) -> list[dict[str, Any]]:
        """Files that the result depends on, by :func:`describe_file`."""
        return [file for one in self.ingredients["inputs"] for file in one.get("files", ())]


@dataclass(frozen=True, slots=True)
class Row:
    """One task of a plan.

    ``state`` is ``cached`` (nothing to do), ``kept`` (of earlier code), ``will run``, or ``waits`` (for another).
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

    def of(self, experiment: str) -> "Plan":
        """Return the part of the plan that concerns one experiment: its rows, and all tasks behind them."""
        rows = tuple(row for row in self.rows if row.experiment == experiment)
        names = lineage(self.tasks, *(row.task for row in rows))
        return replace(self, rows=rows, tasks={n: self.tasks[n] for n in names}, keys={n: self.keys[n] for n in names})

    @property
    def estimate(self) -> str:
        """How long the rest may take one step after the other, by the last run of each; empty when nothing is known."""
        known = last_seconds(self.session) if self.to_run else {}
        found = [known[row.task] for row in self.to_run if row.task in known]
        if not found:
            return ""
        new, seconds = len(self.to_run) - len(found), max(sum(found), 1.0)
        text = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
        return f"about {text} (last time{f', without {new} that never ran' if new else ''})"

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
    store: Store | None = None,
) -> Plan:
    """Plan a run of a session, of which ``stages`` has those of every kind.

    ``targets`` are stages whose results are wanted, ``velocity`` or ``acrylic/velocity``, and ``only`` the experiments;
    by default all. Results of others that they need are made too. ``full`` plans without shortcuts.
    ``keep`` takes results of earlier code as they are; None, those that an earlier run took. ``store`` is that of the
    session, where it is open already.

    Raises UsageError: a target or an experiment is unknown; ConfigError, InputError: the experiments, or the stages, do
    not fit together.
    """
    store = store or Store(session.folder)
    tasks = spell_out(session, stages)
    wanted = wanted_tasks(session, tasks, targets, only)
    tasks = {name: tasks[name] for name in lineage(tasks, *wanted)}
    plain = {e.name: msgspec.to_builtins(e.settings) for e in session.experiments.values()}
    keys: dict[TaskId, Key] = {}
    states: dict[TaskId, str] = {}
    latest = cache(store.latest)
    for name, task in tasks.items():
        options: dict[str, Any] = {"full": full} if task.stage.shortcuts else {}
        behind = lineage(tasks, name)[:-1] if task.stage.context else []
        if earlier := {str(other): list(keys[other].kept) for other in behind if keys[other].kept}:
            options["kept"] = earlier
        key = _key(session, task, plain[name.experiment], keys, store, options)
        if keep is not False and task.stage.output == "dataset":
            key = _kept(store, latest(name.experiment).get(name), key, was_taken=keep is None)
        keys[name], states[name] = key, state_of(session, store, task, key)
    asked, needed = set(wanted), set[TaskId]()
    for name in (name for name in reversed(tasks) if states[name] != "stored" and name in asked):
        needed.add(name)
        if states[name] != "unpublished":
            # a stage with the context reports on everything behind it, so all of that must be there
            asked.update(lineage(tasks, name) if tasks[name].stage.context else tasks[name].before)
    rows = []
    for name, task in tasks.items():
        if name in needed:
            last = latest(name.experiment).get(name)
            rows.append(_row_to_run(store, last, task, keys[name], states[name], needed))
        elif states[name] == "stored":
            changed = keys[name].kept
            rows.append(Row(*name, KEPT if changed else CACHED, code_changed(changed), task.stage.summary))
    if store.root.is_dir():
        store.index.save()
    return Plan(session, tuple(rows), tasks, keys)


def code_changed(packages: Sequence[str]) -> str:
    """Say of which packages the code has changed.

    Examples
    --------
    >>> code_changed(["labpipe.units"])
    'code changed: labpipe.units'
    """
    return f"code changed: {_first(packages, ', ')}" if packages else ""


def _first(texts: Sequence[str], separator: str) -> str:
    """Join texts; of many the first, and the number of the others."""
    more = [f"and {len(texts) - _MOST_REASONS} more"] if len(texts) > _MOST_REASONS else []
    return separator.join([*texts[:_MOST_REASONS], *more])


def wanted_tasks(
    session: Session, tasks: Mapping[TaskId, Task], targets: Iterable[str] | None, only: Iterable[str] | None
) -> frozenset[TaskId]:
    """Pick the tasks of named targets and experiments; UsageError: one is unknown; InputError: all named ones wait."""
    experiments = set(session.experiments) if only is None else {only} if isinstance(only, str) else set(only)
    for name in sorted(experiments - session.experiments.keys() - session.waiting.keys()):
        raise UsageError(f'there is no experiment "{name}"{suggest(name, session.experiments)}')
    if experiments and not experiments & session.experiments.keys():
        lines = [f"\n  {line}" for name in sorted(experiments) for line in session.waiting[name]]
        names_of = ", ".join(f'"{name}"' for name in sorted(experiments))
        raise InputError(f"{names_of} wait{'s' * (len(experiments) == 1)} for these lines of settings:{''.join(lines)}")
    chosen = frozenset(name for name in tasks if name.experiment in experiments)
    if targets is None:
        return chosen
    asked = {targets} if isinstance(targets, str) else set(targets)
    names = {name: {name.stage, f"{name.experiment}/{name.stage}"} for name in tasks}
    known = set().union(*names.values())
    for wrong in sorted(asked - known):
        there = ", ".join(sorted({task.stage for task in chosen}))
        raise UsageError(f'there is no stage "{wrong}"{suggest(wrong, known) or f"; there are {there}"}')
    return frozenset(name for name in chosen if asked & names[name])


def page_name(experiment: str) -> str:
    """Name of an experiment's report inside ``SESSION/labpipe``."""
    return f"reports/{experiment}.html"


def _key(
    session: Session, task: Task, settings: Any, keys: Mapping[TaskId, Key], store: Store, options: Mapping[str, Any]
) -> Key:
    """Return the key of a task from all that it depends on; files are read unless the index knows them."""
    stage, problem, experiment = task.stage, "", session.experiments[task.id.experiment]
    inputs: list[dict[str, Any]] = []
    for argument in task.arguments:
        entry: dict[str, Any] = {"input": argument.name}
        if argument.tasks:
            entry["keys"] = [keys[slot].value if isinstance(slot, TaskId) else None for slot in argument.slots]
        try:
            if argument.files:
                entry["files"] = [describe_file(session.files, n, store.index) for n in argument.files]
        except SourceError as error:
            problem = str(error).replace(f"{session.files}/", "")
            lost = next((name for name in argument.files if not (session.files / name).exists()), None)
            line = next((experiment.lines.get(at) for at, name in files_of(experiment.settings) if name == lost), None)
            problem = f"{MISSING}: {lost} ({FILE_NAME}:{line})" if lost else problem
        inputs.append(entry)
    ingredients: dict[str, Any] = {
        **options,
        "kind": experiment.kind,
        "stage": stage.name,
        "function": stage.function,
        "code": behind(stage.function),
        "parameters": parameters(stage, settings, task.files),
        "inputs": inputs,
    }
    if stage.context:
        words = {name: getattr(session, name) for name in ("title", "operator", "notes", "synthetic")}
        of_variant = {name: getattr(experiment, name) for name in ("base", "changed", "overrides")}
        words |= {name: value for name, value in of_variant.items() if value}
        ingredients["session"] = {"experiment": experiment.name} | words
    is_known = not problem and all(keys[before].value is not None for before in task.required)
    return Key(key_of(ingredients) if is_known else None, ingredients, problem)


def describe_file(root: Path, name: str, index: files.HashIndex) -> dict[str, Any]:
    """Name, by which readers are chosen, size and digest of a file or folder of the session."""
    path = root / name
    sha256 = index.digest(path)
    parts = files.files_below(path) if path.is_dir() else [path]
    return {"name": name, "size": sum(p.stat().st_size for p in parts), "sha256": sha256}


def parameters(stage: Stage, settings: Any, read: Sequence[str] = ()) -> dict[str, Any]:
    """Flatten the named fields of plain settings to ``{"sphere.radius": [0.009525, 0.0, "m"]}``.

    Of exclusions, a stage that declares them has those of the files that it reads; notes belong to pages.
    """
    if stage.output != "page":
        settings = {name: value for name, value in settings.items() if name != "notes"}
    flat: dict[str, Any] = {}
    for dotted in stage.parameters:
        if dotted == EXCLUDE:
            own = [one for one in settings.get(EXCLUDE, ()) if one["file"] in read]
            flat[dotted] = [[one["file"], one["readings"], one["frames"]] for one in own]
        else:
            open_ = list(ends(settings, [] if dotted == "*" else dotted.split(".")))
            while open_:
                place, node = open_.pop(0)
                if isinstance(node, dict) and node:
                    open_[:0] = [(f"{place}.{name}".removeprefix("."), value) for name, value in node.items()]
                else:
                    flat[place] = list(node) if isinstance(node, tuple) else node
    return flat


def _kept(store: Store, last: Last | None, key: Key, *, was_taken: bool) -> Key:
    """Return the key of the last result of a task if the code alone has changed since."""
    if key.value is None or store.state(key.value) != "absent":
        return key
    if last is None or (was_taken and last.taken_for != key.value) or store.state(last.key) != "stored":
        return key
    record = store.record(last.key)
    old, new = {} if record is None else record.ingredients, key.ingredients
    # a result that only reports which results behind it were kept is as true as they are
    without = ({n: v for n, v in one.items() if n not in ("function", "code", "kept")} for one in (old, new))
    if len(set(map(files.canonical, without))) > 1:
        return key
    return Key(last.key, old, "", tuple(_code_changes(old, new)), key.value)


def state_of(session: Session, store: Store, task: Task, key: Key) -> str:
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


def _row_to_run(store: Store, last: Last | None, task: Task, key: Key, state: str, needed: Set[TaskId]) -> Row:
    """Say why a task will run."""
    waiting = [] if state == "unpublished" else [before for before in task.before if before in needed]
    if state == "unpublished":
        reasons = [f"{page_name(task.id.experiment)} is missing or was changed"]
    elif state == "unreadable":
        reasons = [key.problem]
    elif state == "damaged" or last is None:
        reasons = ["never run" if last is None else "result damaged"]
    else:
        reasons, record, new = list[str](), store.record(last.key), key.ingredients
        old = new if record is None else record.ingredients
        if changed := _code_changes(old, new):
            reasons.append(code_changed(changed))
        before, after = _facts(old), _facts(new)
        for name in after | before:
            # as text: the record has lists where settings have tuples
            if files.canonical(before.get(name)) == files.canonical(after.get(name)):
                continue
            if name.startswith("parameter"):
                reasons.append(f"{name} changed {_shown(before.get(name))} -> {_shown(after.get(name))}")
            elif not (name.startswith("upstream") and (waiting or reasons)):  # the task before it says more
                way = "removed" if name not in after else "changed" if name in before else "added"
                reasons.append(f"{name} {way}")
    reasons += sorted({f"upstream {before.seen_from(task.id)} will run" for before in waiting})
    return Row(*task.id, WAITS if waiting else WILL_RUN, _first(reasons, "; ") or "result is gone", task.stage.summary)


def _code_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Name the packages and libraries in which the code of two results differs."""
    before, after = old.get("code", {}), new["code"]
    function = [str(new["function"])] if old.get("function") != new["function"] else []
    return function + [name for name in after | before if before.get(name) != after.get(name)]


def _facts(ingredients: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ingredients that a reason may name, but for the code."""
    inputs = ingredients["inputs"]
    return {
        **{f"parameter {name}": value for name, value in ingredients["parameters"].items()},
        **{f"input {file['name']}": file["sha256"] for one in inputs for file in one.get("files", ())},
        **{f"session {name}": value for name, value in ingredients.get("session", {}).items()},
        "option full": ingredients.get("full"),
        "kind of experiment": ingredients["kind"],
        "kept results of earlier code": ingredients.get("kept"),
        **{f"upstream {one['input']}": one["keys"] for one in inputs if "keys" in one},
    }


def _shown(value: Any) -> str:
    """Write a parameter for people; a quantity is stored as value, uncertainty, SI unit."""
    if isinstance(value, list) and [type(part) for part in value] == [float, float, str]:
        return str(Quantity(*value))
    text = "none" if value is None else value if isinstance(value, str) else files.canonical(value)
    return text if len(text) <= 60 else text[:60] + "…"

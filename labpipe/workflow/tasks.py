"""The stages of a session spelled out: one task per experiment, stage and recording, with its key.

A key says everything that a result depends on: the code that the stage can reach, the parameters,
the contents of the files and the keys of the other inputs. Equal key, equal result.
"""

import graphlib
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from labpipe.errors import ConfigError, InputError, SourceError
from labpipe.files import HashIndex, canonical, files_below
from labpipe.workflow import graph
from labpipe.workflow.fields import REFERENCE, suggest
from labpipe.workflow.graph import FILE, OTHER, Stage
from labpipe.workflow.session import FILE_NAME, Experiment, Session

if TYPE_CHECKING:
    from labpipe.workflow.store import Store

CARRIERS = {
    "dataset": (
        "labpipe.netcdf:prepare",
        "labpipe.netcdf:encoding",
        "labpipe.netcdf:read",
        "labpipe.workflow.ledger:counts",
    ),
    "page": ("labpipe.workflow.ledger:summarise", "labpipe.workflow.provenance:of_task"),
}
"""What has a hand in a result beside its function, by the stage's output."""

Stages = Mapping[str, Sequence[Stage]]
"""The stages of every kind of experiment, by the name of the kind."""


class TaskId(NamedTuple):
    """Which experiment, stage and (for stages that run per recording) file."""

    experiment: str
    stage: str
    recording: str | None = None

    def __str__(self) -> str:
        """``acrylic/velocity`` or ``acrylic/velocity [laser/r1.csv]``."""
        suffix = f" [{self.recording}]" if self.recording is not None else ""
        return f"{self.experiment}/{self.stage}{suffix}"


@dataclass(frozen=True, slots=True)
class Argument:
    """One input of a task: results of other tasks, or files, or nothing."""

    name: str
    tasks: tuple[TaskId, ...] = ()
    files: tuple[str, ...] = ()
    is_list: bool = False


@dataclass(frozen=True, slots=True)
class Task:
    """One call of one stage."""

    id: TaskId
    stage: Stage
    arguments: tuple[Argument, ...]

    @property
    def before(self) -> tuple[TaskId, ...]:
        """Tasks whose results it takes."""
        return tuple(task for argument in self.arguments for task in argument.tasks)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files it reads."""
        return tuple(name for argument in self.arguments for name in argument.files)


@dataclass(frozen=True, slots=True)
class Key:
    """A task's key with what it was made of; ``value`` is None when a file cannot be read.

    ``kept`` says what has changed in the code since the result was made, where an earlier result
    is taken as it is; the key is then that of the earlier one, ``taken_for`` the present one.
    """

    value: str | None
    ingredients: Mapping[str, Any]
    problem: str = ""
    kept: tuple[str, ...] = ()
    taken_for: str | None = None


# --- spelling out ------------------------------------------------------------------------------


def spell_out(session: Session, stages: Stages) -> dict[TaskId, Task]:
    """List the tasks of a session, inputs before what takes them.

    Raises
    ------
    InputError
        The stages of a kind do not fit together.
    ConfigError
        Experiments refer to each other in a circle, or to a stage that is not there.
    """
    plans = {}
    for experiment in session.experiments.values():
        if experiment.kind not in stages:
            message = f'no stages are known for the kind "{experiment.kind}"'
            raise InputError(message)
        if experiment.kind not in plans:
            plans[experiment.kind] = graph.ordered(
                stages[experiment.kind], type(experiment.settings)
            )
    tasks: dict[TaskId, Task] = {}
    for name in _experiment_order(session, plans):
        experiment = session.experiments[name]
        for stage in plans[experiment.kind]:
            for recording in recordings(experiment, stage):
                task_id = TaskId(name, stage.name, recording)
                arguments = tuple(
                    _argument(session, plans, experiment, text, recording, stage.over)
                    for text in stage.inputs
                )
                tasks[task_id] = Task(task_id, stage, arguments)
    return tasks


def recordings(experiment: Experiment, stage: Stage) -> tuple[str | None, ...]:
    """List the files that a stage runs over, or just None when it runs once."""
    if stage.over is None:
        return (None,)
    return _names(field_value(experiment.settings, stage.over))


def references(experiment: Experiment, stages: Iterable[Stage]) -> dict[str, str]:
    """Other experiments whose results the stages take, with the field that names each."""
    found = {}
    for stage in stages:
        for text in stage.inputs:
            if text.startswith(OTHER):
                field = text.removeprefix(OTHER).split("/")[0]
                other = _reference(experiment, field)
                if other is not None:
                    found[other] = field
    return found


def field_value(settings: Any, dotted: str) -> Any:
    """Follow a dotted field; None when an optional structure on the way is absent.

    Through a list of structures it leads to all their values, joined: ``drops.laser``.
    """
    for name in dotted.split("."):
        if isinstance(settings, list | tuple):
            values = [getattr(item, name, None) for item in settings]
            settings = [part for value in values for part in _names(value)]
        else:
            settings = getattr(settings, name, None)
    return settings


def _reference(experiment: Experiment, field: str) -> str | None:
    value = field_value(experiment.settings, field)
    is_reference = isinstance(value, str) and value.startswith(REFERENCE)
    return value.removeprefix(REFERENCE) if is_reference else None


def _names(value: Any) -> tuple[str, ...]:
    if value is None:
        return ()
    return (value,) if isinstance(value, str) else tuple(value)


def _experiment_order(session: Session, plans: Mapping[str, tuple[Stage, ...]]) -> list[str]:
    needs = {e.name: references(e, plans[e.kind]) for e in session.experiments.values()}
    try:
        return list(graphlib.TopologicalSorter(needs).static_order())
    except graphlib.CycleError as error:
        first, second = error.args[1][:2]
        where = needs[second][first]
        line = session.experiments[second].lines.get(where, 1)
        circle = " -> ".join(error.args[1])
        message = f"{where}: experiments wait for each other in a circle: {circle}"
        raise ConfigError([f"{FILE_NAME}:{line}: experiments.{second}.{message}"]) from None


def arguments(
    session: Session, stages: Stages, experiment: Experiment, inputs: Iterable[str]
) -> tuple[Argument, ...]:
    """Resolve inputs, written like those of a stage, for what runs once per experiment.

    Raises
    ------
    ConfigError
        The experiment refers to one that has no such stage.
    """
    return tuple(_argument(session, stages, experiment, text) for text in inputs)


def _argument(
    session: Session,
    plans: Stages,
    experiment: Experiment,
    text: str,
    recording: str | None = None,
    over: str | None = None,
) -> Argument:
    if text.startswith(FILE):
        field = text.removeprefix(FILE)
        value = field_value(experiment.settings, field)
        if recording is not None and field == over:
            return Argument(text, files=(recording,))
        return Argument(text, files=_names(value), is_list=isinstance(value, list | tuple))
    source, name = experiment, text
    if text.startswith(OTHER):
        field, name = text.removeprefix(OTHER).split("/")
        other = _reference(experiment, field)
        if other is None:
            return Argument(text)
        source = session.experiments[other]
    known = {s.name: s for s in plans[source.kind]}
    if name not in known:
        line = experiment.lines.get(field, 1)
        near = suggest(name, known)
        message = f'"{source.name}" is of kind "{source.kind}", which has no stage "{name}"{near}'
        raise ConfigError([f"{FILE_NAME}:{line}: experiments.{experiment.name}.{field}: {message}"])
    taken = known[name]
    if source is experiment and recording is not None and taken.per == "recording":
        return Argument(text, tasks=(TaskId(source.name, name, recording),))
    ids = tuple(TaskId(source.name, name, r) for r in recordings(source, taken))
    return Argument(text, tasks=ids, is_list=taken.per == "recording")


# --- keys --------------------------------------------------------------------------------------


def make_keys(
    session: Session,
    tasks: Mapping[TaskId, Task],
    store: "Store",
    *,
    full: bool = False,
    keep: bool | None = False,
) -> dict[TaskId, Key]:
    """Give every task its key; files are read unless the index knows them.

    With ``keep``, the last result of a task is taken for the right one where nothing but the code
    has changed; with None, only where an earlier run took it.
    """
    keys: dict[TaskId, Key] = {}
    plain = {e.name: msgspec.to_builtins(e.settings) for e in session.experiments.values()}
    for task in tasks.values():
        parameters = _parameters(task.stage, plain[task.id.experiment])
        key = _key(session, tasks, task, parameters, keys, store, full)
        if keep is not False and task.stage.output == "dataset":
            key = _kept(store, task, key, was_taken=keep is None)
        keys[task.id] = key
    return keys


def _key(
    session: Session,
    tasks: Mapping[TaskId, Task],
    task: Task,
    parameters: dict[str, Any],
    keys: Mapping[TaskId, Key],
    store: "Store",
    full: bool,
) -> Key:
    stage = task.stage
    problem = ""
    inputs: list[dict[str, Any]] = []
    for argument in task.arguments:
        entry: dict[str, Any] = {"input": argument.name}
        if argument.tasks:
            entry["keys"] = [keys[before].value for before in argument.tasks]
        try:
            if argument.files:
                entry["files"] = [
                    describe_file(session.root, n, store.index) for n in argument.files
                ]
        except SourceError as error:
            problem = str(error).replace(f"{session.root}/", "")
        inputs.append(entry)
    ingredients: dict[str, Any] = {
        "kind": session.experiments[task.id.experiment].kind,
        "stage": stage.name,
        "function": stage.function,
        "code": {},
        "parameters": parameters,
        "inputs": inputs,
    }
    try:
        ingredients["code"] = store.code.behind(stage.function, *CARRIERS[stage.output])._asdict()
    except SourceError as error:
        problem = str(error)
    if stage.shortcuts:
        ingredients["full"] = full
    if stage.context:
        ingredients["session"] = {
            "experiment": task.id.experiment,
            "title": session.title,
            "operator": session.operator,
            "notes": session.notes,
            "synthetic": session.synthetic,
        }
        kept = {str(name): keys[name].kept for name in ancestors(tasks, task.id)}
        if any(kept.values()):
            ingredients["kept"] = {name: list(changed) for name, changed in kept.items() if changed}
    if problem or any(keys[before].value is None for before in task.before):
        return Key(None, ingredients, problem)
    return Key(key_of(ingredients), ingredients)


def _kept(store: "Store", task: Task, key: Key, *, was_taken: bool) -> Key:
    """Return the key of the last result of a task if the code alone has changed since."""
    if key.value is None or store.state(key.value) != "absent":
        return key
    last = store.last(task.id)
    record = None if last is None else store.record(last.key)
    is_welcome = last is not None and (not was_taken or last.taken_for == key.value)
    if record is None or not is_welcome or store.state(record.key) != "stored":
        return key
    old, new = record.ingredients, key.ingredients
    if any(old.get(name) != new.get(name) for name in (old.keys() | new.keys()) - _CODE):
        return key
    return Key(record.key, old, "", tuple(code_changes(old, new)), key.value)


_CODE = {"function", "code", "version", "format"}
"""Ingredients that say how a result was made, not from what; the last two in old records."""


def code_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Name the modules, data files and libraries in which the code of two results differs."""
    before, after = ({**code.get("modules", {}), **_versions(code)} for code in (
        old.get("code", {}), new.get("code", {})))  # fmt: skip
    if before == after:
        return []
    if not before:
        return ["made before labpipe kept its code in mind"]
    return [name for name in (*after, *(n for n in before if n not in after))
            if before.get(name) != after.get(name)]  # fmt: skip


def _versions(code: Mapping[str, Any]) -> dict[str, str]:
    return {
        f"{name} (library)": str(version) for name, version in code.get("libraries", {}).items()
    }


def key_of(ingredients: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical JSON text of the ingredients."""
    return hashlib.sha256(canonical(ingredients).encode("utf-8", "surrogatepass")).hexdigest()


def describe_file(root: Path, name: str, index: HashIndex) -> dict[str, Any]:
    """Name, size and digest of a file or folder of the session.

    The name belongs to the key: a function sees it, and readers are chosen by it.
    """
    path = root / name
    sha256 = index.digest(path)
    parts = files_below(path) if path.is_dir() else [path]
    return {"name": name, "size": sum(p.stat().st_size for p in parts), "sha256": sha256}


def _parameters(stage: Stage, plain: Any) -> dict[str, Any]:
    """Flatten the named fields to ``{"sphere.radius": [0.009525, 0.0, "m"]}``."""
    flat: dict[str, Any] = {}
    for dotted in stage.parameters:
        if dotted == "*":
            _flatten("", plain, flat)
            continue
        _flatten(dotted, _plain_value(plain, dotted.split(".")), flat)
    return flat


def _plain_value(node: Any, names: Sequence[str]) -> Any:
    for position, name in enumerate(names):
        if isinstance(node, list | tuple):
            return [_plain_value(item, names[position:]) for item in node]
        node = node.get(name) if isinstance(node, dict) else None
    return node


def _flatten(prefix: str, value: Any, flat: dict[str, Any]) -> None:
    if isinstance(value, dict) and value:
        for name, child in value.items():
            _flatten(f"{prefix}.{name}" if prefix else str(name), child, flat)
    else:
        flat[prefix] = list(value) if isinstance(value, tuple) else value


def ancestors(tasks: Mapping[TaskId, Task], *task_ids: TaskId) -> list[TaskId]:
    """List all tasks behind some, in the order of the session."""
    found: set[TaskId] = set()
    waiting = list(task_ids)
    while waiting:
        new = [b for b in tasks[waiting.pop()].before if b not in found]
        found.update(new)
        waiting += new
    return [name for name in tasks if name in found]

"""The key of every result: all that it depends on.

The code of the packages that the stage belongs to, the parameters, the contents of the files and the keys of the
other inputs. Equal key, equal result.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from labpipe.errors import SourceError
from labpipe.files import HashIndex, files_below
from labpipe.workflow.code import behind
from labpipe.workflow.graph import Stage
from labpipe.workflow.session import Session
from labpipe.workflow.store import Store, key_of
from labpipe.workflow.tasks import Task, TaskId, ancestors


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


def make_keys(
    session: Session, tasks: Mapping[TaskId, Task], store: Store, *, full: bool = False, keep: bool | None = False
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
    store: Store,
    full: bool,
) -> Key:
    stage = task.stage
    problem = ""
    inputs: list[dict[str, Any]] = []
    for argument in task.arguments:
        entry: dict[str, Any] = {"input": argument.name}
        if argument.tasks:
            entry["keys"] = [keys[before].value for before in argument.tasks]
        if argument.places is not None:
            entry["places"] = list(argument.places)
        try:
            if argument.files:
                entry["files"] = [describe_file(session.root, n, store.index) for n in argument.files]
        except SourceError as error:
            problem = str(error).replace(f"{session.root}/", "")
        inputs.append(entry)
    ingredients: dict[str, Any] = {
        "kind": session.experiments[task.id.experiment].kind,
        "stage": stage.name,
        "function": stage.function,
        "code": behind(stage.function, is_page=stage.output == "page")._asdict(),
        "parameters": parameters,
        "inputs": inputs,
    }
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
    if problem or any(keys[before].value is None for before in task.required):
        return Key(None, ingredients, problem)
    return Key(key_of(ingredients), ingredients)


def _kept(store: Store, task: Task, key: Key, *, was_taken: bool) -> Key:
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
    """Name the packages and libraries in which the code of two results differs."""
    before, after = (
        {**code.get("packages", {}), **_versions(code)} for code in (old.get("code", {}), new.get("code", {}))
    )
    if "packages" not in old.get("code", {}):
        return ["made by an earlier version of labpipe"]
    function = [str(new["function"])] if old.get("function") != new.get("function") else []
    names = (*after, *(name for name in before if name not in after))
    return function + [name for name in names if before.get(name) != after.get(name)]


def _versions(code: Mapping[str, Any]) -> dict[str, str]:
    return {f"{name} (library)": str(version) for name, version in code.get("libraries", {}).items()}


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

"""The key of every result: all that it depends on, and the differences between two keys.

The code of the packages that the stage belongs to, the parameters, the contents of the files and the keys of the
other inputs. Equal key, equal result.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from labpipe import files
from labpipe.errors import SourceError
from labpipe.units import Quantity
from labpipe.workflow.code import behind
from labpipe.workflow.context import code_changed
from labpipe.workflow.fields import show
from labpipe.workflow.graph import Stage
from labpipe.workflow.session import Session
from labpipe.workflow.store import Store, key_of
from labpipe.workflow.tasks import Task, TaskId, ancestors

_CODE = {"function", "code", "version", "format"}
"""Ingredients that say how a result was made, not from which inputs; the last two in old records."""


@dataclass(frozen=True, slots=True)
class Key:
    """A task's key with its ingredients; ``value`` is None when a file cannot be read.

    ``kept`` names the changed code since the result was made, where an earlier result
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
        ingredients, problem = _ingredients(session, task, plain[task.id.experiment], keys, store)
        if task.stage.shortcuts:
            ingredients["full"] = full
        kept = {str(name): list(keys[name].kept) for name in ancestors(tasks, task.id) if keys[name].kept}
        if task.stage.context and kept:
            ingredients["kept"] = kept
        is_known = not problem and all(keys[before].value is not None for before in task.required)
        key = Key(key_of(ingredients) if is_known else None, ingredients, problem)
        if keep is not False and task.stage.output == "dataset":
            key = _kept(store, task, key, was_taken=keep is None)
        keys[task.id] = key
    return keys


def _ingredients(
    session: Session, task: Task, settings: Any, keys: Mapping[TaskId, Key], store: Store
) -> tuple[dict[str, Any], str]:
    """Return everything that a result depends on, and the reason why a file of it cannot be read."""
    stage, problem = task.stage, ""
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
        "parameters": parameters(stage, settings),
        "inputs": inputs,
    }
    if stage.context:
        words = {name: getattr(session, name) for name in ("title", "operator", "notes", "synthetic")}
        ingredients["session"] = {"experiment": task.id.experiment} | words
    return ingredients, problem


def describe_file(root: Path, name: str, index: files.HashIndex) -> dict[str, Any]:
    """Name, size and digest of a file or folder of the session.

    The name belongs to the key: a function sees it, and readers are chosen by it.
    """
    path = root / name
    sha256 = index.digest(path)
    parts = files.files_below(path) if path.is_dir() else [path]
    return {"name": name, "size": sum(p.stat().st_size for p in parts), "sha256": sha256}


def parameters(stage: Stage, settings: Any) -> dict[str, Any]:
    """Flatten the named fields of plain settings to ``{"sphere.radius": [0.009525, 0.0, "m"]}``."""
    flat: dict[str, Any] = {}

    def flatten(place: str, value: Any) -> None:
        if isinstance(value, dict) and value:
            for name, child in value.items():
                flatten(f"{place}.{name}" if place else str(name), child)
        else:
            flat[place] = list(value) if isinstance(value, tuple) else value

    def field(node: Any, names: Sequence[str]) -> Any:
        for position, name in enumerate(names):
            if isinstance(node, list | tuple):
                return [field(item, names[position:]) for item in node]
            node = node.get(name) if isinstance(node, dict) else None
        return node

    for dotted in stage.parameters:
        flatten(*("", settings) if dotted == "*" else (dotted, field(settings, dotted.split("."))))
    return flat


def _kept(store: Store, task: Task, key: Key, *, was_taken: bool) -> Key:
    """Return the key of the last result of a task if the code alone has changed since."""
    if key.value is None or store.state(key.value) != "absent":
        return key
    last = store.last(task.id)
    if last is None or (was_taken and last.taken_for != key.value) or store.state(last.key) != "stored":
        return key
    record = store.record(last.key)
    old, new = {} if record is None else record.ingredients, key.ingredients
    if any(old.get(name) != new.get(name) for name in (old.keys() | new.keys()) - _CODE):
        return key
    return Key(last.key, old, "", tuple(_code_changes(old, new)), key.value)


# --- differences -------------------------------------------------------------------------------


def _code_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Name the packages and libraries in which the code of two results differs."""
    if "packages" not in old.get("code", {}):
        return ["made by an earlier version of labpipe"]
    before, after = (
        code["packages"] | {f"{name} (library)": number for name, number in code["libraries"].items()}
        for code in (old["code"], new["code"])
    )
    function = [str(new["function"])] if old.get("function") != new.get("function") else []
    return function + [name for name in {**after, **before} if before.get(name) != after.get(name)]


def changes(old: Mapping[str, Any], new: Mapping[str, Any], *, is_waiting: bool) -> list[str]:
    """Say in which ingredients a result differs from the last one of the same task.

    For a task that waits, the task it waits for names the change upstream.
    """
    code = _code_changes(old, new)
    found = [code_changed(code)] if code else []
    before, after = old["parameters"], new["parameters"]
    found += [
        f"parameter {name} changed {_shown(before.get(name))} -> {_shown(after.get(name))}"
        for name in {**after, **before}
        # The record has lists where settings have tuples; compared is what would be stored.
        if files.canonical(before.get(name)) != files.canonical(after.get(name))
    ]
    before, after = (
        {file["name"]: file["sha256"] for one in each["inputs"] for file in one.get("files", ())} for each in (old, new)
    )
    found += [f"input {name} changed" for name in after if name in before and before[name] != after[name]]
    found += [f"input {name} added" for name in after if name not in before]
    found += [f"input {name} removed" for name in before if name not in after]
    if old.get("full") != new.get("full"):
        found.append(f"full {_shown(old.get('full'))} -> {_shown(new.get('full'))}")
    words = new.get("session", {})
    found += [f"session {name} changed" for name in words if old.get("session", {}).get(name) != words[name]]
    if old["kind"] != new["kind"]:
        found.append("stored for another kind")
    if old.get("kept") != new.get("kept"):
        found.append("other results of earlier code are kept")
    if found:
        return found
    if [one["input"] for one in old["inputs"]] != [one["input"] for one in new["inputs"]]:
        return ["the stage takes other inputs"]
    pairs = () if is_waiting else zip(old["inputs"], new["inputs"], strict=True)
    return [f"upstream {one['input']} changed" for other, one in pairs if other.get("keys") != one.get("keys")]


def _shown(value: Any) -> str:
    """Write a parameter for people; a quantity is stored as value, uncertainty, SI unit."""
    is_quantity = isinstance(value, list) and len(value) == 3 and isinstance(value[2], str)
    if is_quantity and all(isinstance(v, int | float) for v in value[:2]):
        return show(Quantity(*value))
    text = "none" if value is None else value if isinstance(value, str) else files.canonical(value)
    return text if len(text) <= 60 else text[:60] + "…"

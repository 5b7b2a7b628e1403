"""Changes of session.toml and of records that keep comments and order.

Single values are set by tomlkit. Whole experiments are moved as blocks of lines, from a header to
the next one with the remarks above it. After every change the file is read again: it must hold
exactly the wanted one, or the change is refused.
"""

from __future__ import annotations

import copy
import datetime
import json
import re
import tomllib
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import tomlkit
import tomlkit.exceptions
import tomlkit.items

from labpipe.errors import InputError
from labpipe.workflow.fields import REFERENCE, ReferenceMark, is_gap, mark, split
from pipelines.experiments.shared.proposals import listed

Place = tuple[str | int, ...]
_HEADER = re.compile(r"^[ \t]*(\[{1,2})[ \t]*([^\[\]\n]+?)[ \t]*(\]{1,2}[ \t]*(?:#.*)?)$")
_NAME = re.compile(r"[A-Za-z0-9_-]+")
EXPERIMENTS = "experiments"


def set_value(text: str, place: Place, value: Any) -> str:
    """Set one value as :func:`set_values` does."""
    return set_values(text, [(place, value)])


def set_values(text: str, changes: Sequence[tuple[Place, Any]]) -> str:
    """Set values, or with None take them out; the text is parsed once for all of them.

    A change is of keys, and positions in arrays, to values of TOML; tables that are not there are made.

    Raises
    ------
    InputError
        The text is not TOML, or a place is within something that is not a table.
    """
    meant = _tree(text)
    place: Place = ()
    try:
        document = tomlkit.parse(text)
        for place, value in changes:
            _set(meant, place, value)
            node: Any = document
            for key in place[:-1]:
                if isinstance(key, str) and key not in node:
                    node[key] = tomlkit.table()
                node = node[key]
            if value is None:
                node.remove(place[-1]) if place[-1] in node else None
            elif isinstance(value, dict):
                node[place[-1]] = tomlkit.value(inline(value))
            elif not isinstance(value, list):
                node[place[-1]] = value
            elif not _relisted(node.get(place[-1]), value):
                node[place[-1]] = _listed(value)
        changed = tomlkit.dumps(document)
    except (tomlkit.exceptions.TOMLKitError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise InputError(f"{_shown(place)} cannot be changed here ({error}); change session.toml by hand") from None
    return _as_meant(changed, meant, place)


def rename(text: str, name: str, to: str, kinds: Mapping[str, type[msgspec.Struct]]) -> str:
    """Give an experiment another name, also where others refer to it."""
    tree = _tree(text, name)
    _require_new(tree, to)
    tree[EXPERIMENTS] = {to if key == name else key: table for key, table in tree[EXPERIMENTS].items()}
    changed = _rewritten(text, name, tree, lambda own: _renamed(own, to))
    for place, kind, value in leaves(tree, kinds):
        if mark(kind, ReferenceMark) and value in (name, REFERENCE + name):
            changed = set_value(changed, place, REFERENCE + to if value.startswith(REFERENCE) else to)
    return changed


def remove(text: str, name: str) -> str:
    """Leave an experiment out."""
    tree = _tree(text, name)
    del tree[EXPERIMENTS][name]
    if not tree[EXPERIMENTS]:
        raise InputError("a session needs an experiment; this is the last one")
    return _rewritten(text, name, tree, lambda own: "")


def replaced(text: str, name: str, tables: str) -> str:
    """Write other tables of TOML in the place of an experiment's."""
    tree = _tree(text, name)
    tree[EXPERIMENTS][name] = _tree(tables)[EXPERIMENTS][name]
    return _rewritten(text, name, tree, lambda own: tables)


def separate(text: str, name: str, to: str, key: str, names: Sequence[str]) -> str:
    """Put some recordings of an experiment into a second one with the same settings, behind the first."""
    tree = _tree(text, name)
    _require_new(tree, to)
    here = tree[EXPERIMENTS][name].get(key)
    chosen = [file for file in here if file in names] if isinstance(here, list) else []
    rest = [file for file in here if file not in names] if isinstance(here, list) else []
    if not chosen or not rest:
        raise InputError("choose some of the recordings, and not all of them")
    tree[EXPERIMENTS][to] = copy.deepcopy(tree[EXPERIMENTS][name])
    changed = _rewritten(text, name, tree, lambda own: "\n\n".join(_renamed(own, at).rstrip() for at in (name, to)))
    return set_values(changed, [((EXPERIMENTS, name, key), rest), ((EXPERIMENTS, to, key), chosen)])


def join(text: str, name: str, other: str, key: str) -> str:
    """Put the recordings of another experiment of the same kind behind those of this one."""
    tree = _tree(text, name, other)
    first, second = tree[EXPERIMENTS][name], tree[EXPERIMENTS][other]
    if name == other or first.get("kind") != second.get("kind"):
        raise InputError(f'"{name}" and "{other}" are not of one kind')
    files = [*first.get(key, []), *(f for f in second.get(key, []) if f not in first.get(key, []))]
    return remove(set_value(text, (EXPERIMENTS, name, key), files), other)


def add(text: str, name: str, key: str, names: Sequence[str]) -> str:
    """Put recordings behind those of an experiment."""
    tree = _tree(text, name)
    here = tree[EXPERIMENTS][name].get(key)
    if not isinstance(here, list):
        raise InputError(f"{name}: {key} is no list of recordings")
    kept = [file for file in here if not is_gap(file)]
    return set_value(text, (EXPERIMENTS, name, key), [*kept, *(file for file in names if file not in kept)])


def leaves(tree: Mapping[str, Any], kinds: Mapping[str, type[msgspec.Struct]]) -> Iterator[tuple[Place, Any, Any]]:
    """Yield place, type and value of every setting of every experiment that is written."""
    for name, table in tree.get(EXPERIMENTS, {}).items():
        if isinstance(table, dict) and table.get("kind") in kinds:
            for place, kind, value, _ in values(kinds[table["kind"]], table, (EXPERIMENTS, name)):
                if value is not None:
                    yield place, kind, value


def values(
    kind: type[msgspec.Struct], table: Any, place: Place, is_required: bool = True
) -> Iterator[tuple[Place, Any, Any, bool]]:
    """Yield every field of a structure: place, type, value (None where it is not written), and if it must be there."""
    table = table if isinstance(table, dict) else {}
    for info in msgspec.structs.fields(kind):
        must = is_required and info.required
        name, bare = info.encode_name, split(info.type)[0]
        inner = typing.get_args(bare)[0] if typing.get_origin(bare) is list else None
        if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
            yield from values(bare, table.get(name), (*place, name), must)
        elif inner is not None and isinstance(inner, type) and issubclass(inner, msgspec.Struct):
            items = table.get(name)
            for number, item in enumerate(items if isinstance(items, list) else ()):
                yield from values(inner, item, (*place, name, number), must)
        else:
            yield (*place, name), info.type, table.get(name), must


def remarks(text: str) -> dict[Place, str]:
    r"""Return the comment behind a value on its line, as ``init`` says where it has it from.

    Examples
    --------
    >>> remarks('[a]\nheight = "7 mm"  # proposed from the file name')
    {('a', 'height'): 'proposed from the file name'}
    """
    found: dict[Place, str] = {}

    def look(node: Any, place: Place) -> None:
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            if isinstance(value, dict | list) and not isinstance(value, tomlkit.items.Array):
                look(value, (*place, key))
            elif isinstance(value, tomlkit.items.Item) and value.trivia.comment:
                found[*place, key] = value.trivia.comment.lstrip("# ")

    try:
        look(tomlkit.parse(text), ())
    except tomlkit.exceptions.TOMLKitError:
        return {}  # what is wrong with the text is told where it is checked
    return found


def inline(value: Any) -> str:
    r"""Write a table on one line, as session.toml and a field of the page hold it.

    Examples
    --------
    >>> print(inline({"time": "t (s)", "force": {"column": 2, "unit": "N"}}))
    { time = "t (s)", force = { column = 2, unit = "N" } }
    """
    if not isinstance(value, dict):
        return value.isoformat() if isinstance(value, datetime.date) else json.dumps(value, ensure_ascii=False)
    keys = (key if _NAME.fullmatch(key) else json.dumps(key, ensure_ascii=False) for key in value)
    return "{ " + ", ".join(f"{key} = {inline(one)}" for key, one in zip(keys, value.values(), strict=True)) + " }"


def as_value(kind: Any, text: str) -> Any:
    """Return a typed text as TOML keeps it for a field; an unsuitable one stays a text."""
    bare = split(kind)[0]
    try:
        if any(typing.get_origin(o) is dict or hasattr(o, "__struct_fields__") for o in typing.get_args(bare)):
            # the columns of a table, or a table of numbers
            typed = re.sub(r"^columns\s*=\s*", "", text)
            return tomllib.loads(f"columns = {typed}")["columns"] if typed.startswith("{") else typed
        if bare is bool:
            return {"true": True, "false": False}.get(text, text)
        if bare in (int, float):
            return bare(text.replace(",", "."))
        if bare is datetime.date:
            return datetime.date.fromisoformat(text)
        if typing.get_origin(bare) in (tuple, list):
            return json.loads(text) if text.startswith("[") else text
        if typing.get_origin(bare) is typing.Literal and all(isinstance(a, int) for a in typing.get_args(bare)):
            return int(text)
    except ValueError:
        return text
    return text


# --- the text ------------------------------------------------------------------------------------


def tree_of(text: str) -> dict[str, Any]:
    """Return what a file of TOML holds; nothing where it is damaged, which is shown where it is checked."""
    try:
        return tomllib.loads(text.replace("\r\n", "\n"))
    except (ValueError, RecursionError):
        return {}


def _tree(text: str, *names: str) -> dict[str, Any]:
    """Return the content of a text, which must hold these experiments."""
    try:
        tree = tomllib.loads(text.replace("\r\n", "\n"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"the file is not TOML ({error}); correct it by hand first") from None
    tables = tree.get(EXPERIMENTS)
    for name in names:
        if not isinstance(tables, dict) or not isinstance(tables.get(name), dict):
            raise InputError(f'there is no experiment "{name}"')
    return tree


def _set(tree: Any, place: Place, value: Any) -> None:
    node = tree
    for key in place[:-1]:
        try:
            node = node.setdefault(key, {}) if isinstance(key, str) else node[key]
        except (AttributeError, IndexError, TypeError):
            raise InputError(f"{_shown(place)}: there is no such table") from None
    if not isinstance(node, dict):
        raise InputError(f"{_shown(place)}: there is no such table")
    if value is None:
        node.pop(place[-1], None)
    else:
        node[place[-1]] = value


def _as_meant(text: str, meant: Mapping[str, Any], place: Place) -> str:
    if tree_of(text) != meant:
        message = f"{_shown(place)} is written in a way that cannot be changed here; change session.toml by hand"
        raise InputError(message)
    return text


def _listed(names: Sequence[Any]) -> Any:
    if len(names) > 1 and all(isinstance(name, str) for name in names):
        return tomlkit.parse(f"names = {listed(names)}")["names"]
    array = tomlkit.array()
    array.extend(tomlkit.value(inline(name)) if isinstance(name, dict) else name for name in names)
    return array


def _relisted(array: Any, wanted: Sequence[Any]) -> bool:
    """Change a list of texts in its place where items only come or go, so that lines of the others stay as they are."""
    if not isinstance(array, tomlkit.items.Array) or not all(isinstance(item, str) for item in (*array, *wanted)):
        return False
    kept = [item for item in array if item in wanted]
    if kept != list(wanted[: len(kept)]):
        return False
    for item in [item for item in array if item not in wanted]:
        array.remove(item)
    array.extend(wanted[len(kept) :])
    return True


def _require_new(tree: Mapping[str, Any], name: str) -> None:
    if name in tree[EXPERIMENTS] or not name.strip():
        raise InputError(f'there is an experiment "{name}" already' if name.strip() else "a name is needed")


Block = tuple[tuple[str, ...], str]
"""Lines from a header to the next one: the keys of the header, and the text."""


def _rewritten(text: str, name: str, meant: Mapping[str, Any], write: Callable[[list[Block]], str]) -> str:
    """Write the blocks of an experiment anew, in the place of the first; `meant` is what the text must hold then."""
    found: list[tuple[tuple[str, ...], list[str]]] = [((), [])]
    for line in text.splitlines(keepends=True):  # cut at the headers; remarks right above one go with it
        path = _path_of(line.rstrip("\r\n"))
        if path is not None:
            above = found[-1][1]
            first = len(above)
            while first and above[first - 1].lstrip().startswith("#"):
                first -= 1
            remarks = above[first:]
            del above[first:]
            found.append((path, remarks))
        found[-1][1].append(line)
    if found[-1][1] and not found[-1][1][-1].endswith("\n"):
        found[-1][1][-1] += "\n"
    blocks = [(path, "".join(lines)) for path, lines in found]
    own = [block for block in blocks if block[0][:2] == (EXPERIMENTS, name)]
    if not own:
        raise InputError(f"{EXPERIMENTS}.{name} has no header of its own; change session.toml by hand")
    made, last = write(own).rstrip(), own[-1][1]
    kept = [block for block in blocks if block not in own]
    kept.insert(blocks.index(own[0]), ((), made and made + last[len(last.rstrip()) :]))
    return _as_meant("".join(block for _, block in kept), meant, (EXPERIMENTS, name))


def _path_of(line: str) -> tuple[str, ...] | None:
    match = _HEADER.match(line)
    if match is None:
        return None
    try:
        node: Any = tomllib.loads(f"[{match[2]}]")
    except ValueError:
        return None
    path: list[str] = []
    while node:
        ((key, node),) = node.items()
        path.append(key)
    return tuple(path)


def _renamed(blocks: Sequence[Block], to: str) -> str:
    """Write blocks of an experiment with another name of it in their headers."""
    written = []
    for path, block in blocks:
        keys = (path[0], to, *path[2:])
        inner = ".".join(key if _NAME.fullmatch(key) else json.dumps(key, ensure_ascii=False) for key in keys)
        for line in block.splitlines(keepends=True):
            if _path_of(line.rstrip("\r\n")) == path:
                begin, end = _HEADER.match(line.rstrip("\r\n")).span(2)  # type: ignore[union-attr]  # it has a path
                line = f"{line[:begin]}{inner}{line[end:]}"  # noqa: PLW2901
            written.append(line)
    return "".join(written)


def _shown(place: Place) -> str:
    return ".".join(map(str, place))

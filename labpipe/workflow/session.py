"""A session folder: what ``session.toml`` says, checked and typed.

Versions of the file, newest first:

1. ``[session]`` with title, operator, notes, synthetic; ``[defaults.KIND]``; ``[experiments.NAME]``
   with ``kind`` and the fields of that kind.
"""

import unicodedata
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec

from labpipe.errors import ConfigError, InputError, SourceError
from labpipe.files import safe_join
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.config import Checker
from labpipe.workflow.document import Document, Place, dotted, nodes, parse
from labpipe.workflow.fields import REFERENCE, found, suggest

VERSION = 1
"""Version of the layout of ``session.toml`` that this program reads."""
FILE_NAME = "session.toml"

_LONGEST_NAME = 200
"""Bytes in the name of an experiment; endings are added to it to make file names."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One experiment: its name, its kind, its typed settings, and the lines of its fields."""

    name: str
    kind: str
    settings: msgspec.Struct
    lines: Mapping[str, int]

    @property
    def refers_to(self) -> tuple[str, ...]:
        """Names of the experiments that its settings name, as one has its material from another."""
        texts = (node for node in nodes(msgspec.to_builtins(self.settings)) if isinstance(node, str))
        return tuple(dict.fromkeys(text.removeprefix(REFERENCE) for text in texts if text.startswith(REFERENCE)))


@dataclass(frozen=True, slots=True, repr=False)
class Session(ShownAsTable):
    """A session folder and everything that its ``session.toml`` says.

    ``experiments`` are complete; ``waiting`` are those with values still to come or to be
    corrected, each with the lines that it waits for.
    """

    root: Path
    title: str
    operator: str
    notes: str
    synthetic: bool
    experiments: Mapping[str, Experiment]
    waiting: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        """Where everything that labpipe writes goes."""
        return self.root / "labpipe"

    def _shown(self) -> Shown:
        rows: list[tuple[str, ...]] = [
            (e.name, e.kind.replace("_", " "), ", ".join(_file_names(msgspec.to_builtins(e.settings))))
            for e in self.experiments.values()
        ]
        rows += [(name, "waiting", lines[0]) for name, lines in self.waiting.items()]
        remarks = [f"recorded by {self.operator}"] if self.operator else []
        remarks += ["synthetic data"] if self.synthetic else []
        caption = f"{self.title} ({'; '.join(remarks)})" if remarks else self.title
        return Shown(caption, ("experiment", "kind", "files"), rows)


_MOST_NAMES = 4


def _file_names(settings: msgspec.Struct) -> list[str]:
    """Names of files in the settings: texts with an ending; beyond a few, only their number."""
    found: list[str] = []
    waiting = [msgspec.to_builtins(settings)]
    while waiting:
        item = waiting.pop(0)
        if isinstance(item, dict):
            waiting[:0] = item.values()
        elif isinstance(item, list | tuple):
            waiting[:0] = item
        elif isinstance(item, str) and Path(item).suffix and not item.startswith(REFERENCE):
            found.append(item)
    more = len(found) - _MOST_NAMES
    return [*found[:_MOST_NAMES], f"and {more} more"] if more > 0 else found


class _SessionTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The table ``[session]``."""

    title: str = ""
    operator: str = ""
    notes: str = ""
    synthetic: bool = False


def load(
    path: Path | str,
    kinds: Mapping[str, type[msgspec.Struct]],
    *,
    may_wait: bool = False,
    may_lack: Collection[str] = (),
    text: str | None = None,
) -> Session:
    """Read a session folder's ``session.toml``.

    Parameters
    ----------
    path : Path or str
        The folder or the file.
    kinds : mapping
        Settings structure of every kind of experiment, by its name.
    may_wait : bool
        Take names of files that are not there yet, for a session that is still being recorded.
    may_lack : collection of str
        Experiments that may name files that are not there any more.
    text : str, optional
        What the file would hold, to be checked before it is written.

    Returns
    -------
    Session
        Everything checked: types, units, ranges, names, and that every file exists inside the
        folder. Experiments with values still to come (``"FILL mm"``), here or in a record that they
        name, or with a mistake of their own, wait, and so do those that refer to them.

    Raises
    ------
    SourceError
        There is no such file.
    ConfigError
        With every mistake and its line: one belongs to no single experiment, or all of them wait.
    """
    source = Path(path)
    source = source / FILE_NAME if source.is_dir() else source
    if not source.is_file():
        raise SourceError(source, "there is no such file", hint=f"make one with: labpipe init {source.parent}")
    document = parse(source, text)
    _check_version(document)
    root = source.parent.resolve()
    head = Checker(document, root).structure(_SessionTable, document.tree.get("session", {}), ("session",))
    for key in document.tree.keys() - _TOP_LEVEL:
        document.report((key,), f"unknown key{suggest(key, _TOP_LEVEL)}")
    found_ones = _Experiments(document, root, kinds, may_wait, may_lack)
    experiments = found_ones.all()
    if document.problems or not experiments:
        document.problems.update(found_ones.told)
    document.finish()
    in_file = [name for name in document.tree.get("experiments", {}) if name in found_ones.waiting]
    waiting = {name: tuple(sorted(found_ones.waiting[name], key=_of_line)) for name in in_file}
    return Session(root, head.title or root.name, head.operator, head.notes, head.synthetic, experiments, waiting)


def _of_line(problem: str) -> tuple[bool, str, int]:
    """Return what sorts gaps as they stand: those of session.toml first, by their lines."""
    name, _, rest = problem.partition(":")
    return name != FILE_NAME, name, int(rest.partition(":")[0])


_TOP_LEVEL = {"labpipe", "session", "defaults", "experiments"}


def _check_version(document: Document) -> None:
    """Stop at once when the file is of another version: all other messages would mislead."""
    name = document.path.name
    stated = document.tree.get("labpipe")
    if stated is None:
        message = f'{name}:1: labpipe: missing; begin the file with the line "labpipe = {VERSION}"'
        raise ConfigError([message])
    where = f"{name}:{document.line(('labpipe',))}: labpipe"
    if not isinstance(stated, int) or isinstance(stated, bool) or stated < 1:
        raise ConfigError([f"{where}: expected {VERSION}, found {found(stated)}"])
    if stated > VERSION:
        message = (
            f"{where}: the file is of version {found(stated)}, this labpipe reads up to {VERSION}; "
            "update labpipe (pip install --upgrade labpipe)"
        )
        raise ConfigError([message])


@dataclass(frozen=True, slots=True)
class _Experiments:
    """Merges defaults into experiments and converts them to their kinds."""

    document: Document
    root: Path
    kinds: Mapping[str, type[msgspec.Struct]]
    may_wait: bool
    may_lack: Collection[str]
    waiting: dict[str, list[str]] = field(default_factory=dict)
    told: dict[str, int] = field(default_factory=dict)

    def all(self) -> dict[str, Experiment]:
        """Convert every experiment; mistakes are reported to the document."""
        tables = self._tables("experiments")
        defaults = self._tables("defaults")
        if not tables and not self.document.problems:
            self.document.report(("experiments",), "no experiment; add a table [experiments.NAME]")
        for kind, table in defaults.items():
            self._check_default(kind, table)
        names = list(tables)
        self._check_names(names)
        found = (self._alone(n, tables[n], defaults, names) for n in names)
        complete = {experiment.name: experiment for experiment in found if experiment is not None}
        return self._without_those_that_wait(complete)

    def _alone(self, name: str, table: dict[str, Any], defaults: dict[str, Any], names: list[str]) -> Experiment | None:
        """Convert one experiment; its mistakes stop it, and no other."""
        alone = replace(self, document=replace(self.document, problems={}))
        gaps: dict[str, int] = {}
        experiment = alone._one(name, table, defaults, names, gaps)
        told = alone.document.problems | gaps
        if not told:
            return experiment
        self.told.update({line: at for line, at in told.items() if line not in self.document.problems})
        self.waiting[name] = list(told)
        return None

    def _without_those_that_wait(self, complete: dict[str, Experiment]) -> dict[str, Experiment]:
        """Let an experiment wait that refers to one that waits, however far."""
        for name, experiment in complete.items():
            if (other := next((n for n in experiment.refers_to if n in self.waiting), None)) is not None:
                line = self.document.line(("experiments", name))
                text = f'{self.document.path.name}:{line}: experiments.{name}: refers to "{other}", which waits'
                self.waiting[name] = [text]
                return self._without_those_that_wait({n: e for n, e in complete.items() if n != name})
        return complete

    def _tables(self, key: str) -> dict[str, Any]:
        value = self.document.tree.get(key, {})
        if not isinstance(value, dict):
            self.document.report((key,), f"expected tables [{key}.NAME], found {found(value)}")
            return {}
        tables = {}
        for name, table in value.items():
            if isinstance(table, dict):
                tables[name] = table
            else:
                self.document.report((key, name), f"expected a table, found {found(table)}")
        return tables

    def _check_default(self, kind: str, table: dict[str, Any]) -> None:
        place = ("defaults", kind)
        if kind not in self.kinds:
            self.document.report(place, f"unknown kind{suggest(kind, self.kinds)}")
            return
        checker = Checker(self.document, self.root, may_wait=self.may_wait, gaps=[])
        checker.structure(self.kinds[kind], table, place, partial=True)

    def _one(
        self, name: str, table: dict[str, Any], defaults: dict[str, Any], names: list[str], gaps: dict[str, int]
    ) -> Experiment | None:
        place = ("experiments", name)
        kind = table.get("kind")
        if kind is None:
            known = ", ".join(sorted(self.kinds))
            self.document.report((*place, "kind"), f"missing; known kinds: {known}")
            return None
        if not isinstance(kind, str) or kind not in self.kinds:
            near = suggest(str(kind), self.kinds)
            self.document.report((*place, "kind"), f"unknown kind {found(kind)}{near}")
            return None
        has_field = any(f.encode_name == "kind" for f in msgspec.structs.fields(self.kinds[kind]))
        own = {key: value for key, value in table.items() if key != "kind" or has_field}
        origins: dict[Place, Place] = {}
        merged = _merge(defaults.get(kind, {}), ("defaults", kind), own, place, place, origins)
        open_ones: list[str] = []
        checker = Checker(self.document, self.root, origins, self.may_wait or name in self.may_lack, open_ones)
        settings = checker.structure(self.kinds[kind], merged, place)
        gaps.update(dict.fromkeys(open_ones, self.document.line(place)))
        if not isinstance(settings, msgspec.Struct):
            # Without typed settings, the texts that carry the prefix can still be checked.
            self._check_references(name, merged, place, names, checker)
            return None
        plain = msgspec.to_builtins(settings)
        self._check_references(name, plain, place, names, checker)
        lines = {dotted(at[2:]): self.document.line(written) for at, written in origins.items()}
        return Experiment(name, kind, settings, lines)

    def _check_names(self, names: list[str]) -> None:
        alike: dict[str, list[str]] = {}
        for name in names:
            alike.setdefault(_folded(name), []).append(name)
        for name in names:
            place = ("experiments", name)
            problem = self._name_problem(name)
            if problem is not None:
                self.document.report(place, f"cannot be the name of an experiment: {problem}")
            twin = next((n for n in alike[_folded(name)][:2] if n != name), None)
            if twin is not None:
                self.document.report(place, f'differs from "{twin}" only in case; rename one')

    def _name_problem(self, name: str) -> str | None:
        if len(name.encode("utf-8", "replace")) > _LONGEST_NAME:
            return f"it is longer than {_LONGEST_NAME} bytes"
        try:
            safe_join(self.root, name)
        except InputError as error:
            return str(error).rpartition(": ")[2]
        if "/" in name:
            return "it contains /"
        return "it begins with a full stop" if name.startswith(".") else None

    def _check_references(self, name: str, node: Any, place: Place, names: list[str], checker: Checker) -> None:
        """Every text "experiment:NAME" must name another experiment of this session."""
        pairs: Any = ()
        if isinstance(node, dict):
            pairs = node.items()
        elif isinstance(node, list | tuple):
            pairs = enumerate(node)
        elif isinstance(node, str) and node.startswith(REFERENCE):
            other = node.removeprefix(REFERENCE)
            if other == name:
                checker.report(place, "an experiment cannot refer to itself")
            elif other not in names:
                near = suggest(other, (n for n in names if n != name))
                checker.report(place, f'there is no experiment "{other}"{near}')
        for key, child in pairs:
            self._check_references(name, child, (*place, key), names, checker)


def _folded(name: str) -> str:
    """Two names that a Macintosh or Windows disk keeps in one file are one."""
    return unicodedata.normalize("NFC", name).casefold()


def _merge(
    base: Any, base_place: Place, over: Any, over_place: Place, place: Place, origins: dict[Place, Place]
) -> Any:
    """Lay one table over another, key by key, and note where each value was written."""
    origins[place] = over_place
    if not isinstance(base, dict) or not isinstance(over, dict):
        _note(over, over_place, place, origins)
        return over
    merged = {}
    for key in (*over, *(k for k in base if k not in over)):
        here, in_base, in_over = (*place, key), (*base_place, key), (*over_place, key)
        if key in over and key in base:
            merged[key] = _merge(base[key], in_base, over[key], in_over, here, origins)
        else:
            merged[key] = over[key] if key in over else base[key]
            _note(merged[key], in_over if key in over else in_base, here, origins)
    return merged


def _note(node: Any, written: Place, place: Place, origins: dict[Place, Place]) -> None:
    origins[place] = written
    pairs: Any = node.items() if isinstance(node, dict) else ()
    pairs = enumerate(node) if isinstance(node, list) else pairs
    for key, child in pairs:
        _note(child, (*written, key), (*place, key), origins)

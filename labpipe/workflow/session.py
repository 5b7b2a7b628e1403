"""A session folder: the content of ``session.toml``, checked and typed.

Versions of the file, newest first:

1. ``[session]`` with title, operator, notes, synthetic, files; ``[defaults.KIND]``; ``[experiments.NAME]``
   with ``kind`` and the fields of that kind.
"""

import unicodedata
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec

from labpipe.errors import ConfigError, InputError, SourceError
from labpipe.files import safe_join
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.config import Checker
from labpipe.workflow.document import Document, Place, children, dotted, nodes, parse
from labpipe.workflow.fields import REFERENCE, found, suggest

VERSION = 1
"""Version of the layout of ``session.toml`` that this program reads."""
FILE_NAME = "session.toml"

_MOST_NAMES = 4
"""Names of files shown of one experiment."""
_TOP_LEVEL = {"labpipe", "session", "defaults", "experiments"}
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
    corrected, each with the lines that it waits for. ``archive`` holds the files of a session whose
    ``session.toml`` and results lie elsewhere.
    """

    root: Path
    title: str
    operator: str
    notes: str
    synthetic: bool
    experiments: Mapping[str, Experiment]
    waiting: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    archive: Path | None = None

    @property
    def files(self) -> Path:
        """Folder that holds the raw files and records: that of ``session.toml``, unless it names another one."""
        return self.archive or self.root

    def path(self, name: str) -> Path:
        """Return where ``session.toml``, or a file that it names, lies."""
        return (self.root if name == FILE_NAME else self.files) / name

    @property
    def folder(self) -> Path:
        """Where everything that labpipe writes goes."""
        return self.root / "labpipe"

    def _shown(self) -> Shown:
        rows: list[tuple[str, ...]] = []
        for one in self.experiments.values():
            texts = (node for node in nodes(msgspec.to_builtins(one.settings)) if isinstance(node, str))
            names = [text for text in texts if Path(text).suffix and not text.startswith(REFERENCE)]
            more = [f"and {len(names) - _MOST_NAMES} more"] if len(names) > _MOST_NAMES else []
            rows.append((one.name, one.kind.replace("_", " "), ", ".join(names[:_MOST_NAMES] + more)))
        rows += [(name, "waiting", lines[0]) for name, lines in self.waiting.items()]
        remarks = [f"recorded by {self.operator}"] if self.operator else []
        remarks += ["synthetic data"] if self.synthetic else []
        caption = f"{self.title} ({'; '.join(remarks)})" if remarks else self.title
        return Shown(caption, ("experiment", "kind", "files"), rows)


class _SessionTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The table ``[session]``; ``files`` is the folder of the raw files, where it is another one."""

    title: str = ""
    operator: str = ""
    notes: str = ""
    synthetic: bool = False
    files: str = ""


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
        Content that the file would have, to be checked before it is written.

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
    archive = (root / head.files).resolve() if head.files else None
    if archive is not None and not archive.is_dir():
        document.report(("session", "files"), f"there is no folder {archive}; correct the path, or mount the disk")
        document.finish()
    for key in document.tree.keys() - _TOP_LEVEL:
        document.report((key,), f"unknown key{suggest(key, _TOP_LEVEL)}")
    tables, defaults = _tables(document, "experiments"), _tables(document, "defaults")
    if not tables and not document.problems:
        document.report(("experiments",), "no experiment; add a table [experiments.NAME]")
    for kind, table in defaults.items():
        if kind not in kinds:
            document.report(("defaults", kind), f"unknown kind{suggest(kind, kinds)}")
        else:
            checker = Checker(document, archive or root, may_wait=may_wait, gaps=[])
            checker.structure(kinds[kind], table, ("defaults", kind), partial=True)
    _check_names(document, root, list(tables))
    experiments: dict[str, Experiment] = {}
    waiting: dict[str, tuple[str, ...]] = {}
    own_problems: dict[str, int] = {}
    for name in tables:
        alone = replace(document, problems={})  # the mistakes of an experiment stop it, and no other
        gaps: list[str] = []
        one = _experiment(alone, archive or root, kinds, defaults, tables, name, may_wait or name in may_lack, gaps)
        problems = alone.problems | dict.fromkeys(gaps, document.line(("experiments", name)))
        if one is not None and not problems:
            experiments[name] = one
        else:
            own_problems |= {text: line for text, line in problems.items() if text not in document.problems}
            waiting[name] = tuple(sorted(problems, key=_of_line))
    while blocked := next(
        ((one.name, other) for one in experiments.values() for other in one.refers_to if other in waiting), None
    ):
        name, other = blocked
        del experiments[name]
        waiting[name] = (document.at(("experiments", name), f'refers to "{other}", which waits'),)
    if document.problems or not experiments:
        document.problems.update(own_problems)
    document.finish()
    waiting = {name: waiting[name] for name in tables if name in waiting}
    title = head.title or (archive or root).name
    return Session(root, title, head.operator, head.notes, head.synthetic, experiments, waiting, archive)


def _of_line(problem: str) -> tuple[bool, str, int]:
    """Return the place by which problems are sorted: those of session.toml first, by their lines."""
    name, _, rest = problem.partition(":")
    return name != FILE_NAME, name, int(rest.partition(":")[0])


def _check_version(document: Document) -> None:
    """Stop at once when the file is of another version: all other messages would mislead."""
    stated = document.tree.get("labpipe")
    if stated is None:
        message = f'missing; begin the file with the line "labpipe = {VERSION}"'
    elif isinstance(stated, int) and stated > VERSION:
        message = f"the file is of version {found(stated)}, this labpipe reads up to {VERSION}; "
        message += "update labpipe (pip install --upgrade labpipe)"
    elif stated is not VERSION:
        message = f"expected {VERSION}, found {found(stated)}"
    else:
        return
    raise ConfigError([document.at(("labpipe",), message)])


def _tables(document: Document, key: str) -> dict[str, dict[str, Any]]:
    """Return the tables ``[key.NAME]``; report anything else."""
    value = document.tree.get(key, {})
    if not isinstance(value, dict):
        document.report((key,), f"expected tables [{key}.NAME], found {found(value)}")
        return {}
    for name, table in value.items():
        if not isinstance(table, dict):
            document.report((key, name), f"expected a table, found {found(table)}")
    return {name: table for name, table in value.items() if isinstance(table, dict)}


def _check_names(document: Document, root: Path, names: Sequence[str]) -> None:
    """Report names of experiments that cannot be names of files, or that a disk may take for one."""
    alike: dict[str, list[str]] = {}
    for name in names:  # two names that a Macintosh or Windows disk keeps in one file are one
        alike.setdefault(unicodedata.normalize("NFC", name).casefold(), []).append(name)
    for name in names:
        problem = "it begins with a full stop" if name.startswith(".") else ""
        problem = "it contains /" if "/" in name else problem
        try:
            safe_join(root, name)
        except InputError as error:
            problem = str(error).rpartition(": ")[2]
        if len(name.encode("utf-8", "replace")) > _LONGEST_NAME:
            problem = f"it is longer than {_LONGEST_NAME} bytes"
        if problem:
            document.report(("experiments", name), f"cannot be the name of an experiment: {problem}")
    for twins in alike.values():
        for name in twins if len(twins) > 1 else ():
            other = next(twin for twin in twins if twin != name)
            document.report(("experiments", name), f'differs from "{other}" only in case; rename one')


def _experiment(
    document: Document,
    root: Path,
    kinds: Mapping[str, type[msgspec.Struct]],
    defaults: Mapping[str, dict[str, Any]],
    tables: Mapping[str, dict[str, Any]],
    name: str,
    may_wait: bool,
    gaps: list[str],
) -> Experiment | None:
    """Lay the table of an experiment over the defaults of its kind and convert it; report mistakes and gaps."""
    place = ("experiments", name)
    kind = tables[name].get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        known = ", ".join(sorted(kinds))
        text = (
            f"unknown kind {found(kind)}{suggest(str(kind), kinds)}"
            if kind is not None
            else f"missing; known kinds: {known}"
        )
        document.report((*place, "kind"), text)
        return None
    has_field = any(f.encode_name == "kind" for f in msgspec.structs.fields(kinds[kind]))
    own = {key: value for key, value in tables[name].items() if key != "kind" or has_field}
    checker = Checker(document, root, ("defaults", kind), may_wait, gaps)
    merged = _overlaid(own, defaults.get(kind, {}))
    settings = checker.structure(kinds[kind], merged, place)
    is_whole = isinstance(settings, msgspec.Struct)
    # Without typed settings, the texts that carry the prefix can still be checked.
    _check_references(checker, name, tables, msgspec.to_builtins(settings) if is_whole else merged, place)
    parts = {at[2:] for at in document.lines if at[:2] in (place, checker.defaults)}
    lines = {dotted(part): document.line(checker.written((*place, *part))) for part in parts}
    return Experiment(name, kind, settings, lines) if is_whole else None


def _check_references(checker: Checker, name: str, names: Collection[str], node: Any, place: Place) -> None:
    """Report every text "experiment:NAME" that does not name another experiment of this session."""
    if isinstance(node, str) and node.startswith(REFERENCE):
        other = node.removeprefix(REFERENCE)
        if other == name:
            checker.report(place, "an experiment cannot refer to itself")
        elif other not in names:
            checker.report(place, f'there is no experiment "{other}"{suggest(other, (n for n in names if n != name))}')
    for key, child in children(node):
        _check_references(checker, name, names, child, (*place, key))


def _overlaid(own: Any, below: Any) -> Any:
    """Lay a table over another one, and so the tables within."""
    if not (isinstance(own, dict) and isinstance(below, dict)):
        return own
    upper = {key: _overlaid(value, below[key]) if key in below else value for key, value in own.items()}
    return upper | {key: value for key, value in below.items() if key not in own}

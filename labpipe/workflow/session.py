"""A session folder: the content of ``session.toml``, checked and typed.

Versions of the file, newest first:

1. ``[session]`` with title, operator, notes, synthetic, licence, files, stated; ``[[creators]]`` with name, orcid,
   affiliation; ``[defaults.KIND]``; ``[experiments.NAME]`` with ``kind`` and the fields of that kind;
   ``[variants.NAME]`` with ``base``, an experiment, and the fields that differ from it; ``laboratory``, the name of the
   laboratory's file in a folder above, which has ``[defaults.KIND]`` and parts, ``[SETTING.NAME]`` such as
   ``[sphere.A3]``, that sessions refer to by name, ``sphere = "A3"``, or change,
   ``sphere = { from = "A3", mass = "506 g" }``.
"""

import re
import textwrap
import unicodedata
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from labpipe.errors import ConfigError, InputError, SourceError
from labpipe.files import name_problem
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.config import Checker
from labpipe.workflow.document import LABORATORY, Document, Place, dotted, parse
from labpipe.workflow.exclusions import EXCLUDE, files_of, without_excluded
from labpipe.workflow.fields import REFERENCE, ReferenceMark, every_setting, fields_of, found, mark, suggest, tables_of

VERSION = 1
"""Version of the layout of ``session.toml`` that this program reads."""
FILE_NAME = "session.toml"

_LONGEST_NAME = 200
"""Bytes in the name of an experiment; endings are added to it to make file names."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One experiment: its name, its kind, its typed settings, and the lines of its fields.

    ``base`` is the experiment that a variant belongs to, and ``changed`` its settings that differ from those of the
    base, each with both values; ``overrides`` are those that differ from the laboratory's file.
    """

    name: str
    kind: str
    settings: msgspec.Struct
    lines: Mapping[str, int]
    base: str = ""
    changed: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    overrides: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def refers_to(self) -> tuple[str, ...]:
        """Names of the experiments that its settings name, as one has its material from another."""
        named = [value for _, value, kind in every_setting(self.settings) if value and mark(kind, ReferenceMark)]
        named += [self.base] if self.base else []
        return tuple(dict.fromkeys(str(name).removeprefix(REFERENCE) for name in named))


class Creator(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table ``[[creators]]``: an author of the data; ``orcid`` is None where it is not stated, "" for none."""

    name: Annotated[str, msgspec.Meta(min_length=1)]
    orcid: str | None = None
    affiliation: str = ""

    def __post_init__(self) -> None:
        """Check the last digit of the ORCID (ISO 7064, MOD 11-2)."""
        digits = ["0123456789X".find(d) for d in (self.orcid or "").replace("-", "")]
        is_whole = re.fullmatch(r"(\d{4}-){3}\d{3}[\dX]", self.orcid or "") is not None
        if self.orcid and not (is_whole and sum(d << 15 - i for i, d in enumerate(digits)) % 11 == 1):
            raise ValueError(f'"{self.orcid}" is no ORCID, such as 0000-0002-1825-0097 ("" for none)')


@dataclass(frozen=True, slots=True, repr=False)
class Session(ShownAsTable):
    """A session folder and everything that its ``session.toml`` says.

    ``waiting`` are experiments with values still to come or to be corrected, each with the lines that it waits for;
    ``archive`` holds the files of a session whose ``session.toml`` and results are elsewhere.
    """

    root: Path
    title: str
    operator: str
    notes: str
    synthetic: bool
    experiments: Mapping[str, Experiment]
    waiting: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    licence: str = ""
    creators: tuple[Creator, ...] = ()
    archive: Path | None = None

    @property
    def files(self) -> Path:
        """Folder that holds the raw files and records: that of ``session.toml``, unless it names another one."""
        return self.archive or self.root

    def path(self, name: str) -> Path:
        """Return the path of ``session.toml``, or of a file that it names."""
        return (self.root if name == FILE_NAME else self.files) / name

    @property
    def variants(self) -> dict[str, Experiment]:
        """Experiments that have the recordings of another one and other settings."""
        return {name: one for name, one in self.experiments.items() if one.base}

    def without_variants(self) -> "Session":
        """Return the session with every recording once, to count or gather experiments."""
        return replace(self, experiments={n: one for n, one in self.experiments.items() if not one.base})

    @property
    def folder(self) -> Path:
        """Where everything that labpipe writes goes."""
        return self.root / "labpipe"

    def _shown(self) -> Shown:
        rows: list[tuple[str, ...]] = []
        for one in self.experiments.values():
            names = ", ".join(name for _, name in files_of(one.settings))
            rows.append((one.name, one.kind.replace("_", " "), textwrap.shorten(names, 120, placeholder=" …")))
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
    licence: str = ""
    files: str = ""


class _Layout(msgspec.Struct, frozen=True, kw_only=True):
    """The whole file; tables of experiments are checked by their kinds."""

    labpipe: int = VERSION
    laboratory: str = ""
    session: _SessionTable = _SessionTable()
    creators: tuple[Creator, ...] = ()
    defaults: dict[str, dict[str, Any]] = {}
    experiments: dict[str, dict[str, Any]] = {}
    variants: dict[str, dict[str, Any]] = {}


def load(
    path: Path | str,
    kinds: Mapping[str, type[msgspec.Struct]],
    *,
    may_wait: bool = False,
    may_lack: Collection[str] = (),
    text: str | None = None,
    fill: Callable[[Document, Path], object] = lambda document, root: None,
) -> Session:
    """Read the ``session.toml`` of a session folder; ``kinds`` has the settings structure of every kind of experiment.

    Everything is checked: types, units, ranges, names, and that every file exists inside the folder. Experiments with
    values still to come (``"FILL mm"``), here or in a record that they name, or with a mistake of their own, wait, and
    so do those that refer to them.

    ``may_wait`` takes names of files that are not there yet, as while a session is recorded; ``may_lack`` are the
    experiments whose files need not be there any more. ``text`` is a content to be checked before it is written.
    ``fill`` is called with the document and its folder, and may put values from elsewhere into the tree.

    Raises SourceError: there is no such file; ConfigError, with every mistake and its line: one belongs to no single
    experiment, or all of them wait.
    """
    source = Path(path, FILE_NAME) if Path(path).is_dir() else Path(path)
    if text is None and not source.is_file():
        raise SourceError(source, "there is no such file", hint=f"make one with: labpipe init {source.parent}")
    document = parse(source, text)
    _check_version(document)
    root = source.parent.resolve()
    fill(document, root)
    checked = Checker(document, root).value(_Layout, document.tree, ())
    layout = checked if isinstance(checked, _Layout) else _Layout()
    head = layout.session
    files = (root / head.files).resolve() if head.files else root
    if head.files and not files.is_dir():
        document.report(("session", "files"), f"there is no folder {files}; correct the path, or mount the disk")
        document.finish()
    of_laboratory = _of_laboratory(document, root, kinds)
    tables = _tables(document.tree, "experiments", "variants", "defaults") | of_laboratory
    for at in tables:
        if at[-2] == "defaults" and (kind := str(at[-1])) not in kinds:
            document.report(at, f"unknown kind{suggest(kind, kinds)}")
        elif at[0] == "variants" and ("experiments", at[1]) in tables:
            document.report(at, "an experiment has this name; give the variant another one")
    order = {str(at[1]): number for number, at in enumerate(tables) if at[0] == "experiments"}
    if not order and not document.problems:
        document.report(("experiments",), "no experiment; add a table [experiments.NAME]")
    own = [at for at in tables if at[0] == "experiments" or (at[0] == "variants" and at[1] not in order)]
    base_of = {at: str(tables[at].get("base") if at[0] == "variants" else at[1]) for at in own}
    own.sort(key=lambda at: order.get(base_of[at], len(order)))  # each experiment followed by its variants
    places = {str(at[1]): at for at in own}
    _check_names(document, places)
    checker = Checker(document, files, may_fill=True, parts=of_laboratory, names=places)
    checker.laboratory = (root / layout.laboratory).parent.resolve()
    experiments: dict[str, Experiment] = {}
    waiting: dict[str, tuple[str, ...]] = {}
    of_experiments: dict[str, int] = {}
    for name, place in places.items():
        alone = replace(document, problems={})  # the mistakes of an experiment stop it, and no other
        waits = may_wait or name in may_lack
        one = _experiment(replace(checker, document=alone, own=name, may_wait=waits), kinds, tables, place)
        if one is not None and one.base in experiments:
            one = replace(one, changed=_changed(experiments[one.base].settings, one.settings))
            if not one.changed:
                alone.report(place, f"differs in no setting from {one.base}; remove it, or change a setting")
        if one is not None and not alone.problems:
            experiments[name] = one
        else:
            of_experiments |= alone.problems
            waiting[name] = tuple(sorted(alone.problems, key=alone.problems.__getitem__))
    while blocked := {name: other for name, one in experiments.items() for other in one.refers_to if other in waiting}:
        for name, other in blocked.items():
            del experiments[name]
            waiting[name] = (document.at(places[name], f'refers to "{other}", which waits'),)
    if document.problems or not experiments:
        document.problems.update(of_experiments)
    document.finish()
    said = (head.title or files.name, head.operator, head.notes, head.synthetic)
    waiting = {name: waiting[name] for name in places if name in waiting}
    return Session(root, *said, experiments, waiting, head.licence, layout.creators, files if head.files else None)


def _check_version(document: Document) -> None:
    """Stop at once when the file is of another version: all other messages would mislead."""
    stated = document.tree.get("labpipe")
    message = f"expected {VERSION}, found {found(stated)}"
    if stated is None:
        message = f'missing; begin the file with the line "labpipe = {VERSION}"'
    elif isinstance(stated, int) and stated > VERSION:
        message = f"the file is of version {found(stated)}, this labpipe reads up to {VERSION}; "
        message += "update labpipe (pip install --upgrade labpipe)"
    if stated is not VERSION:
        raise ConfigError([document.at(("labpipe",), message)])


def _tables(tree: Mapping[str, Any], *keys: str) -> dict[Place, dict[str, Any]]:
    """Return the tables ``[KEY.NAME]`` by their places; anything else has been reported."""
    groups = {key: tree[key] for key in keys if isinstance(tree.get(key), dict)}
    of_each = (((key, name), table) for key, group in groups.items() for name, table in group.items())
    return {place: table for place, table in of_each if isinstance(table, dict)}


def _of_laboratory(
    document: Document, root: Path, kinds: Mapping[str, type[msgspec.Struct]]
) -> dict[Place, dict[str, Any]]:
    """Return the tables of the laboratory's file, where the session names one, by places that begin with its name.

    Its lines join those of the session's document.
    """
    if not isinstance(named := document.tree.get("laboratory"), str):
        return {}
    path = root / named
    is_above = path.name == LABORATORY and path.parent.resolve() in (root, *root.parents)
    if not (is_above and path.is_file()):
        expected = f'expected {LABORATORY} in a folder above this one, such as "../{LABORATORY}"'
        document.report(("laboratory",), f"{expected}, found {found(named)}; correct the path, or delete this line")
        return {}
    other = parse(path)
    _check_version(other)
    document.lines |= {(LABORATORY, *place): line for place, line in other.lines.items()}
    document.problems |= other.problems
    fields = (info for kind in kinds.values() for info in fields_of(kind))
    known = {"labpipe", "defaults"} | {info.encode_name for info in fields if tables_of(info.type)}
    for key, table in other.tree.items():
        if key not in known:
            document.report((LABORATORY, key), f"unknown key{suggest(key, known - {'labpipe'})}")
        elif key != "labpipe":
            Checker(document, root).value(dict[str, dict[str, Any]], table, (LABORATORY, key))
    return {(LABORATORY, *place): table for place, table in _tables(other.tree, *other.tree).items()}


def _experiment(
    checker: Checker, kinds: Mapping[str, type[msgspec.Struct]], tables: Mapping[Place, dict[str, Any]], place: Place
) -> Experiment | None:
    """Convert the tables of an experiment, and report its mistakes; None where there are some.

    A variant is laid over its base, and that over the defaults of its kind and those of the laboratory.
    """
    document, layers, own = checker.document, dict[Place, dict[str, Any]](), place
    if place[0] == "variants":
        base = tables[place].get("base")
        own = ("experiments", base if isinstance(base, str) else "")
        if own not in tables:
            problem = "missing" if base is None else f"there is no experiment {found(base)}"
            near = suggest(str(base), (str(at[1]) for at in tables if at[0] == "experiments"))
            document.report((*place, "base"), f"{problem}{near or '; name an experiment'}")
            return None
        if "kind" in tables[place]:
            document.report((*place, "kind"), f"a variant is of the kind of its base, {base}; delete this line")
        layers[place] = {key: value for key, value in tables[place].items() if key not in ("base", "kind")}
    name = tables[own].get("kind")
    if not isinstance(name, str) or name not in kinds:
        known = f"missing; known kinds: {', '.join(sorted(kinds))}"
        text = known if name is None else f"unknown kind {found(name)}{suggest(str(name), kinds)}"
        document.report((*own, "kind"), text)
        return None
    is_asked = any(info.encode_name == "kind" for info in fields_of(kinds[name]))
    layers[own] = {key: value for key, value in tables[own].items() if is_asked or key != "kind"}
    layers |= {at: tables[at] for at in (("defaults", name), (LABORATORY, "defaults", name)) if at in tables}
    checker = replace(checker, base=str(own[1]), lines={}, overrides={})
    (_, uppermost), *below = layers.items()
    settings = checker.value(kinds[name], uppermost, place, below)
    if not isinstance(settings, msgspec.Struct):
        return None
    try:
        settings = without_excluded(settings)
    except InputError as error:
        document.report((*place, EXCLUDE, int(error.reason)), str(error))
    lines = {dotted(at): line for at, line in checker.lines.items()}
    return Experiment(checker.own, name, settings, lines, "" if own == place else checker.base, {}, checker.overrides)


def _changed(base: msgspec.Struct, own: msgspec.Struct) -> dict[str, tuple[str, str]]:
    """Return the settings in which two of one kind differ, with both values in words; notes do not count."""
    old, new = (
        {
            place: str(value).removeprefix(REFERENCE)
            for place, value, _ in every_setting(settings)
            if not (isinstance(value, msgspec.Struct | list | None) or place.startswith("notes"))
        }
        for settings in (base, own)
    )
    places = (place for place in dict.fromkeys((*new, *old)) if old.get(place) != new.get(place))
    return {place: (old.get(place, "none"), new.get(place, "none")) for place in places}


def _check_names(document: Document, places: Mapping[str, Place]) -> None:
    """Report names of experiments that cannot be names of files, or that a disk may take for one."""
    alike: dict[str, str] = {}
    for name, place in places.items():
        problem = name_problem(name)
        if problem is None and ("/" in name or name.startswith(".")):
            problem = "it contains /, or begins with a full stop"
        if problem is None and len(name.encode("utf-8", "replace")) > _LONGEST_NAME:
            problem = f"it is longer than {_LONGEST_NAME} bytes"
        if problem:
            document.report(place, f"cannot be the name of an experiment: {problem}")
        # two names that a Macintosh or Windows disk keeps in one file are one
        other = alike.setdefault(unicodedata.normalize("NFC", name).casefold(), name)
        if other != name:
            document.report(place, f'differs from "{other}" only in case; rename one')

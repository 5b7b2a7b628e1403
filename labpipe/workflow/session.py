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
import unicodedata
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from labpipe.errors import ConfigError, InputError, SourceError
from labpipe.files import safe_join
from labpipe.notebook import Shown, ShownAsTable
from labpipe.units import Quantity
from labpipe.workflow.config import NAME, Checker
from labpipe.workflow.document import LABORATORY, Document, Place, children, dotted, nodes, parse
from labpipe.workflow.exclusions import EXCLUDE, without_excluded
from labpipe.workflow.fields import REFERENCE, every_setting, fields_of, found, options_of, show, suggest

VERSION = 1
"""Version of the layout of ``session.toml`` that this program reads."""
FILE_NAME = "session.toml"

_MOST_NAMES = 4
"""Names of files shown of one experiment."""
_TOP_LEVEL = {"labpipe", "laboratory", "session", "creators", "defaults", "experiments", "variants"}
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
        texts = [node for node in nodes(msgspec.to_builtins(self.settings)) if isinstance(node, str)]
        texts += [REFERENCE + self.base] if self.base else []
        return tuple(dict.fromkeys(text.removeprefix(REFERENCE) for text in texts if text.startswith(REFERENCE)))


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
    licence: str = ""
    creators: tuple[Creator, ...] = ()
    archive: Path | None = None

    @property
    def files(self) -> Path:
        """Folder that holds the raw files and records: that of ``session.toml``, unless it names another one."""
        return self.archive or self.root

    def path(self, name: str) -> Path:
        """Return where ``session.toml``, or a file that it names, lies."""
        return (self.root if name == FILE_NAME else self.files) / name

    @property
    def variants(self) -> dict[str, Experiment]:
        """Experiments that have the recordings of another one and other settings."""
        return {name: one for name, one in self.experiments.items() if one.base}

    def without_variants(self) -> "Session":
        """Return the session with every recording once, for what counts or gathers experiments."""
        return replace(self, experiments={n: one for n, one in self.experiments.items() if not one.base})

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
    licence: str = ""
    files: str = ""


class _CreatorsTable(msgspec.Struct, frozen=True, kw_only=True):
    """The tables ``[[creators]]``."""

    creators: tuple[Creator, ...] = ()


def load(
    path: Path | str,
    kinds: Mapping[str, type[msgspec.Struct]],
    *,
    may_wait: bool = False,
    may_lack: Collection[str] = (),
    text: str | None = None,
    fill: Callable[[Document, Path], object] = lambda document, root: None,
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
    fill : callable
        Called with the document and its folder; may put values from elsewhere into the tree.

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
    if text is None and not source.is_file():
        raise SourceError(source, "there is no such file", hint=f"make one with: labpipe init {source.parent}")
    document = parse(source, text)
    _check_version(document)
    root = source.parent.resolve()
    fill(document, root)
    head = Checker(document, root).structure(_SessionTable, document.tree.get("session", {}), ("session",))
    authors = Checker(document, root).structure(
        _CreatorsTable, {key: value for key, value in document.tree.items() if key == "creators"}, ()
    )
    archive = (root / head.files).resolve() if isinstance(head, _SessionTable) and head.files else None
    if archive is not None and not archive.is_dir():
        document.report(("session", "files"), f"there is no folder {archive}; correct the path, or mount the disk")
        document.finish()
    for key in document.tree.keys() - _TOP_LEVEL:
        document.report((key,), f"unknown key{suggest(key, _TOP_LEVEL)}")
    tables, defaults = _tables(document, "experiments"), _tables(document, "defaults")
    laboratory = _laboratory(document, root, kinds)
    if not tables and not document.problems:
        document.report(("experiments",), "no experiment; add a table [experiments.NAME]")
    every: dict[Place, Any] = {("defaults", kind): table for kind, table in defaults.items()}
    every |= {(LABORATORY, "defaults", kind): table for kind, table in laboratory.get("defaults", {}).items()}
    for place, table in every.items():
        if (kind := str(place[-1])) not in kinds:
            document.report(place, f"unknown kind{suggest(kind, kinds)}")
        else:
            checker = Checker(
                document, archive or root, may_wait=may_wait, gaps=[], laboratory=laboratory.get("folder")
            )
            checker.structure(kinds[kind], table, place, partial=True)
    variants = _tables(document, "variants")
    places = _places(document, tables, variants)
    _check_names(document, root, places)
    experiments: dict[str, Experiment] = {}
    waiting: dict[str, tuple[str, ...]] = {}
    own_problems: dict[str, int] = {}
    for name, place in places.items():
        alone = replace(document, problems={})  # the mistakes of an experiment stop it, and no other
        gaps: list[str] = []
        layers = _layers(alone, kinds, defaults, tables, variants.get(name), place)
        layers = _with_laboratory(alone, kinds, laboratory, layers) if layers and laboratory else layers
        known = (kinds, layers, places, may_wait or name in may_lack, gaps, laboratory.get("folder"))
        one = _experiment(alone, archive or root, *known) if layers else None
        if one is not None and place[0] == "variants":
            base = experiments.get(variants[name]["base"])
            changed = {} if base is None else _changed(base.settings, one.settings)
            one = replace(one, base=variants[name]["base"], changed=changed)
            if base is not None and not changed:
                alone.report(place, f"differs in no setting from {base.name}; remove it, or change a setting")
        problems = alone.problems | dict.fromkeys(gaps, document.line(place))
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
        waiting[name] = (document.at(places[name], f'refers to "{other}", which waits'),)
    if document.problems or not experiments:
        document.problems.update(own_problems)
    document.finish()
    told = (head.title or (archive or root).name, head.operator, head.notes, head.synthetic)
    waits_of = {name: waiting[name] for name in places if name in waiting}
    return Session(root, *told, experiments, waits_of, head.licence, authors.creators, archive)


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


def _laboratory(document: Document, root: Path, kinds: Mapping[str, type[msgspec.Struct]]) -> dict[str, Any]:
    """Return the tables of the laboratory's file, with its ``folder``; nothing where the session names none.

    Its lines join those of the session's document, at places that begin with the name of the file.
    """
    if (named := document.tree.get("laboratory")) is None:
        return {}
    path = root / named if isinstance(named, str) else root
    if path.name != LABORATORY or path.parent.resolve() not in (root, *root.parents):
        expected = f'expected {LABORATORY} in a folder above this one, such as "../{LABORATORY}"'
        document.report(("laboratory",), f"{expected}, found {found(named)}")
        return {}
    if not path.is_file():
        document.report(("laboratory",), f"there is no file {found(named)}; correct the name, or delete this line")
        return {}
    other = parse(path)
    _check_version(other)
    document.lines |= {(LABORATORY, *place): line for place, line in other.lines.items()}
    known = {"defaults"} | {
        info.encode_name for kind in kinds.values() for info in fields_of(kind) if _table_type(info.type) is not None
    }
    tables = {key: _tables(other, key) for key in other.tree if key != "labpipe"}
    document.problems |= other.problems
    for key in tables.keys() - known:
        document.report((LABORATORY, key), f"unknown key{suggest(key, known)}")
    return tables | {"folder": path.parent.resolve()}


def _with_laboratory(
    document: Document,
    kinds: Mapping[str, type[msgspec.Struct]],
    laboratory: Mapping[str, Any],
    layers: Mapping[Place, dict[str, Any]],
) -> dict[Place, dict[str, Any]]:
    """Put below the tables of an experiment those of the laboratory's file, of its kind and of the parts it names."""
    kind = str(list(layers)[-1][1])
    made: dict[Place, dict[str, Any]] = {}
    lowest: dict[Place, dict[str, Any]] = {(LABORATORY, "defaults", kind): laboratory.get("defaults", {}).get(kind, {})}
    for place, table in (*layers.items(), *lowest.items()):
        own, parts = dict(table), dict[Place, dict[str, Any]]()
        for info in fields_of(kinds[kind]):
            key = info.encode_name
            value = own.get(key)
            name = value.get("from") if isinstance(value, dict) else value
            if not isinstance(name, str) or _table_type(info.type) is None:
                continue
            if name not in laboratory.get(key, {}):
                known = laboratory.get(key, {})
                where = suggest(name, known) or f"; name a table [{key}.NAME] of {LABORATORY}, or write a table"
                document.report((*place, key), f'there is no {key} "{name}"{where}')
                return {}
            own[key] = {k: v for k, v in value.items() if k != "from"} if isinstance(value, dict) else {}
            parts[LABORATORY, key, name] = {key: laboratory[key][name]}
        made |= {place: own} | parts
    return made


def _places(document: Document, tables: Mapping[str, Any], variants: Mapping[str, Any]) -> dict[str, Place]:
    """Return where each experiment is written, and after it its variants."""
    places: dict[str, Place] = {}
    for name in tables:
        places[name] = ("experiments", name)
        places |= {one: ("variants", one) for one, table in variants.items() if table.get("base") == name}
    places |= {name: ("variants", name) for name in variants if name not in places}
    for name in variants.keys() & tables.keys():
        document.report(("variants", name), "an experiment has this name; give the variant another one")
    return places


def _layers(
    document: Document,
    kinds: Mapping[str, type[msgspec.Struct]],
    defaults: Mapping[str, dict[str, Any]],
    tables: Mapping[str, dict[str, Any]],
    variant: dict[str, Any] | None,
    place: Place,
) -> dict[Place, dict[str, Any]]:
    """Return the tables that an experiment is made of, the uppermost first; none where its base or kind is a mistake.

    Without a base it is its own table over the defaults of its kind.
    """
    layers, name = dict[Place, dict[str, Any]](), str(place[1])
    if place[0] == "variants" and variant is not None:
        base = variant.get("base")
        if not isinstance(base, str) or base not in tables:
            problem = "missing" if base is None else f"there is no experiment {found(base)}"
            document.report((*place, "base"), f"{problem}{suggest(str(base), tables) or '; name an experiment'}")
            return {}
        layers[place] = {key: value for key, value in variant.items() if key not in ("base", "kind")}
        if "kind" in variant:
            document.report((*place, "kind"), f"a variant is of the kind of its base, {base}; delete this line")
        name = base
    layers["experiments", name] = tables[name]
    kind = tables[name].get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        known = ", ".join(sorted(kinds))
        text = f"unknown kind {found(kind)}{suggest(str(kind), kinds)}"
        document.report(("experiments", name, "kind"), text if kind is not None else f"missing; known kinds: {known}")
        return {}
    return {**layers, ("defaults", kind): defaults.get(kind, {})}


def _changed(base: msgspec.Struct, own: msgspec.Struct) -> dict[str, tuple[str, str]]:
    """Return the settings in which two of one kind differ, with both values in words; notes do not count."""
    old, new = (
        {
            place: show(value) if isinstance(value, Quantity) else str(value).removeprefix(REFERENCE)
            for place, value, _ in every_setting(settings)
            if not (isinstance(value, msgspec.Struct | list | None) or place.startswith("notes"))
        }
        for settings in (base, own)
    )
    places = (place for place in dict.fromkeys((*new, *old)) if old.get(place) != new.get(place))
    return {place: (old.get(place, "none"), new.get(place, "none")) for place in places}


def _check_names(document: Document, root: Path, places: Mapping[str, Place]) -> None:
    """Report names of experiments that cannot be names of files, or that a disk may take for one."""
    alike: dict[str, list[str]] = {}
    for name in places:  # two names that a Macintosh or Windows disk keeps in one file are one
        alike.setdefault(unicodedata.normalize("NFC", name).casefold(), []).append(name)
    for name in places:
        problem = "it begins with a full stop" if name.startswith(".") else ""
        problem = "it contains /" if "/" in name else problem
        try:
            safe_join(root, name)
        except InputError as error:
            problem = str(error).rpartition(": ")[2]
        if len(name.encode("utf-8", "replace")) > _LONGEST_NAME:
            problem = f"it is longer than {_LONGEST_NAME} bytes"
        if problem:
            document.report(places[name], f"cannot be the name of an experiment: {problem}")
    for twins in alike.values():
        for name in twins if len(twins) > 1 else ():
            other = next(twin for twin in twins if twin != name)
            document.report(places[name], f'differs from "{other}" only in case; rename one')


def _experiment(
    document: Document,
    root: Path,
    kinds: Mapping[str, type[msgspec.Struct]],
    layers: Mapping[Place, dict[str, Any]],
    names: Collection[str],
    may_wait: bool,
    gaps: list[str],
    laboratory: Path | None,
) -> Experiment | None:
    """Lay the tables of an experiment over each other and convert the result; report mistakes and gaps."""
    place, *below = layers
    kind = str(below[-1][-1])  # the defaults of its kind are the lowest
    has_field = any(f.encode_name == "kind" for f in msgspec.structs.fields(kinds[kind]))
    tops = {low: (*place, low[1]) if low[0] == LABORATORY and low[1] != "defaults" else place for low in below}
    checker = Checker(document, root, tuple((top, low) for low, top in tops.items()), may_wait, gaps, laboratory)
    merged: dict[str, Any] = {}
    for table in layers.values():
        merged = _overlaid(merged, table, kinds[kind])
    name = next(str(low[1]) for low in layers if low[0] == "experiments")
    merged = {key: _named(value, name) for key, value in merged.items() if key != "kind" or has_field}
    settings = checker.structure(kinds[kind], merged, place)
    try:
        settings = without_excluded(settings) if isinstance(settings, msgspec.Struct) else settings
    except InputError as error:
        settings = checker.report((*place, EXCLUDE, int(error.reason)), str(error))
    is_whole = isinstance(settings, msgspec.Struct)
    name = str(place[1])
    # Without typed settings, the texts that carry the prefix can still be checked.
    _check_references(checker, name, names, msgspec.to_builtins(settings) if is_whole else merged, place)
    tops[place] = place
    ends = {(*top, *at[len(low) :]) for low, top in tops.items() for at in document.lines if at[: len(low)] == low}
    # a value of the laboratory's file belongs to the line that refers to it
    lines = {
        dotted(at[2:]): document.line(at if checker.written(at)[:1] == (LABORATORY,) else checker.written(at))
        for at in ends
    }
    return Experiment(name, kind, settings, lines, overrides=_overrides(checker, layers, place)) if is_whole else None


def _overrides(checker: Checker, layers: Mapping[Place, dict[str, Any]], place: Place) -> dict[str, tuple[str, str]]:
    """Return the values of the laboratory's file that the session states otherwise, each with both, as written."""
    found: dict[str, tuple[str, str]] = {}

    def values(node: Any, at: Place) -> Iterator[tuple[Place, Any]]:
        for key, child in children(node):
            yield from values(child, (*at, key)) if isinstance(child, dict) else [((*at, key), child)]

    for low, table in layers.items():
        for at, value in values(table, place) if low[0] == LABORATORY else ():
            written = checker.written(at)
            if written[0] != LABORATORY:
                own: Any = checker.document.tree
                for key in written:
                    own = own[key]
                if own != value and not isinstance(own, list):
                    found.setdefault(dotted(at[2:]), (str(value), str(own)))
    return found


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


def _overlaid(own: Any, below: Any, kind: Any = None) -> Any:
    """Lay a table over another one, and so the tables within.

    Of settings that exclude each other, ``alternatives`` of their structure, those of the upper table count.
    """
    if not (isinstance(own, dict) and isinstance(below, dict)):
        return own
    types = {info.encode_name: info.type for info in fields_of(kind)} if kind is not None else {}
    upper = {
        key: _overlaid(value, below[key], _table_type(types.get(key))) if key in below else value
        for key, value in own.items()
    }
    hidden = {key for group in getattr(kind, "alternatives", ()) if own.keys() & set(group) for key in group}
    return upper | {key: value for key, value in below.items() if key not in own and key not in hidden}


def _named(node: Any, name: str) -> Any:
    """Put the name of an experiment into the texts of its settings that leave a place for it."""
    if isinstance(node, str):
        return node.replace(NAME, name)
    if isinstance(node, dict):
        return {key: _named(child, name) for key, child in node.items()}
    return [_named(child, name) for child in node] if isinstance(node, list) else node


def _table_type(declared: Any) -> type[msgspec.Struct] | None:
    """Return the structure of a field that is a table."""
    options = [bare for bare, _ in options_of(declared)]
    return next((one for one in options if isinstance(one, type) and issubclass(one, msgspec.Struct)), None)

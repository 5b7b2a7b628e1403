"""The check of a TOML file against the structure of its settings, which lays tables over each other on its way.

A settings structure is a frozen ``msgspec.Struct``; a dimensional field is declared by the type of
its quantity, and the user writes ``"9.525 mm"`` or ``"12.0 ± 0.2 deg"``:

>>> import msgspec
>>> from typing import Annotated
>>> class Sphere(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
...     radius: Annotated[Length, POSITIVE]
...     mass: Annotated[Mass, POSITIVE] | None = None

All mistakes of a file are reported together, each with its line. Fields that name files are of
type :data:`File`; such a file must exist inside the folder of the configuration.
"""

import contextlib
import math
import re
import types
import typing
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar, Union

import msgspec

from labpipe.errors import InputError, LabpipeError
from labpipe.files import files_below, relative, safe_join
from labpipe.units import Quantity, quantity
from labpipe.workflow.document import LABORATORY, Document, Place, dotted, parse, placed
from labpipe.workflow.fields import (
    GAP,
    REFERENCE,
    Dimension,
    FileMark,
    Range,
    ReferenceMark,
    describe,
    fields_of,
    found,
    is_gap,
    is_table,
    mark,
    options_of,
    show,
    split,
    suggest,
    tables_of,
)

S = TypeVar("S", bound=msgspec.Struct)
Layer = tuple[Place, Any]
"""A table, or a value of one, and where it was written."""
_BAD = object()
"""Stands for a value whose mistake has been reported."""


def read(path: Path, kind: type[S]) -> S:
    """Read a whole TOML file as one structure, such as a calibration record.

    Raises SourceError, and ConfigError with every mistake and its line.
    """
    document = parse(path)
    value = Checker(document, path.parent).structure(kind, document.tree, ())
    document.finish()
    return typing.cast(S, value)


@dataclass(slots=True)
class Checker:
    """Converts values to the types of their fields and reports mistakes.

    ``may_wait`` takes names of files that are not there yet; ``may_fill`` says of a value that is still to come so, and
    no more. ``laboratory`` is the folder of the laboratory's file, from which the files that it names are found, and
    ``parts`` are tables that a value may name instead, as ``sphere = "A3"``. ``names`` are the experiments that one of
    them, ``own``, may refer to; ``base`` takes the place of ``{name}`` in texts. In ``settings`` the place of every
    value is found, and in ``overrides`` those of the laboratory's file that the session changes, with both values.
    """

    document: Document
    root: Path
    may_wait: bool = False
    may_fill: bool = False
    laboratory: Path | None = None
    parts: Mapping[Place, dict[str, Any]] = field(default_factory=dict)
    names: Collection[str] | None = None
    own: str = ""
    base: str = ""
    settings: list[Place] = field(default_factory=list)
    overrides: dict[str, tuple[str, str]] = field(default_factory=dict)

    def report(self, place: Place, message: str) -> Any:
        """Report at the place in the file where a value was written; return the mark of no value."""
        self.document.report(place, message)
        return _BAD

    def structure(self, kind: type[msgspec.Struct], value: Any, place: Place, below: Sequence[Layer] = ()) -> Any:
        """Convert a table, laid over those ``below`` it, the uppermost first."""
        if not isinstance(value, dict):
            return self.report(place, f"expected a table, found {found(value)}")
        fields = {f.encode_name: f for f in fields_of(kind)}
        held = self._laid(kind, fields, value, place, below)
        for key in held.keys() - fields.keys():
            self.report((*place, key), f"unknown key{suggest(key, fields)}")
        converted = {}
        for name, info in fields.items():
            if name in held:
                (_, own), *lower = held[name]
                converted[info.name] = self.value(info.type, own, (*place, name), lower)
            elif info.required:
                converted[info.name] = self.report((*place, name), f"missing; expected {describe(info.type)}")
        if any(item is _BAD for item in converted.values()):
            return _BAD
        try:
            return kind(**converted)
        except (ValueError, TypeError) as error:  # raised by the structure's own __post_init__
            return self.report(place, str(error))

    def _laid(
        self, kind: Any, fields: Mapping[str, Any], value: dict[str, Any], place: Place, below: Sequence[Layer]
    ) -> dict[str, list[Layer]]:
        """Gather by key what tables over each other hold; of ``alternatives`` those of the uppermost table count."""
        held: dict[str, list[Layer]] = {}
        for at, table in ((self.document.written(place), value), *below):
            hidden = {k for group in getattr(kind, "alternatives", ()) if held.keys() & set(group) for k in group}
            for key, own in table.items():
                if key in held or key not in hidden:
                    held.setdefault(key, []).extend(self._with_part(fields.get(key), (*at, key), own))
        for key, ((at, own), *lower) in held.items():
            self.document.origin[*place, key] = at
            of_laboratory = next((one for there, one in lower if there[0] == LABORATORY != at[0]), own)
            if of_laboratory != own and not isinstance(own, dict | list):
                self.overrides[dotted((*place, key)[2:])] = str(of_laboratory), str(own)
        return held

    def _with_part(self, info: Any, at: Place, value: Any) -> list[Layer]:
        """Return a value, or the table of the laboratory's file that it names, below what it changes of it."""
        name = value.get("from") if isinstance(value, dict) else value
        kinds = [kind for kind, _ in options_of(info.type)] if info is not None and self.parts else []
        if not isinstance(name, str) or not any(map(is_table, kinds)):
            return [(at, value)]
        part: Place = (LABORATORY, at[-1], name)
        if part in self.parts:
            changed = {k: v for k, v in value.items() if k != "from"} if isinstance(value, dict) else {}
            return [(at, changed), (part, self.parts[part])]
        if all(map(is_table, kinds)):
            near = suggest(name, (str(one[2]) for one in self.parts if one[:2] == part[:2]))
            near = near or f"; name a table [{at[-1]}.NAME] of {LABORATORY}, or write a table"
            value = self.report(at, f'there is no {at[-1]} "{name}"{near}')
        return [(at, value)]

    def value(self, kind: Any, value: Any, place: Place, below: Sequence[Layer] = ()) -> Any:
        """Convert one value to the type of its field."""
        if value is _BAD:
            return _BAD
        self.settings.append(place)
        if self.may_fill and is_gap(value):
            return self.report(place, f"to be filled in: {describe(kind)}")
        if isinstance(value, str) and self.base:
            value = value.replace("{name}", self.base)
        bare, _ = split(kind)
        if typing.get_origin(bare) in (Union, types.UnionType):
            options = [option for option in typing.get_args(bare) if option is not type(None)]
            if isinstance(value, dict) and len(tables := tables_of(bare)) == 1:
                options = list(tables)
            if len(options) == 1:
                return self.value(options[0], value, place, below)
            for option in options:
                trial = replace(self, document=Document(self.document.path, {}, {(): 1}))
                converted = trial.value(option, value, place)
                if not trial.document.problems:
                    return converted
            return self.report(place, f"expected {' or '.join(map(describe, options))}, found {found(value)}")
        if is_table(bare):
            return self.structure(bare, value, place, [one for one in below if isinstance(one[1], dict)])
        try:
            if typing.get_origin(bare) is dict:
                return self._table(bare, value, place, below)
            if typing.get_origin(bare) in (list, tuple):
                return self._list(kind, value, place)
            return self._single(kind, value, place)
        except InputError as error:
            return self.report(place, str(error))

    def _single(self, kind: Any, value: Any, place: Place) -> Any:
        """Convert a value that holds no others; raise InputError with its mistake."""
        bare, marks = split(kind)
        if mark(marks, FileMark) is not None:
            return self._file(value, place)
        if mark(marks, ReferenceMark) is not None and isinstance(value, str):
            name = value.removeprefix(REFERENCE)
            if self.names is not None and name == self.own:
                raise InputError("an experiment cannot refer to itself")
            if self.names is not None and name not in self.names:
                near = suggest(name, (other for other in self.names if other != self.own))
                raise InputError(f'there is no experiment "{name}"{near}')
            return REFERENCE + name
        if (dimension := mark(marks, Dimension)) is not None:
            converted: Any = _quantity(dimension, value)
            number, unit, shown = converted.value, f" {dimension.si}".removesuffix(" 1"), show(converted)
        else:
            converted = number = shown = _plain(kind, bare, value)
            unit = ""
        bounds = mark(marks, Range)
        if bounds is not None and not bounds.holds(number):
            raise InputError(f"must be {bounds}{unit}, found {shown}")
        return converted

    def _table(self, kind: Any, value: Any, place: Place, below: Sequence[Layer]) -> Any:
        """Convert a table whose keys are names."""
        if not isinstance(value, dict):
            raise InputError(f"expected a table, found {found(value)}")
        held = self._laid(None, {}, value, place, [one for one in below if isinstance(one[1], dict)])
        of = typing.get_args(kind)[1]
        pairs = {key: self.value(of, own, (*place, key), lower) for key, ((_, own), *lower) in held.items()}
        return _BAD if any(v is _BAD for v in pairs.values()) else pairs

    def _list(self, kind: Any, value: Any, place: Place) -> Any:
        """Convert a list; one of files may be a pattern of their names."""
        bare, marks = split(kind)
        arguments = typing.get_args(bare)
        inner, inner_marks = split(arguments[0])
        is_of_files = mark(inner_marks, FileMark) is not None
        is_nested = typing.get_origin(inner) in (list, tuple)
        if is_of_files and isinstance(value, str) and set(value) & set("*?["):
            value = self._matching(value)
        if not isinstance(value, list):
            example = f"; write [{found(value)}]" if isinstance(value, str) and not is_nested else ""
            raise InputError(f"expected {describe(kind)}, found {found(value)}{example}")
        if is_nested and value and not any(isinstance(item, list) for item in value):
            raise InputError(f"expected {describe(kind)}, found {str(value)[:60]}: brackets are missing")
        is_fixed = typing.get_origin(bare) is tuple and arguments[-1] is not Ellipsis
        if is_fixed and len(value) != len(arguments):
            raise InputError(f"expected {len(arguments)} items, found {len(value)}")
        of = arguments if is_fixed else (arguments[0],) * len(value)
        items = [self.value(t, v, (*place, i)) for i, (t, v) in enumerate(zip(of, value, strict=True))]
        for i, name in enumerate(value if is_of_files else ()):
            if name in value[:i]:
                items[i] = self.report((*place, i), f'"{name}" is listed twice; remove one')
        if any(item is _BAD for item in items):
            return _BAD
        least = getattr(mark(marks, msgspec.Meta), "min_length", None) or 0
        if len(items) < least:  # after its items, which may be still to come
            raise InputError(f"expected at least {least} item{'s' * (least != 1)}, found {len(items)}")
        return tuple(items) if typing.get_origin(bare) is tuple else items

    def _matching(self, pattern: str) -> list[str]:
        """Return the files of the session that fit a pattern, in the order of their numbers; the pattern for none."""
        names = [] if ".." in Path(pattern).parts or Path(pattern).is_absolute() else self.root.glob(pattern)

        def by_number(name: str) -> list[tuple[int, str]]:
            return [(int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d+)", name)]

        return sorted((path.relative_to(self.root).as_posix() for path in names), key=by_number) or [pattern]

    def _file(self, value: Any, place: Place) -> str:
        if not isinstance(value, str):
            raise InputError(f"expected the name of a file, found {found(value)}")
        is_of_laboratory = not isinstance(place[-1], int) and self.document.written(place)[:1] == (LABORATORY,)
        path = safe_join((is_of_laboratory and self.laboratory) or self.root, value)
        if is_of_laboratory and path.exists():
            return relative(path, self.root)
        if not path.exists() and not self.may_wait:
            # files that a user may have meant; labpipe's own folder is not among them
            names = (f.relative_to(self.root).as_posix() for f in files_below(self.root))
            near = suggest(value, [name for name in names if not name.startswith("labpipe/")])
            raise InputError(
                f'there is no file "{value}" in the session folder{near or "; copy it there, or correct the name"}'
            )
        with contextlib.suppress(OSError, LabpipeError):  # a record that cannot be read is refused later
            if self.may_fill and value.endswith(".toml") and GAP.encode() in path.read_bytes():
                record = parse(path)
                for at, node in placed(record.tree):
                    if is_gap(node):
                        text = f"{value}:{record.line(at)}: {at[-1]}: to be filled in"
                        self.document.problems[text] = self.document.line(place)
        return value


def _quantity(dimension: Dimension, value: Any) -> Quantity:
    expected = describe(dimension)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and dimension.si == "1":
        return Quantity(float(value), 0.0, "1")
    if not isinstance(value, str):
        raise InputError(f"expected {expected}, found {found(value)}{' without a unit' * is_number}")
    try:
        parsed = quantity(value)
    except InputError as error:
        raise InputError(f'expected {expected}, found "{value}"{f": {error}" if "," in value else ""}') from None
    if parsed.si != dimension.si:
        which = "has no unit" if parsed.si == "1" else f"is in {parsed.si}"
        raise InputError(f'expected {expected}, found "{value}", which {which}')
    if not (math.isfinite(parsed.value) and math.isfinite(parsed.u)):
        raise InputError(f'expected a finite number, found "{value}"')
    return parsed


def _plain(kind: Any, bare: Any, value: Any) -> Any:
    if typing.get_origin(bare) is Literal and value not in (known := typing.get_args(bare)):
        if isinstance(value, str) and value.lower() in known:
            return value.lower()
        raise InputError(f"expected {describe(bare)}, found {found(value)}{suggest(str(value), map(str, known))}")
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        # msgspec says "Expected `int` >= 1" for a bound, and names its own types otherwise
        bound = str(error).removeprefix("Expected ").replace("`", "")
        is_bound = bound != str(error) and ", got" not in bound
        bound = "a text that is not empty" if bound.startswith("str ") else bound
        raise InputError(f"expected {bound if is_bound else describe(bare)}, found {found(value)}") from None

"""The check of a TOML file against the structure of its settings, which lays tables over each other on its way.

A settings structure is a frozen ``msgspec.Struct``; a dimensional field is declared by the type of
its quantity, and the user writes ``"9.525 mm"`` or ``"12.0 ± 0.2 deg"``:

>>> from typing import Annotated
>>> from labpipe.workflow.fields import POSITIVE, Length, Mass
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
from labpipe.workflow import fields
from labpipe.workflow.document import LABORATORY, Document, Place, dotted, parse, placed
from labpipe.workflow.fields import describe, found, is_gap, is_table, mark, split, suggest

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
    value = Checker(document, path.parent).value(kind, document.tree, ())
    document.finish()
    return typing.cast(S, value)


@dataclass(slots=True)
class Checker:
    """Converts values to the types of their fields and reports mistakes.

    ``may_wait`` takes names of files that are not there yet; ``may_fill`` says of a value that is still to come so, and
    no more. ``laboratory`` is the folder of the laboratory's file, from which the files that it names are found, and
    ``parts`` are tables that a value may name instead, as ``sphere = "A3"``. ``names`` are the experiments that one of
    them, ``own``, may refer to; ``base`` takes the place of ``{name}`` in texts. ``lines`` holds the line of the
    session's file for every value, and ``overrides`` those that differ from the laboratory's, with both values.
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
    lines: dict[Place, int] = field(default_factory=dict)
    overrides: dict[str, tuple[str, str]] = field(default_factory=dict)

    def report(self, place: Place, message: str) -> Any:
        """Report a mistake; return the mark of no value."""
        self.document.report(place, message)
        return _BAD

    def value(self, kind: Any, value: Any, place: Place, below: Sequence[Layer] = (), name: Place = ()) -> Any:
        """Convert a value to the type of its field; a table is laid over those ``below`` it, the uppermost first.

        ``place`` is where it was written, ``name`` that of the setting.
        """
        if value is _BAD:
            return _BAD
        # a value of the laboratory's file belongs to the line that refers to it
        is_own = place[:1] != (LABORATORY,)
        self.lines[name] = self.document.line(place) if is_own else self.lines.get(name[:-1], 1)
        if self.may_fill and is_gap(value):
            return self.report(place, f"to be filled in: {describe(kind)}")
        if isinstance(value, str) and self.base:
            value = value.replace("{name}", self.base)
        bare, _ = split(kind)
        try:
            if typing.get_origin(bare) in (Union, types.UnionType):  # the first of several types that takes a value
                if isinstance(value, dict) and len(tables := fields.tables_of(bare)) == 1:
                    return self._structure(tables[0], value, place, below, name)
                options = [option for option in typing.get_args(bare) if option is not type(None)]
                for option in options:
                    trial = replace(self, document=replace(self.document, problems={}))
                    converted = trial.value(option, value, place, below, name)
                    if not trial.document.problems:
                        return converted
                raise InputError(f"expected {' or '.join(map(describe, options))}, found {found(value)}")
            if is_table(bare):
                return self._structure(bare, value, place, below, name)
            if typing.get_origin(bare) in (list, tuple, dict):
                return self._collection(kind, value, place, name)
            return self._single(kind, value, place)
        except ValueError as error:  # InputError, or what a structure's own __post_init__ raised
            field, mark, text = str(error).partition(": ")
            of_field = bool(mark) and isinstance(value, dict) and field in value  # then its line is the one to correct
            return self.report((*place, field), text) if of_field else self.report(place, str(error))

    def _structure(self, kind: Any, value: Any, place: Place, below: Sequence[Layer], name: Place) -> Any:
        """Convert a table, and report its unknown and missing keys."""
        if not isinstance(value, dict):
            raise InputError(f"expected a table, found {found(value)}")
        known = {f.encode_name: f for f in fields.fields_of(kind)}
        held: dict[str, list[Layer]] = {}
        for at, table in ((place, value), *below):
            # of settings that exclude each other those of the uppermost table count
            hidden = {k for group in getattr(kind, "alternatives", ()) if held.keys() & set(group) for k in group}
            for key, own in table.items() if isinstance(table, dict) else ():
                if key in held or key not in hidden:
                    held.setdefault(key, []).extend(self._with_part(known.get(key), (*at, key), own))
        for key, ((at, own), *lower) in held.items():
            if key not in known:
                self.report(at, f"unknown key{suggest(key, known)}")
            of_laboratory = next((one for there, one in lower if there[0] == LABORATORY != at[0]), own)
            if of_laboratory != own and not isinstance(own, dict | list):
                self.overrides[dotted((*name, key))] = str(of_laboratory), str(own)
        converted = {}
        for key, info in known.items():
            if key in held:
                (at, own), *lower = held[key]
                converted[info.name] = self.value(info.type, own, at, lower, (*name, key))
            elif info.required:
                converted[info.name] = self.report((*place, key), f"missing; expected {describe(info.type)}")
        return _BAD if any(item is _BAD for item in converted.values()) else kind(**converted)

    def _with_part(self, info: Any, at: Place, value: Any) -> list[Layer]:
        """Return a value; of one that names a table of the laboratory's file, its changes to that, and the table."""
        name = value.get("from") if isinstance(value, dict) else value
        kinds = [kind for kind, _ in fields.options_of(info.type)] if info is not None and self.parts else []
        if not isinstance(name, str) or not any(map(is_table, kinds)):
            return [(at, value)]
        part: Place = (LABORATORY, at[-1], name)
        if part in self.parts:
            changed = {k: v for k, v in value.items() if k != "from"} if isinstance(value, dict) else {}
            return [(at, changed), (part, self.parts[part])]
        if isinstance(value, dict) or not any(kind is str or typing.get_origin(kind) is Literal for kind in kinds):
            near = suggest(name, (str(one[2]) for one in self.parts if one[:2] == part[:2]))
            near = near or f"; name a table [{at[-1]}.NAME] of {LABORATORY}, or write a table"
            value = self.report(at, f'there is no {at[-1]} "{name}"{near}')
        return [(at, value)]

    def _collection(self, kind: Any, value: Any, place: Place, name: Place) -> Any:
        """Convert a list, of which one of files may be a pattern of their names, or a table whose keys are names."""
        bare, _ = split(kind)
        origin, arguments = typing.get_origin(bare), typing.get_args(bare)
        if origin is dict:
            if not isinstance(value, dict):
                raise InputError(f"expected a table, found {found(value)}")
            pairs = {k: self.value(arguments[1], v, (*place, k), (), (*name, k)) for k, v in value.items()}
            return _BAD if any(own is _BAD for own in pairs.values()) else pairs
        is_of_files = mark(arguments[0], fields.FileMark) is not None
        if is_of_files and isinstance(value, str) and set(value) & set("*?["):
            is_below = ".." not in Path(value).parts and not Path(value).is_absolute()
            names = [path.relative_to(self.root).as_posix() for path in self.root.glob(value)] if is_below else []
            parts = {name: re.split(r"(\d+)", name) for name in names}  # in the order of their numbers
            names.sort(key=lambda n: [(int(p) if p.isdigit() else 0, p) for p in parts[n]])
            value = names or [value]
        if not isinstance(value, list):
            is_nested = typing.get_origin(split(arguments[0])[0]) in (list, tuple)
            example = f"; write [{found(value)}]" if isinstance(value, str) and not is_nested else ""
            raise InputError(f"expected {describe(kind)}, found {found(value)}{example}")
        is_fixed = origin is tuple and arguments[-1] is not Ellipsis
        if is_fixed and len(value) != len(arguments):
            raise InputError(f"expected {len(arguments)} items, found {len(value)}")
        of = arguments if is_fixed else (arguments[0],) * len(value)
        places = [((*place, i), (), (*name, i)) for i in range(len(value))]
        items = [self.value(t, v, *at) for t, v, at in zip(of, value, places, strict=True)]
        for i, file in enumerate(value if is_of_files else ()):
            if file in value[:i]:
                items[i] = self.report((*place, i), f'"{file}" is listed twice; remove one')
        if any(item is _BAD for item in items):
            return _BAD
        least = getattr(mark(kind, msgspec.Meta), "min_length", None) or 0
        if len(items) < least:  # after its items, which may be still to come
            raise InputError(f"expected at least {least} item{'s' * (least != 1)}, found {len(items)}")
        return tuple(items) if origin is tuple else items

    def _single(self, kind: Any, value: Any, place: Place) -> Any:
        """Convert a value that holds no others."""
        if mark(kind, fields.FileMark) is not None:
            return self._file(value, place)
        if mark(kind, fields.ReferenceMark) is not None and isinstance(value, str):
            name = value.removeprefix(fields.REFERENCE)
            if self.names is not None and name == self.own:
                raise InputError("an experiment cannot refer to itself")
            if self.names is not None and name not in self.names:
                near = suggest(name, (other for other in self.names if other != self.own))
                raise InputError(f'there is no experiment "{name}"{near}')
            return fields.REFERENCE + name
        dimension, bounds = mark(kind, fields.Dimension), mark(kind, fields.Range)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if dimension is not None and is_number and dimension.si == "1":
            converted: Any = Quantity(float(value), 0.0, "1")
        elif dimension is not None:
            why = " without a unit" if is_number else ""
            try:
                converted = quantity(value) if isinstance(value, str) else None
            except InputError as error:
                converted, why = None, f": {error}" if "," in value else ""
            if converted is not None and converted.si != dimension.si:
                why = f", which {'has no unit' if converted.si == '1' else f'is in {converted.si}'}"
            elif converted is not None and not math.isfinite(converted.value + converted.u):
                why = ", which is not finite"
            if converted is None or why:
                raise InputError(f"expected {describe(kind)}, found {found(value)}{why}")
        else:
            bare, _ = split(kind)
            known = typing.get_args(bare) if typing.get_origin(bare) is Literal else ()
            try:
                is_word = isinstance(value, str) and value.lower() in known
                converted = msgspec.convert(value.lower() if is_word else value, kind)
            except msgspec.ValidationError:
                near = suggest(str(value), map(str, known))
                raise InputError(f"expected {describe(kind)}, found {found(value)}{near}") from None
        number = converted.value if isinstance(converted, Quantity) else converted
        if bounds is not None and not bounds.holds(number):
            unit = f" {dimension.si}" if dimension is not None and dimension.si != "1" else ""
            raise InputError(f"must be {bounds}{unit}, found {converted}")
        return converted

    def _file(self, value: Any, place: Place) -> str:
        if not isinstance(value, str):
            raise InputError(f"expected the name of a file, found {found(value)}")
        is_of_laboratory = not isinstance(place[-1], int) and place[0] == LABORATORY
        path = safe_join((is_of_laboratory and self.laboratory) or self.root, value)
        if is_of_laboratory and path.exists():
            return relative(path, self.root)
        if not path.exists() and not self.may_wait:
            # files that a user may have meant; labpipe's own folder is not among them
            names = (f.relative_to(self.root).as_posix() for f in files_below(self.root))
            near = suggest(value, [name for name in names if not name.startswith("labpipe/")])
            advice = near or "; copy it there, or correct the name"
            raise InputError(f'there is no file "{value}" in the session folder{advice}')
        with contextlib.suppress(OSError, LabpipeError):  # a record that cannot be read is refused later
            if self.may_fill and value.endswith(".toml") and fields.GAP.encode() in path.read_bytes():
                record = parse(path)
                for at, node in placed(record.tree):
                    if is_gap(node):
                        text = f"{value}:{record.line(at)}: {at[-1]}: to be filled in"
                        self.document.problems[text] = self.document.line(place)
        return value

"""The check of a TOML file against the structure of its settings.

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
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar, Union

import msgspec

from labpipe.errors import InputError
from labpipe.files import files_below, relative, safe_join
from labpipe.units import Quantity, quantity
from labpipe.workflow.document import LABORATORY, LARGEST_FILE, Document, Place, parse
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
    mark,
    show,
    split,
    suggest,
    tables_of,
)

S = TypeVar("S", bound=msgspec.Struct)
_GAP_LINE = re.compile(rf'^\s*(\w+)\s*=\s*"{GAP}(?: [^"]*)?"')
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

    ``may_wait`` takes names of files that are not there yet. In ``gaps`` values that are still to come stand with their
    lines, and are no mistakes. ``laboratory`` is the folder of the laboratory's file, from which the files that it
    names are found. ``names`` are the experiments that one of them, ``own``, may refer to.
    """

    document: Document
    root: Path
    may_wait: bool = False
    gaps: dict[str, int] | None = None
    laboratory: Path | None = None
    names: Collection[str] | None = None
    own: str = ""

    def report(self, place: Place, message: str) -> Any:
        """Report at the place in the file where a value was written; return the mark of no value."""
        self.document.report(place, message)
        return _BAD

    def structure(self, kind: type[msgspec.Struct], value: Any, place: Place) -> Any:
        """Convert a table."""
        if not isinstance(value, dict):
            return self.report(place, f"expected a table, found {found(value)}")
        fields = {f.encode_name: f for f in fields_of(kind)}
        for key in value.keys() - fields.keys():
            self.report((*place, key), f"unknown key{suggest(key, fields)}")
        converted = {}
        for name, info in fields.items():
            if name in value:
                converted[info.name] = self.value(info.type, value[name], (*place, name))
            elif info.required:
                converted[info.name] = self.report((*place, name), f"missing; expected {describe(info.type)}")
        if any(item is _BAD for item in converted.values()):
            return _BAD
        try:
            return kind(**converted)
        except (ValueError, TypeError) as error:  # raised by the structure's own __post_init__
            return self.report(place, str(error))

    def value(self, kind: Any, value: Any, place: Place) -> Any:
        """Convert one value to the type of its field."""
        if self.gaps is not None and is_gap(value):
            self.gaps[self.document.at(place, f"to be filled in: {describe(kind)}")] = self.document.line(place)
            return _BAD
        bare, _ = split(kind)
        if typing.get_origin(bare) in (Union, types.UnionType):
            options = [option for option in typing.get_args(bare) if option is not type(None)]
            if isinstance(value, dict) and len(tables := tables_of(bare)) == 1:
                options = list(tables)
            if len(options) == 1:
                return self.value(options[0], value, place)
            for option in options:
                trial = replace(self, document=Document(self.document.path, {}, {(): 1}), gaps=None)
                converted = trial.value(option, value, place)
                if not trial.document.problems:
                    return converted
            return self.report(place, f"expected {' or '.join(map(describe, options))}, found {found(value)}")
        if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
            return self.structure(bare, value, place)
        if typing.get_origin(bare) in (list, tuple, dict):
            return self._collection(kind, value, place)
        try:
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

    def _collection(self, kind: Any, value: Any, place: Place) -> Any:
        bare, marks = split(kind)
        origin, arguments = typing.get_origin(bare), typing.get_args(bare)
        if origin is dict:
            if not isinstance(value, dict):
                return self.report(place, f"expected a table, found {found(value)}")
            pairs = {k: self.value(arguments[1], v, (*place, k)) for k, v in value.items()}
            return _BAD if any(v is _BAD for v in pairs.values()) else pairs
        inner, inner_marks = split(arguments[0])
        is_of_files = mark(inner_marks, FileMark) is not None
        is_nested = typing.get_origin(inner) in (list, tuple)
        if is_of_files and isinstance(value, str) and set(value) & set("*?["):
            value = self._matching(value)
        if not isinstance(value, list):
            example = f"; write [{found(value)}]" if isinstance(value, str) and not is_nested else ""
            return self.report(place, f"expected {describe(kind)}, found {found(value)}{example}")
        if is_nested and value and not any(isinstance(item, list) for item in value):
            return self.report(place, f"expected {describe(kind)}, found {str(value)[:60]}: brackets are missing")
        is_fixed = origin is tuple and arguments[-1] is not Ellipsis
        if is_fixed and len(value) != len(arguments):
            return self.report(place, f"expected {len(arguments)} items, found {len(value)}")
        of = arguments if is_fixed else (arguments[0],) * len(value)
        items = [self.value(t, v, (*place, i)) for i, (t, v) in enumerate(zip(of, value, strict=True))]
        for i, name in enumerate(value if is_of_files else ()):
            if name in value[:i]:
                items[i] = self.report((*place, i), f'"{name}" is listed twice; remove one')
        if any(item is _BAD for item in items):
            return _BAD
        least = getattr(mark(marks, msgspec.Meta), "min_length", None) or 0
        if len(items) < least:  # after its items, which may be still to come
            return self.report(place, f"expected at least {least} item{'s' * (least != 1)}, found {len(items)}")
        return tuple(items) if origin is tuple else items

    def _matching(self, pattern: str) -> list[str]:
        """Return the files of the session that fit a pattern, in the order of their numbers; the pattern for none."""
        names = [] if ".." in Path(pattern).parts or Path(pattern).is_absolute() else self.root.glob(pattern)

        def by_number(name: str) -> list[tuple[int, str]]:
            return [(int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d+)", name)]

        return sorted((path.relative_to(self.root).as_posix() for path in names), key=by_number) or [pattern]

    def _file(self, value: Any, place: Place) -> Any:
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
            advice = near or "; copy it there, or correct the name"
            raise InputError(f'there is no file "{value}" in the session folder{advice}')
        if self.gaps is not None and value.endswith(".toml"):
            with contextlib.suppress(OSError, UnicodeDecodeError):  # a record that cannot be read is refused later
                lines = path.read_text("utf-8").splitlines() if path.stat().st_size <= LARGEST_FILE else []
                for number, line in enumerate(lines, 1):
                    if (match := _GAP_LINE.match(line)) is not None:
                        self.gaps[f"{value}:{number}: {match[1]}: to be filled in"] = self.document.line(place)
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

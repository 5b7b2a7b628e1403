"""The types of configured fields, and the check of a TOML file against them.

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
from dataclasses import dataclass
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
    describe_dimension,
    fields_of,
    found,
    is_gap,
    mark,
    show,
    split,
    suggest,
)

S = TypeVar("S", bound=msgspec.Struct)


def read(path: Path, kind: type[S], root: Path | None = None, text: str | None = None) -> S:
    """Read a whole TOML file as one structure, such as a calibration record.

    Parameters
    ----------
    path : Path
        The file.
    kind : type
        The structure it must fit.
    root : Path, optional
        Folder of the files it names; default its own.
    text : str, optional
        Content that the file would have; by default it is read.

    Raises
    ------
    SourceError, ConfigError
        With every mistake and its line.
    """
    document = parse(path, text)
    value = Checker(document, root or path.parent).structure(kind, document.tree, ())
    document.finish()
    return typing.cast(S, value)


_BAD = object()
"""Stands for a value whose mistake has been reported."""


@dataclass(slots=True)
class Checker:
    """Converts values to the types of their fields and reports mistakes.

    ``below`` are pairs of places, of a table and of one whose values it takes where it has none, such as defaults;
    ``may_wait`` takes names of files that are not there yet. With a list ``gaps``, values that are still to come are
    listed there and are no mistakes; other mistakes are reported all the same. ``laboratory`` is the folder of the
    laboratory's file, from which the files that it names are found.
    """

    document: Document
    root: Path
    below: tuple[tuple[Place, Place], ...] = ()
    may_wait: bool = False
    gaps: list[str] | None = None
    laboratory: Path | None = None

    def report(self, place: Place, message: str) -> Any:
        """Report at the place in the file where a value was written; return the mark of no value."""
        self.document.report(self.written(place), message)
        return _BAD

    def written(self, place: Place) -> Place:
        """Return the place in the file of a value: its own, or that of the table it was taken from."""
        inside = len(place) - next((i for i, key in enumerate(place) if isinstance(key, int)), len(place))
        others = ((*low, *place[len(top) :]) for top, low in self.below if place[: len(top)] == top)
        # a list is taken as a whole: its items are where it is
        return next((at for at in (place, *others) if at[: len(at) - inside] in self.document.lines), place)

    def structure(self, kind: type[msgspec.Struct], value: Any, place: Place, partial: bool = False) -> Any:
        """Convert a table; with ``partial``, required fields may be missing."""
        if not isinstance(value, dict):
            return self.report(place, f"expected a table, found {found(value)}")
        fields = {f.encode_name: f for f in fields_of(kind)}
        for key in value.keys() - fields.keys():
            self.report((*place, key), f"unknown key{suggest(key, fields)}")
        converted = {}
        for name, info in fields.items():
            if name in value:
                converted[info.name] = self.value(info.type, value[name], (*place, name), partial)
            elif info.required and not partial:
                converted[info.name] = self.report((*place, name), f"missing; expected {describe(info.type)}")
        if partial or any(item is _BAD for item in converted.values()):
            return _BAD
        try:
            return kind(**converted)
        except (ValueError, TypeError) as error:  # raised by the structure's own __post_init__
            return self.report(place, str(error))

    def value(self, kind: Any, value: Any, place: Place, partial: bool = False) -> Any:
        """Convert one value to the type of its field."""
        bare, marks = split(kind)
        if self.gaps is not None and is_gap(value):
            self.gaps.append(self.document.at(self.written(place), f"to be filled in: {describe(kind)}"))
            return _BAD
        if typing.get_origin(bare) in (Union, types.UnionType):
            return self._union(bare, value, place, partial)
        dimension = mark(marks, Dimension)
        if dimension is not None:
            return self._in_range(marks, self._quantity(dimension, value, place), place)
        if mark(marks, FileMark) is not None:
            return self._file(value, place)
        if mark(marks, ReferenceMark) is not None and isinstance(value, str):
            return REFERENCE + value.removeprefix(REFERENCE)
        if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
            return self.structure(bare, value, place, partial)
        if typing.get_origin(bare) in (list, tuple, dict):
            return self._collection(kind, bare, marks, value, place, partial)
        return self._in_range(marks, self._plain(kind, bare, value, place), place)

    def _union(self, kind: Any, value: Any, place: Place, partial: bool) -> Any:
        options = [option for option in typing.get_args(kind) if option is not type(None)]
        if len(options) == 1:
            return self.value(options[0], value, place, partial)
        tables = [option for option in options if isinstance(option, type) and issubclass(option, msgspec.Struct)]
        if isinstance(value, dict) and len(tables) == 1:
            return self.structure(tables[0], value, place, partial)
        for option in options:
            trial = Checker(Document(self.document.path, {}, {(): 1}), self.root, may_wait=self.may_wait)
            converted = trial.value(option, value, place, partial)
            if not trial.document.problems:
                return converted
        return self.report(place, f"expected {' or '.join(map(describe, options))}, found {found(value)}")

    def _collection(self, kind: Any, bare: Any, marks: tuple[Any, ...], value: Any, place: Place, partial: bool) -> Any:
        arguments = typing.get_args(bare)
        if typing.get_origin(bare) is dict:
            if not isinstance(value, dict):
                return self.report(place, f"expected a table, found {found(value)}")
            pairs = {k: self.value(arguments[1], v, (*place, k), partial) for k, v in value.items()}
            return _BAD if any(v is _BAD for v in pairs.values()) else pairs
        if isinstance(value, str) and set(value) & set("*?[") and mark(split(arguments[0])[1], FileMark) is not None:
            value = self._matching(value)
        is_nested = typing.get_origin(split(arguments[0])[0]) in (list, tuple)
        if not isinstance(value, list):
            example = f"; write [{found(value)}]" if isinstance(value, str) and not is_nested else ""
            return self.report(place, f"expected {describe(kind)}, found {found(value)}{example}")
        if is_nested and value and not any(isinstance(item, list) for item in value):
            return self.report(place, f"expected {describe(kind)}, found {str(value)[:60]}: brackets are missing")
        is_fixed = typing.get_origin(bare) is tuple and arguments[-1] is not Ellipsis
        if is_fixed and len(value) != len(arguments):
            return self.report(place, f"expected {len(arguments)} items, found {len(value)}")
        of = arguments if is_fixed else (arguments[0],) * len(value)
        items = [self.value(t, v, (*place, i), partial) for i, (t, v) in enumerate(zip(of, value, strict=True))]
        if mark(split(arguments[0])[1], FileMark) is not None:
            for i, name in enumerate(value):
                if name in value[:i]:
                    self.report((*place, i), f'"{name}" is listed twice; remove one')
        if any(item is _BAD for item in items):
            return _BAD
        bounds = mark(marks, msgspec.Meta)
        least = (bounds.min_length if bounds is not None else None) or 0
        if len(items) < least:
            return self.report(place, f"expected at least {least} item{'s' * (least != 1)}, found {len(items)}")
        return tuple(items) if typing.get_origin(bare) is tuple else items

    def _quantity(self, dimension: Dimension, value: Any, place: Place) -> Any:
        expected = describe_dimension(dimension)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number and dimension.si == "1":
            return Quantity(float(value), 0.0, "1")
        if not isinstance(value, str):
            why = "without a unit" if is_number else ""
            return self.report(place, f"expected {expected}, found {found(value)} {why}".rstrip())
        try:
            parsed = quantity(value)
        except InputError as error:
            why = f": {error}" if "," in value else ""
            return self.report(place, f'expected {expected}, found "{value}"{why}')
        if parsed.si != dimension.si:
            which = "has no unit" if parsed.si == "1" else f"is in {parsed.si}"
            return self.report(place, f'expected {expected}, found "{value}", which {which}')
        if not (math.isfinite(parsed.value) and math.isfinite(parsed.u)):
            return self.report(place, f'expected a finite number, found "{value}"')
        return parsed

    def _in_range(self, marks: tuple[Any, ...], value: Any, place: Place) -> Any:
        bounds = mark(marks, Range)
        if bounds is None or value is _BAD:
            return value
        number = value.value if isinstance(value, Quantity) else value
        if bounds.holds(number):
            return value
        shown = show(value) if isinstance(value, Quantity) else value
        has_unit = isinstance(value, Quantity) and value.si != "1" and not bounds.is_sign
        unit = f" {value.si}" if has_unit else ""
        return self.report(place, f"must be {bounds}{unit}, found {shown}")

    def _matching(self, pattern: str) -> list[str]:
        """Return the files of the session that fit a pattern, in the order of their numbers; the pattern for none."""
        names = [] if ".." in Path(pattern).parts or Path(pattern).is_absolute() else self.root.glob(pattern)
        found = (path.relative_to(self.root).as_posix() for path in names)

        def by_number(name: str) -> list[tuple[int, str]]:
            return [(int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d+)", name)]

        return sorted(found, key=by_number) or [pattern]

    def _file(self, value: Any, place: Place) -> Any:
        if not isinstance(value, str):
            return self.report(place, f"expected the name of a file, found {found(value)}")
        if NAME in value:  # in defaults: each experiment puts its own in
            return _BAD
        is_of_laboratory = not isinstance(place[-1], int) and self.written(place)[:1] == (LABORATORY,)
        root = self.laboratory if is_of_laboratory and self.laboratory is not None else self.root
        try:
            place_on_disk = safe_join(root, value)
        except InputError as error:
            return self.report(place, str(error))
        if is_of_laboratory and place_on_disk.exists():
            return relative(place_on_disk, self.root)
        if not place_on_disk.exists() and not self.may_wait:
            # files that a user may have meant; labpipe's own folder is not among them
            names = (f.relative_to(self.root).as_posix() for f in files_below(self.root))
            near = suggest(value, [name for name in names if not name.startswith("labpipe/")])
            advice = near or "; copy it there, or correct the name"
            return self.report(place, f'there is no file "{value}" in the session folder{advice}')
        if self.gaps is not None and value.endswith(".toml"):
            with contextlib.suppress(OSError, UnicodeDecodeError):  # a record that cannot be read is refused later
                is_short = place_on_disk.stat().st_size <= LARGEST_FILE
                lines = place_on_disk.read_text("utf-8").splitlines() if is_short else []
                matches = ((number, _GAP_LINE.match(line)) for number, line in enumerate(lines, 1))
                self.gaps += [f"{value}:{number}: {match[1]}: to be filled in" for number, match in matches if match]
        return value

    def _plain(self, kind: Any, bare: Any, value: Any, place: Place) -> Any:
        if typing.get_origin(bare) is Literal and value not in typing.get_args(bare):
            alike = [a for a in typing.get_args(bare) if isinstance(value, str) and a == value.lower()]
            if alike:
                return alike[0]
            near = suggest(str(value), map(str, typing.get_args(bare)))
            return self.report(place, f"expected {describe(bare)}, found {found(value)}{near}")
        try:
            return msgspec.convert(value, kind)
        except msgspec.ValidationError as error:
            # msgspec says "Expected `int` >= 1" for a bound, and names its own types otherwise.
            is_bound = str(error).startswith("Expected") and ", got" not in str(error)
            bound = str(error).removeprefix("Expected ").replace("`", "")
            bound = _BOUNDS.get(bound, bound)
            expected = bound if is_bound else describe(bare)
            return self.report(place, f"expected {expected}, found {found(value)}")


NAME = "{name}"
"""Stands in a text of the settings for the name of the experiment."""
_GAP_LINE = re.compile(rf'^\s*(\w+)\s*=\s*"{GAP}(?: [^"]*)?"')
_BOUNDS = dict.fromkeys(("str of length >= 1", r"str matching regex '\\S'"), "a text that is not empty")
"""Words for the bounds that msgspec names by its own types."""

"""The types of configured fields, and how they and their values are called in messages."""

import datetime
import difflib
import inspect
import math
import re
import types
import typing
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, Union

import msgspec

from labpipe.units import Quantity, spellings


@dataclass(frozen=True, slots=True)
class Dimension:
    """Marks a field as a quantity: its SI unit, its name, and an example for messages."""

    si: str
    noun: str
    example: str


@dataclass(frozen=True, slots=True)
class Range:
    """Bounds of a number, or of the SI value of a quantity."""

    above: float = -math.inf
    at_least: float = -math.inf
    below: float = math.inf
    at_most: float = math.inf

    def __str__(self) -> str:
        """Say the bounds: ``> 0 and <= 1``."""
        bounds = ((">", self.above), (">=", self.at_least), ("<", self.below), ("<=", self.at_most))
        return " and ".join(f"{sign} {value:g}" for sign, value in bounds if math.isfinite(value))

    def holds(self, value: float) -> bool:
        """Return whether a value is inside."""
        return self.above < value < self.below and self.at_least <= value <= self.at_most


class FileMark:
    """Marks a text field as the name of a file or folder below the session folder."""


class ReferenceMark:
    """Marks a text field as the name of another experiment of the session."""


REFERENCE = "experiment:"
"""Prefix by which a field's value names another experiment of the session."""

GAP = "FILL"
"""Placeholder in session.toml or a record, before its unit, for a value that is still to come."""


def is_gap(value: Any) -> bool:
    """Return whether a value, or the file that it names, is still to come.

    Examples
    --------
    >>> is_gap("FILL mm"), is_gap("calibration/FILL.toml"), is_gap("filled"), is_gap(1.5)
    (True, True, False, False)
    """
    return isinstance(value, str) and GAP in (value.partition(" ")[0], value.rpartition("/")[2].partition(".")[0])


POSITIVE = Range(above=0.0)
NOT_NEGATIVE = Range(at_least=0.0)

_FILE = "the name of a file"
File = Annotated[str, FileMark(), msgspec.Meta(description=_FILE)]
ExperimentName = Annotated[str, ReferenceMark(), msgspec.Meta(description="the name of an experiment")]
"""Written as ``NAME`` or ``experiment:NAME``, kept as the latter."""
Length = Annotated[Quantity, Dimension("m", "length", "9.525 ± 0.005 mm")]
Mass = Annotated[Quantity, Dimension("kg", "mass", "505.0 ± 0.5 g")]
Angle = Annotated[Quantity, Dimension("rad", "angle", "12.0 ± 0.2 deg")]
Time = Annotated[Quantity, Dimension("s", "time", "50 ms")]
Frequency = Annotated[Quantity, Dimension("Hz", "frequency", "180 ± 2 Hz")]
Temperature = Annotated[Quantity, Dimension("degC", "temperature", "21.0 ± 0.5 degC")]
Force = Annotated[Quantity, Dimension("N", "force", "0.500 ± 0.005 N")]
Acceleration = Annotated[Quantity, Dimension("m/s2", "acceleration", "9.81 m/s2")]
Modulus = Annotated[Quantity, Dimension("Pa", "modulus", "403 ± 10 GPa")]
Scale = Annotated[Quantity, Dimension("m/px", "image scale", "12.50 ± 0.05 um/px")]
Adhesion = Annotated[Quantity, Dimension("J/m2", "work of adhesion", "50 ± 20 mJ/m2")]
Dimensionless = Annotated[Quantity, Dimension("1", "number without unit", "0.35 ± 0.01")]


@cache
def fields_of(kind: type[msgspec.Struct]) -> tuple[msgspec.structs.FieldInfo, ...]:
    """Return the fields of a structure, whose annotations msgspec would evaluate each time."""
    return msgspec.structs.fields(kind)


@cache
def meanings(kind: type[msgspec.Struct]) -> dict[str, str]:
    """Return the meaning of the fields of a structure that state it after ``#:`` in the line that declares them."""
    tables = [base for base in kind.__mro__[::-1] if issubclass(base, msgspec.Struct) and base.__module__ != "msgspec"]
    return dict(re.findall(r"^    (\w+):.*#: (.+)$", "".join(map(inspect.getsource, tables)), re.MULTILINE))


def split(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """Separate a type from the marks of its ``Annotated``; an optional one is the type without None."""
    if typing.get_origin(kind) in (Union, types.UnionType):
        options = [option for option in typing.get_args(kind) if option is not type(None)]
        return split(options[0]) if len(options) == 1 else (kind, ())
    if typing.get_origin(kind) is Annotated:
        bare, *marks = typing.get_args(kind)
        return bare, tuple(marks)
    return kind, ()


def options_of(kind: Any) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Yield the alternatives of a field, each type with its marks."""
    bare, marks = split(kind)
    if typing.get_origin(bare) in (Union, types.UnionType):
        for option in typing.get_args(bare):
            yield from options_of(option)
    else:
        yield bare, marks


def is_table(kind: Any) -> bool:
    """Return whether a type is a structure, written as a table."""
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def tables_of(kind: Any) -> list[type[msgspec.Struct]]:
    """Return the structures among the alternatives of a field: those of a table."""
    return [bare for bare, _ in options_of(kind) if is_table(bare)]


def every_setting(settings: Any, place: str = "", kind: Any = None) -> Iterator[tuple[str, Any, Any]]:
    """Yield settings and all that is in them: dotted name, value and declared type."""
    yield place, settings, kind
    if isinstance(settings, msgspec.Struct):
        for field in fields_of(type(settings)):
            name = f"{place}.{field.name}" if place else field.name
            yield from every_setting(getattr(settings, field.name), name, field.type)
    elif isinstance(settings, list | tuple) and not isinstance(settings, Quantity):
        inner = next((typing.get_args(bare)[0] for bare, _ in options_of(kind) if typing.get_args(bare)), None)
        for number, item in enumerate(settings):
            yield from every_setting(item, f"{place}[{number}]", inner)


M = TypeVar("M")


def mark(kind: Any, of: type[M]) -> M | None:
    """Return the first mark of a class in a type or its alternatives, or None."""
    return next((one for _, marks in options_of(kind) for one in marks if isinstance(one, of)), None)


_WORDS: dict[Any, str] = {
    str: "text in quotation marks",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    datetime.date: "a date such as 2026-01-31 (without quotation marks)",
}


def describe(kind: Any) -> str:
    """Describe the expected value of a field: ``a length such as "9.525 ± 0.005 mm" (units: m, cm, mm, um, nm)``."""
    bare, marks = split(kind)
    if (dimension := next((one for one in marks if isinstance(one, Dimension)), None)) is not None:
        article = "an" if dimension.noun[0] in "aeiou" else "a"
        units = "" if dimension.si == "1" else f" (units: {', '.join(spellings(dimension.si))})"
        return f'{article} {dimension.noun} such as "{dimension.example}"{units}'
    if stated := next((one.description for one in marks if isinstance(one, msgspec.Meta) and one.description), None):
        return stated
    origin, arguments = typing.get_origin(bare), typing.get_args(bare)
    if origin is Literal:
        return "one of " + ", ".join(map(found, arguments))
    if origin in (Union, types.UnionType):
        return " or ".join(describe(a) for a in arguments if a is not type(None))
    if origin in (list, tuple):
        is_of_files = mark(arguments[0], FileMark) is not None
        return "names of files, in brackets" if is_of_files else f"a list in brackets, each {describe(arguments[0])}"
    return _WORDS.get(bare, "a table")


def found(value: Any) -> str:
    """Describe a value that was found, shortened."""
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    text = str(value).lower() if isinstance(value, bool) else str(value)
    text = text if len(text) <= 60 else text[:60] + "…"
    return f'"{text}"' if isinstance(value, str) else text


def suggest(word: str, known: Iterable[str]) -> str:
    """Add ``; did you mean "…"?``, or the list of known names when it is short."""
    options = sorted(known)
    # of longer words and lists the search takes longer than it helps
    if near := difflib.get_close_matches(word[:256], options[:1000], n=1):
        return f'; did you mean "{near[0]}"?'
    return "; known: " + ", ".join(options) if 0 < len(options) <= 12 else ""

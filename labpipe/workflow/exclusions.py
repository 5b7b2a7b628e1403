"""Exclusions from an experiment, each with a reason: recordings, readings, frames; and dated notes on it."""

import datetime
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from labpipe.errors import InputError
from labpipe.units import Quantity
from labpipe.workflow.fields import FileMark, every_setting, fields_of, mark, suggest

EXCLUDE = "exclude"
"""Field of an experiment's settings that holds its exclusions; stages that read files declare it as a parameter."""
S = TypeVar("S", bound=msgspec.Struct)
_Span = (
    Annotated[int, msgspec.Meta(ge=0, description="a number such as 3001")]
    | Annotated[str, msgspec.Meta(pattern=r"^\s*\d+\s*(-\s*\d+\s*)?$", description='a range such as "3001-3400"')]
)


class Note(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A dated note on an experiment, as in a laboratory notebook."""

    on: datetime.date  #: day
    text: Annotated[str, msgspec.Meta(pattern=r"\S", description="the text of the note")]  #: the remark
    who: str = ""  #: whose it is


class Exclusion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A recording that is left out, or some of its readings or frames, and the reason.

    Readings count from 1 in the order of the file, frames from 0 as on the page of a film; ``"3001-3400"`` is a range
    with both ends. Without either the whole file is left out.
    """

    file: str  #: recording, as the experiment names it
    reason: Annotated[str, msgspec.Meta(pattern=r"\S", description='a reason such as "a door slammed"')]  #: why
    readings: list[_Span] = []  #: numbers from 1, or ranges; without any the whole file
    frames: list[_Span] = []  #: numbers from 0, or ranges
    who: str = ""  #: who decided
    on: datetime.date | None = None  #: when

    def __post_init__(self) -> None:
        """Refuse numbers that are none."""
        for first, last in (*self.spans("readings"), *self.spans("frames")):
            if last < first:
                raise ValueError(f'"{first}-{last}" ends before it begins')
        if any(first < 1 for first, _ in self.spans("readings")):
            raise ValueError("readings count from 1")

    @property
    def is_whole(self) -> bool:
        """Whether the whole file is left out."""
        return not (self.readings or self.frames)

    def spans(self, of: Literal["readings", "frames"]) -> list[tuple[int, int]]:
        """Return first and last of each run of readings or frames, both included."""
        ends = [[int(end) for end in str(item).split("-")] for item in getattr(self, of)]
        return [(one[0], one[-1]) for one in ends]

    @property
    def excluded(self) -> str:
        """Words for the part that is left out: ``laser/r3.csv``, ``2 readings (3001, 3002) of laser/r1.csv``."""
        counts = {of: sum(last - first + 1 for first, last in self.spans(of)) for of in ("readings", "frames")}
        listed = {of: ", ".join(map(str, getattr(self, of))) for of in counts}
        parts = [f"{n} {of if n > 1 else of[:-1]} ({listed[of]})" for of, n in counts.items() if n]
        return f"{' and '.join(parts)} of {self.file}" if parts else self.file

    def __str__(self) -> str:
        """Write the part that is left out, the reason, who and when."""
        signed = ", ".join(str(part) for part in (self.who, self.on) if part)
        return f"{self.excluded}: {self.reason}{signed and f' ({signed})'}"


def exclusions(settings: Any, files: Iterable[str] | None = None) -> list[Exclusion]:
    """Return the exclusions in the settings of an experiment, or those that concern some of its files."""
    chosen = None if files is None else set(files)
    return [one for one in getattr(settings, EXCLUDE, ()) if chosen is None or one.file in chosen]


def concerning(settings: S, files: Iterable[str]) -> S:
    """Return settings with those exclusions alone that concern some files, as a step that reads them receives it."""
    return msgspec.structs.replace(settings, exclude=exclusions(settings, files))


def files_of(settings: Any) -> Iterator[tuple[str, str]]:
    """Yield place and name of every file that settings name."""
    for place, value, kind in every_setting(settings):
        if isinstance(value, str) and mark(kind, FileMark) is not None:
            yield place, value


def without_excluded(settings: S) -> S:
    """Leave the files that are excluded whole out of the lists of settings.

    A list of quantities with one for each file loses the same items; a table in a list that loses all its files goes.

    Raises InputError: an exclusion names no recording of the experiment, or nothing is left; ``reason`` is its number.
    """
    recordings = {name for _, name in files_of(settings) if not name.endswith(".toml")}
    given = exclusions(settings)
    whole = {one.file for one in given if one.is_whole}
    kept = _left(settings, whole) if whole else settings
    left = {name for _, name in files_of(kept)} & recordings
    for number, one in reversed([*enumerate(given)]):
        message = f'the experiment has no recording "{one.file}"{suggest(one.file, recordings)}'
        if one.file in recordings:
            message = f'"{one.file}" is all that is left of the experiment; remove the experiment instead'
        if one.file not in recordings or (one.is_whole and (one.file in left or not left)):
            raise InputError(message).because(str(number))
    return kept


def _left(table: S, whole: set[str]) -> S:
    """Leave files out of the lists of a table and of the tables in it."""
    values = {info.name: getattr(table, info.name) for info in fields_of(type(table))}
    changed: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, msgspec.Struct):
            changed[name] = _left(value, whole)
        elif isinstance(value, list) and all(isinstance(item, str) for item in value) and whole & {*value}:
            for other, beside in values.items():
                is_of_each = isinstance(beside, list) and len(beside) == len(value)
                if other == name or (is_of_each and all(isinstance(item, Quantity) for item in beside)):
                    changed[other] = [item for item, file in zip(beside, value, strict=True) if file not in whole]
        elif isinstance(value, list) and all(isinstance(item, msgspec.Struct) for item in value):
            items = [(item, _left(item, whole)) for item in value]
            changed[name] = [new for old, new in items if any(files_of(new)) or not any(files_of(old))]
    return msgspec.structs.replace(table, **changed)

"""Values that no file contains: the gaps of a session.toml, questions for them, and templates made of gaps alone."""

import re
import types
import typing
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any, Literal

import msgspec

from labpipe import installation
from labpipe.errors import InputError, UsageError
from labpipe.units import quantity, unit
from labpipe.workflow.fields import Dimension, FileMark, describe, mark, split, suggest
from pipelines import experiments
from pipelines.experiments.shared.proposals import GAP, material_line, material_word
from pipelines.experiments.shared.settings import MaterialChoice

NONE = "none"
"""The answer that leaves a line out, where its remark offers it."""
_LINE = re.compile(rf'^\s*(\w+)\s*=\s*"{GAP}(?: ([^"]*))?"(?:\s*#\s*(.*))?$')
_TABLE = re.compile(r"^\[{1,2}(?:experiments\.)?([^\]]+)\]{1,2}\s*(?:#.*)?$")
_BARE_NUMBERS = re.compile(r"(?:[\d\s.,±+-]|(?<=\d)[eE](?=[+-]?\d))+")
_DAYS = ("valid_from", "valid_until", "when")
_RECORDS = ("calibration", "camera", "record")
"""Fields that name a calibration record."""


def library_names() -> tuple[str, ...]:
    """Names of the bundled materials."""
    folder = Path(installation.__file__).parent / "materials/library"
    return tuple(sorted(path.stem for path in folder.glob("*.toml")))


@dataclass(frozen=True, slots=True)
class Gap:
    """One value that is missing: its line from 1, its table, its key, unit, and explanation.

    ``record`` is true where it belongs to a calibration record.
    """

    line: int
    table: str
    key: str
    unit: str
    remark: str
    record: bool = False

    @property
    def question(self) -> str:
        """The question for a person."""
        remark = f" ({self.remark})" if self.remark else ""
        return f"{self.table}: {self.key.replace('_', ' ')}{remark}"

    @property
    def may_be_left_out(self) -> bool:
        """Whether there may be no such value at all."""
        return f'"{NONE}"' in self.remark

    @property
    def sort(self) -> tuple[str, str, str]:
        """Key that questions of one sort share; the answer to one is offered for the next.

        A value of a calibration record belongs to its sensor or view, and is offered for no other.
        """
        return self.key, self.unit, f"{self.table}: {self.remark}" if self.record and self.unit else self.remark


def gaps(text: str) -> Iterator[Gap]:
    """Find the gaps of a TOML text, in the order of their lines.

    Examples
    --------
    >>> [(g.key, g.unit) for g in gaps('radius = "FILL mm"  # of the sphere')]
    [('radius', 'mm')]
    """
    table = ""
    for number, line in enumerate(text.splitlines(), 1):
        if (head := _TABLE.match(line.strip())) is not None:
            table = head[1]
        elif (match := _LINE.match(line)) is not None:
            yield Gap(number, table, match[1], match[2] or "", match[3] or "")


def checked(gap: Gap, answer: str) -> str:
    """Return an answer as it is written into the file; a bare number gets the unit of the gap.

    Raises
    ------
    InputError
        The answer does not fit; the message says what would.

    Examples
    --------
    >>> checked(Gap(1, "a", "radius", "mm", ""), "9.525 ± 0.005")
    '9.525 ± 0.005 mm'
    """
    answer = answer.strip()
    if '"' in answer or "\\" in answer or not answer.isprintable():
        raise InputError(f"found {answer!r}; write it without quotes and backslashes")
    if gap.may_be_left_out and answer.lower() == NONE:
        return NONE
    if gap.key in _DAYS:
        try:
            return date.fromisoformat(answer).isoformat()
        except ValueError:
            raise InputError(f'expected a day such as 2024-05-14, found "{answer}"') from None
    allowed: dict[str, tuple[str, ...]] = {"material": library_names()}
    for kind in experiments.KINDS.values():
        allowed |= kind.proposal.answers if kind.proposal is not None else {}
    if gap.key in allowed:
        for known in (answer.lower(), material_word(answer, is_whole=True)):
            if known in allowed[gap.key]:
                return str(known)
        raise InputError(f'expected one of {", ".join(allowed[gap.key])}; found "{answer}"')
    if not gap.unit and gap.key != "nu":
        return answer
    text = in_unit(answer, gap.unit)
    expected = f'expected for example "{f"12.3 ± 0.1 {gap.unit}".strip()}"'
    try:
        found = quantity(text)
    except InputError as error:
        raise InputError(f"{expected}: {error}") from None
    if found.si != unit(gap.unit or "1").si:
        raise InputError(f'{expected}, found "{text}", which is in {found.si}')
    return text


def in_unit(answer: str, unit: str) -> str:
    """Give a bare number, with or without its ±, the unit that was asked for.

    Examples
    --------
    >>> in_unit("9,525 ± 0,005", "mm"), in_unit("1 cm", "mm")
    ('9,525 ± 0,005 mm', '1 cm')
    """
    return f"{answer} {unit}" if unit not in ("", "1") and _BARE_NUMBERS.fullmatch(answer) else answer


def filled(text: str, ask: Callable[[Gap], str | None], owner: str = "") -> str:
    """Ask for every gap of a TOML text and write the answers into it; None for an answer leaves a gap open.

    An owner stands in the questions instead of the tables' names, where those say too little.
    """
    lines = text.splitlines(keepends=True)
    for gap in gaps(text):
        answer = ask(replace(gap, table=owner, record=True) if owner else gap)
        if answer == NONE and gap.may_be_left_out:
            lines[gap.line - 1] = f"# {gap.key}: there is none\n"
        elif answer is not None:
            old = f'"{GAP} {gap.unit}"' if gap.unit else f'"{GAP}"'
            # A day is a value of its own in TOML; everything else is a text.
            new = answer if gap.key in _DAYS else f'"{answer}"'
            lines[gap.line - 1] = lines[gap.line - 1].replace(old, new, 1)
    return "".join(lines)


# --- templates ---


def template_of(kinds: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the sections of session.toml for some kinds, every value still to come, and the experiments' names.

    Raises
    ------
    UsageError
        There is no such kind.
    """
    sections, names = [], []
    for name in dict.fromkeys(kinds):
        if name not in experiments.KINDS:
            raise UsageError(f'there is no kind of experiment "{name}"{suggest(name, experiments.KINDS)}')
        kind = experiments.KINDS[name]
        names.append(name)
        lines = [f"[experiments.{name}]", f'kind = "{name}"  # {kind.summary}']
        sections.append("\n".join([*lines, *_fields(kind.settings, f"experiments.{name}")]))
    return sections, names


def gap_for(kind: Any) -> str:
    """Return the placeholder for a value of a field that is still to come."""
    bare, marks = split(bare_type(kind))
    if typing.get_origin(bare) is list:
        return gap_for(typing.get_args(bare)[0])
    dimension = mark(marks, Dimension)
    of_unit = dimension.example.rpartition(" ")[2] if dimension is not None and dimension.si != "1" else ""
    return f"{GAP} {of_unit}".strip()


def bare_type(kind: Any) -> Any:
    """Leave the None of an optional field away."""
    options = [option for option in typing.get_args(kind) if option is not type(None)]
    is_union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    return options[0] if is_union and len(options) == 1 else kind


def _fields(kind: type[msgspec.Struct], place: str) -> Iterator[str]:
    """Yield the lines of a structure: the required fields, then, as remarks, the optional ones, then its tables."""
    tables, further = [], []
    for info in msgspec.structs.fields(kind):
        name = info.encode_name
        bare, marks = split(bare_type(info.type))
        is_list = typing.get_origin(bare) is list
        inner = typing.get_args(bare)[0] if is_list else bare
        if isinstance(inner, type) and issubclass(inner, msgspec.Struct):
            head = f"[[{place}.{name}]]" if is_list else f"[{place}.{name}]"
            tables += ["", head, *_fields(inner, f"{place}.{name}")] if info.required else []
        elif name == "material" and issubclass(kind, MaterialChoice):
            yield material_line("")
        elif not info.required and name != "kind":
            further.append(f"# {name} = …  # {describe(info.type)}")
        elif name != "kind":
            is_record = name in _RECORDS and mark(marks, FileMark) is not None
            gap = f"calibration/{GAP}.toml" if is_record else gap_for(info.type)
            if typing.get_origin(bare) is Literal and len(typing.get_args(bare)) == 1:
                yield f"{name} = {typing.get_args(bare)[0]!r}"
            else:
                yield (
                    f'{name} = ["{gap}"]  # {describe(info.type)}'
                    if is_list
                    else (f'{name} = "{gap}"  # {describe(info.type)}')
                )
    yield from further
    yield from tables

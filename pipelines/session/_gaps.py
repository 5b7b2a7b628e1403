"""Values that no file contains: the gaps of a session.toml, questions for them, and templates made of gaps alone."""

import re
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any, Literal

import msgspec

from labpipe import installation
from labpipe.errors import InputError, UsageError
from labpipe.units import quantity, unit
from labpipe.workflow.fields import Dimension, FileMark, describe, mark, meanings, split, suggest
from labpipe.workflow.session import FILE_NAME
from pipelines import experiments
from pipelines.experiments.shared.proposals import GAP, material_line, material_word
from pipelines.experiments.shared.settings import MaterialChoice

NONE = "none"
"""The answer that leaves a line out, where its remark offers it."""
_LINE = re.compile(rf'^\s*(\w+)\s*=\s*"{GAP}(?: ([^"]*))?"(?:\s*#\s*(.*))?$')
_TABLE = re.compile(r"^\[{1,2}(?:experiments\.)?([^\]]+)\]{1,2}\s*(?:#.*)?$")
_BARE_NUMBERS = re.compile(r"(?:[\d\s.,±+-]|(?<=\d)[eE](?=[+-]?\d))+")
_MATERIAL = re.compile(rf'material(?:_from)? = "(?!{GAP})([^"]+)"')
_OF_SPECIMEN = ("radius", "mass", "thickness", "temperature")
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

    ``record`` is true where it belongs to a calibration record; ``number`` counts the question among ``of``.
    """

    line: int
    table: str
    key: str
    unit: str
    remark: str
    record: bool = False
    number: int = 0
    of: int = 0

    @property
    def question(self) -> str:
        """The question for a person."""
        remark = f" ({self.remark})" if self.remark else ""
        count = f"[{self.number}/{self.of}] " if self.of else ""
        return f"{count}{self.table}: {self.key.replace('_', ' ')}{remark}"

    @property
    def may_be_left_out(self) -> bool:
        """Whether there may be no such value at all."""
        return f'"{NONE}"' in self.remark


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
    """Return an answer as it is written into the file, a bare number with the unit of the gap, or raise InputError.

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


def filled(texts: Mapping[str, str], ask: Callable[[Gap], str | None]) -> dict[str, str]:
    """Ask for every gap of session.toml and its records, by file, and write the answers; None leaves a gap open.

    Materials are asked for first: a value of a specimen, as its radius, is one question for all experiments of
    one material. A value of a calibration record is named by its file.
    """
    lines = {name: text.splitlines(keepends=True) for name, text in texts.items()}
    left = [(name, gap) for name, text in texts.items() for gap in gaps(text)]
    left.sort(key=lambda one: (one[0] != FILE_NAME, one[1].key != "material"))
    asked = 0
    while left:
        questions: dict[tuple[str, ...], list[tuple[str, Gap]]] = {}
        for name, gap in left:
            material = ""  # of the table of a gap that belongs to a specimen, where it is stated
            if gap.key in _OF_SPECIMEN:
                is_head = [_TABLE.match(line.strip()) is not None for line in lines[name]]
                first = max((i for i in range(gap.line) if is_head[i]), default=0)
                last = next((i for i in range(gap.line, len(is_head)) if is_head[i]), len(is_head))
                stated = next(filter(None, map(_MATERIAL.match, lines[name][first:last])), None)
                material = "" if stated is None else material_word(stated[1]) or stated[1]
            key = (name, material, gap.table.rpartition(".")[2], gap.key) if material else (name, str(gap.line))
            questions.setdefault(key, []).append((name, gap))
        (_, material, *_), alike = next(iter(questions.items()))
        (file, gap), asked = alike[0], asked + 1
        is_record = file != FILE_NAME
        table = f"calibration of {Path(file).stem.replace('_', ' ')}" if is_record else gap.table
        if len(alike) > 1:
            owners = [one.table.rpartition(".")[0] for _, one in alike]
            more = f" and {len(owners) - 3} more" if len(owners) > 3 else ""
            table = f"{gap.table.rpartition('.')[2]} of {material}, in {', '.join(owners[:3])}{more}"
        answer = ask(replace(gap, table=table, record=is_record, number=asked, of=asked + len(questions) - 1))
        for name, one in alike:
            left.remove((name, one))
            if answer is not None:
                old = f'"{GAP} {one.unit}"' if one.unit else f'"{GAP}"'
                # A day is a value of its own in TOML; everything else is a text.
                new = lines[name][one.line - 1].replace(old, answer if one.key in _DAYS else f'"{answer}"', 1)
                is_none = answer == NONE and one.may_be_left_out
                lines[name][one.line - 1] = f"# {one.key}: there is none\n" if is_none else new
    return {name: "".join(of_file) for name, of_file in lines.items()}


def template_of(kinds: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the sections of session.toml for some kinds, every value still to come, and the experiments' names."""
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
    bare, _ = split(kind)
    if typing.get_origin(bare) is list:
        return gap_for(typing.get_args(bare)[0])
    dimension = mark(kind, Dimension)
    of_unit = dimension.example.rpartition(" ")[2] if dimension is not None and dimension.si != "1" else ""
    return f"{GAP} {of_unit}".strip()


def _fields(kind: type[msgspec.Struct], place: str) -> Iterator[str]:
    """Yield the lines of a structure: the required fields, then, as remarks, the optional ones, then its tables."""
    tables, further = [], []
    for info in msgspec.structs.fields(kind):
        name = info.encode_name
        bare, _ = split(info.type)
        is_list = typing.get_origin(bare) is list
        inner = typing.get_args(bare)[0] if is_list else bare
        remark = ": ".join(filter(None, (meanings(kind).get(name), describe(info.type))))
        if isinstance(inner, type) and issubclass(inner, msgspec.Struct):
            head = f"[[{place}.{name}]]" if is_list else f"[{place}.{name}]"
            tables += ["", head, *_fields(inner, f"{place}.{name}")] if info.required else []
        elif name == "material" and issubclass(kind, MaterialChoice):
            yield material_line("")
        elif not info.required and name != "kind":
            further.append(f"# {name} = …  # {remark}")
        elif name != "kind":
            is_record = name in _RECORDS and mark(info.type, FileMark) is not None
            gap = f"calibration/{GAP}.toml" if is_record else gap_for(info.type)
            value = f'["{gap}"]' if is_list else f'"{gap}"'
            if typing.get_origin(bare) is Literal and len(typing.get_args(bare)) == 1:
                yield f"{name} = {typing.get_args(bare)[0]!r}"
            else:
                yield f"{name} = {value}  # {remark}"
    yield from further
    yield from tables

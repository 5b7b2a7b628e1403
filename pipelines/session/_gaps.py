"""Questions for what the files do not contain: the gaps of a proposed session.toml."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from labpipe import installation
from labpipe.errors import InputError
from labpipe.units import quantity, unit
from pipelines import experiments
from pipelines.experiments.shared.proposals import GAP, material_word

_LINE = re.compile(rf'^\s*(\w+)\s*=\s*"{GAP}(?: ([^"]*))?"(?:\s*#\s*(.*))?$')
_TABLE = re.compile(r"^\[{1,2}(?:experiments\.)?([^\]]+)\]{1,2}\s*(?:#.*)?$")
NONE = "none"
"""The answer that leaves a line out, where its remark offers it."""
_BARE_NUMBERS = re.compile(r"(?:[\d\s.,±+-]|(?<=\d)[eE](?=[+-]?\d))+")
_DAYS = ("valid_from", "valid_until", "when")


def library_names() -> tuple[str, ...]:
    """Names of the bundled materials."""
    folder = Path(installation.__file__).parent / "materials/library"
    return tuple(sorted(path.stem for path in folder.glob("*.toml")))


@dataclass(frozen=True, slots=True)
class Gap:
    """One value that is missing: its line from 1, its table, its key, unit, and explanation.

    ``record`` tells that it belongs to a calibration record.
    """

    line: int
    table: str
    key: str
    unit: str
    remark: str
    record: bool = False

    @property
    def question(self) -> str:
        """What to ask a person."""
        remark = f" ({self.remark})" if self.remark else ""
        return f"{self.table}: {self.key.replace('_', ' ')}{remark}"

    @property
    def may_be_left_out(self) -> bool:
        """Whether there may be no such value at all."""
        return f'"{NONE}"' in self.remark

    @property
    def sort(self) -> tuple[str, str, str]:
        """What two questions of one sort share; the answer to one is offered for the next.

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
        return _day(answer)
    for key, allowed in (("material", library_names()), *_answers()):
        if gap.key == key:
            if (known := answer.lower()) in allowed or (known := material_word(answer, is_whole=True) or "") in allowed:
                return known
            raise InputError(f'expected one of {", ".join(allowed)}; found "{answer}"')
    return _with_unit(gap, answer) if gap.unit or gap.key == "nu" else answer


def _answers() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield fields, and the answers that the kinds accept for them."""
    for kind in experiments.KINDS.values():
        if kind.proposal is not None:
            yield from kind.proposal.answers.items()


def _day(answer: str) -> str:
    try:
        return date.fromisoformat(answer).isoformat()
    except ValueError:
        raise InputError(f'expected a day such as 2024-05-14, found "{answer}"') from None


def in_unit(answer: str, unit: str) -> str:
    """Give a bare number, with or without its ±, the unit that was asked for.

    Examples
    --------
    >>> in_unit("9,525 ± 0,005", "mm"), in_unit("1 cm", "mm")
    ('9,525 ± 0,005 mm', '1 cm')
    """
    return f"{answer} {unit}" if unit not in ("", "1") and _BARE_NUMBERS.fullmatch(answer) else answer


def _with_unit(gap: Gap, answer: str) -> str:
    wanted = gap.unit or "1"
    text = in_unit(answer, wanted)
    expected = f'expected for example "{f"12.3 ± 0.1 {gap.unit}".strip()}"'
    try:
        found = quantity(text)
    except InputError as error:
        raise InputError(f"{expected}: {error}") from None
    if found.si != unit(wanted).si:
        raise InputError(f'{expected}, found "{text}", which is in {found.si}')
    return text


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

"""Cells to numbers in SI: decimal sign by evidence, units by file, invalid points to NaN."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from instruments._moduli import needed, with_moduli
from instruments._quantities import SI_OF, TEMPERATURES, TEXT, TIMES, quantity, repaired, slug, unit_of
from instruments._temperatures import celsius
from instruments._workbook import Cell, text_of
from instruments.anton_paar import _words as words
from instruments.anton_paar._table import RawInterval
from labpipe.arrays import Flags, Floats, Integers
from labpipe.errors import InputError, SourceError
from labpipe.text import DOT, Separators, listed, not_a_number, plain_number, separators, shorten

#: Cells without a reading.
_ABSENT = ("", "-", "--", "---", "*")


@dataclass(frozen=True, slots=True)
class Column:
    """One column of one interval.

    ``name`` is canonical, ``header`` and ``unit`` as in the file, ``values`` in SI (numbers) or
    text. ``si`` is "" for text.
    """

    name: str
    header: str
    unit: str
    si: str
    values: Floats | list[str]
    sub_label: str = ""


@dataclass(frozen=True, slots=True)
class Interval:
    """One table: where it belongs, and its columns over its points.

    ``point`` is the number of every point (0 where the file gives none), ``is_valid`` False where
    the instrument marked it invalid.
    """

    test: str
    result: str
    number: int
    declared: int | None
    point: Integers
    is_valid: Flags
    columns: tuple[Column, ...]
    line: int = 0
    sheet: str = ""


@dataclass(slots=True)
class Findings:
    """Notes and counts from the reading of the values."""

    notes: list[str] = field(default_factory=list)
    absent: int = 0
    invalid: int = 0
    is_contradicted: bool = False

    def note(self, text: str) -> None:
        """Keep a note once; further intervals say the same."""
        if text not in self.notes:
            self.notes.append(text)


@dataclass(frozen=True, slots=True)
class _Plan:
    """A column to read: its place, name, heading, sub-label, unit, whether it is text, whether a result needs it."""

    index: int
    name: str
    header: str
    sub_label: str
    unit: str
    is_text: bool
    is_needed: bool = False


def signs_of(intervals: Iterable[RawInterval], decimal: str | None, path: Path) -> Separators:
    """Decide the decimal sign of a file from all its numbers.

    Raises
    ------
    SourceError
        It is ambiguous, or both signs are used.
    """
    cells: list[str] = []
    for interval in intervals:
        wanted = [i for i, unit in enumerate(interval.units) if unit]
        for row in interval.rows:
            cells += [_evident(c) for i in wanted if isinstance(c := row.cells[i], str)]
    if decimal is not None:
        other = "." if decimal == "," else ","
        has_other = any(other in c and c.strip("+-").replace(",", "").replace(".", "").isdigit() for c in cells)
        return Separators(decimal, other if has_other else "")
    try:
        return separators(cells)
    except InputError as error:
        raise SourceError(path, str(error)) from None


def _evident(cell: str) -> str:
    """Return the mantissa, longer by one digit: no thousands sign stands before an exponent."""
    mantissa, found, _ = cell.strip().lower().partition("e")
    return mantissa + "0" if found and ("," in mantissa or "." in mantissa) else mantissa


def interpret(raw: RawInterval, signs: Separators, path: Path, findings: Findings) -> Interval:
    """Turn one table into numbers.

    A column that no sweep and no response is made of is left out, with a note, where its unit is none of its
    quantity; a cell of it that is no number is no reading.

    Raises
    ------
    SourceError
        A cell of a column that is needed is no number, or its unit is not known or not one of its quantity.
    """
    plans = _plans(raw, path, findings)
    numbers = next((p.index for p in plans if p.name == "point"), None)
    point, valid = _points(raw, numbers, path)
    findings.invalid += int((~valid).sum())
    columns = []
    for plan in plans:
        if plan.name == "point":
            continue
        if plan.is_text or _is_free_text(raw, plan, signs):
            text = [repaired(text_of(r.cells[plan.index])) for r in raw.rows]
            columns.append(Column(plan.name, plan.header, plan.unit, "", text, plan.sub_label))
            continue
        unit = _unit(raw, plan, path, findings)
        if unit is None:
            continue
        factor, si = unit
        values = _numbers(raw, plan, signs, path, findings) * factor
        if plan.name in TEMPERATURES:
            values = celsius(values, si, path=path, line=raw.line + 1, header=plan.header, stated=plan.unit)
            si = "degC"
        name = plan.name
        if name in ("frequency", "angular_frequency"):  # the unit decides, whatever the heading says
            name = "angular_frequency" if si == "rad/s" else "frequency"
        if name not in TIMES:
            values[~valid] = np.nan
        columns.append(Column(name, plan.header, plan.unit, si, values, plan.sub_label))
    made, contradictions = with_moduli({column.name: column for column in columns if column.si})
    if not findings.is_contradicted:  # further intervals would say the same
        findings.notes += [f"line {raw.line}: {said}" for said in contradictions]
    findings.is_contradicted |= bool(contradictions)
    columns += [made[name] for name in sorted(made.keys() - {column.name for column in columns})]
    return Interval(raw.test, raw.result, raw.number, raw.declared, point, valid, tuple(columns), raw.line, raw.sheet)


def _plans(raw: RawInterval, path: Path, findings: Findings) -> list[_Plan]:
    """Name the columns; of those with one heading the further ones by their sub-label or a number."""
    plans: list[_Plan] = []
    taken: set[str] = set()
    wanted = needed({name for header in raw.headers if (name := quantity(header))})
    for index, header in enumerate(raw.headers):
        if not header:
            if raw.units[index] or any(text_of(r.cells[index]) for r in raw.rows):
                text, hint = f"column {index + 1} has no name", "Its name was deleted; export the file again."
                raise SourceError(path, text, line=raw.line + 1, hint=hint)
            continue
        name = quantity(header) or slug(header)
        if header.endswith(","):
            findings.note(f'"{header}" is taken as the column {name}: a dot was replaced by a comma')
        sub = raw.sub_labels[index] if index < len(raw.sub_labels) else ""
        is_first = name not in taken
        for other in (f"{name}_{slug(sub)}" if sub else "", slug(header)):
            if name in taken and other:
                name = other
        serial, base = 2, name
        while name in taken:
            name, serial = f"{base}_{serial}", serial + 1
        taken.add(name)
        plans.append(_Plan(index, name, header, sub, raw.units[index], name in TEXT, is_first and name in wanted))
    return plans


def _points(raw: RawInterval, index: int | None, path: Path) -> tuple[Integers, Flags]:
    count = len(raw.rows)
    valid = np.array([not row.is_short for row in raw.rows], dtype=bool)
    if index is None:
        return np.arange(1, count + 1), valid
    point = np.zeros(count, dtype=np.int64)
    before = 0
    for i, row in enumerate(raw.rows):
        text = text_of(row.cells[index])
        if not text:
            continue  # raw waveforms have no number
        found = words.point_number(repaired(text))
        if found is None or found[0] <= before:
            expected = f"a number above {before}" if found else "a point number"
            message = f"found {shorten(text)}, expected {expected}"
            hint = "Rows are missing, repeated or moved; export the file again."
            raise SourceError(path, message, line=row.line, hint=hint)
        point[i] = before = found[0]
        valid[i] &= found[1]
    return point, valid


def _is_free_text(raw: RawInterval, plan: _Plan, signs: Separators) -> bool:
    """Return whether an unknown column without a unit holds a cell that is no number."""
    if plan.unit.strip("[] ") or quantity(plan.header):
        return False
    cells = [c for r in raw.rows if isinstance(c := r.cells[plan.index], str)]
    return any(c.strip() not in _ABSENT and plain_number(c, signs) is None for c in cells)


def _unit(raw: RawInterval, plan: _Plan, path: Path, findings: Findings) -> tuple[float, str] | None:
    """Return factor and SI unit of a column; None of one that is left out."""
    name = quantity(plan.header)
    known = SI_OF.get(name or "")
    try:
        found = unit_of(plan.unit)
    except InputError:
        found = None
        if known is None:
            return 1.0, plan.unit.strip("[] ")  # an unknown quantity keeps its own unit
    if found is not None and (known is None or found.si in known):
        # The radian is often left out; "angular" in the heading says it.
        is_angular = found.si == "1/s" and name == "angular_frequency"
        return found.factor, "rad/s" if is_angular else found.si
    spelled = " or ".join(si for si in known or () if si != "degF")
    text = (
        f"found the unit {shorten(plan.unit)} of {plan.header}, expected one of {spelled}"
        if found is None
        else f'{plan.header} is in "{plan.unit}", expected a unit of {spelled}'
    )
    if not plan.is_needed:
        findings.note(f"line {raw.line + 1}: {text}; the column is left out, nothing is made of it")
        return None
    raise SourceError(path, text, line=raw.line + 1, hint="Correct the row of units, or export again.")


def _numbers(raw: RawInterval, plan: _Plan, signs: Separators, path: Path, findings: Findings) -> Floats:
    values = np.full(len(raw.rows), np.nan)
    strange = []
    for i, row in enumerate(raw.rows):
        # A workbook may hold numbers as text, with a dot whatever the country.
        value = _number(row.cells[plan.index], (DOT, signs) if row.sheet else (signs,))
        if value is None and plan.is_needed:
            column = sum(len(text_of(c)) + 1 for c in row.cells[: plan.index]) + raw.first + 1
            raise not_a_number(text_of(row.cells[plan.index]), path=path, line_number=row.line, column=column)
        if value is None:
            strange.append(row.line)
            value = float("nan")
        values[i] = value
        findings.absent += int(np.isnan(value))
    if strange:
        findings.note(f"{listed(strange)}: {plan.header} holds cells that are no numbers; they are no readings")
    return values


def _number(cell: Cell, signs: Sequence[Separators]) -> float | None:
    """Return a number, NaN for an absent one, None for anything else."""
    if isinstance(cell, float):
        return cell
    text = (cell or "").strip()
    if text in _ABSENT:
        return float("nan")
    return next((v for s in signs if (v := plain_number(text, s)) is not None), None)

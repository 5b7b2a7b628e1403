"""Cells to numbers in SI: decimal sign by evidence, units by file, invalid points to NaN."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from instruments._moduli import with_moduli
from instruments._temperatures import celsius
from instruments.anton_paar import _words as words
from instruments.anton_paar._table import Cell, RawInterval, text_of
from labpipe.arrays import Flags, Floats, Integers
from labpipe.errors import InputError, SourceError
from labpipe.text import DOT, Separators, not_a_number, plain_number, separators, shorten

#: What stands where there is no reading.
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
    """What the reading of the values has to say."""

    notes: list[str] = field(default_factory=list)
    absent: int = 0
    invalid: int = 0
    is_contradicted: bool = False


@dataclass(frozen=True, slots=True)
class _Plan:
    index: int
    name: str
    header: str
    unit: str
    is_text: bool


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
    text = cell.strip()
    for sign in ("E", "e"):
        mantissa, found, _ = text.partition(sign)
        if found:
            return mantissa + "0" if "," in mantissa or "." in mantissa else mantissa
    return text


def interpret(raw: RawInterval, signs: Separators, path: Path, findings: Findings) -> Interval:
    """Turn one table into numbers.

    Raises
    ------
    SourceError
        A cell is no number, a unit is not known or not one of its quantity.
    """
    plans = _plan(raw, path, findings)
    numbers = [p for p in plans if p.name == "point"]
    point, valid = _points(raw, numbers[0].index if numbers else None, path)
    findings.invalid += int((~valid).sum())
    columns = []
    for plan in plans:
        if plan.name == "point":
            continue
        sub = raw.sub_labels[plan.index] if plan.index < len(raw.sub_labels) else ""
        if plan.is_text or _is_free_text(raw, plan, signs):
            text = [words.repaired(text_of(r.cells[plan.index])) for r in raw.rows]
            columns.append(Column(plan.name, plan.header, plan.unit, "", text, sub))
            continue
        factor, si = _unit(raw, plan, path)
        values = _numbers(raw, plan, signs, path, findings) * factor
        if plan.name in words.TEMPERATURES:
            values = celsius(values, si, path=path, line=raw.line + 1, header=plan.header, stated=plan.unit)
            si = "degC"
        name = _by_unit(plan.name, si)
        if name not in ("time", "interval_time"):
            values[~valid] = np.nan
        columns.append(Column(name, plan.header, plan.unit, si, values, sub))
    made, contradictions = with_moduli({column.name: column for column in columns if column.si})
    if not findings.is_contradicted:  # further intervals would say the same
        findings.notes += [f"line {raw.line}: {said}" for said in contradictions]
    findings.is_contradicted |= bool(contradictions)
    columns += [made[name] for name in sorted(made.keys() - {column.name for column in columns})]
    return Interval(raw.test, raw.result, raw.number, raw.declared, point, valid, tuple(columns), raw.line, raw.sheet)


def _plan(raw: RawInterval, path: Path, findings: Findings) -> list[_Plan]:
    plans: list[_Plan] = []
    taken: set[str] = set()
    for index, header in enumerate(raw.headers):
        has_cells = any(text_of(r.cells[index]) for r in raw.rows)
        if not header:
            if has_cells or raw.units[index]:
                text, hint = f"column {index + 1} has no name", "Its name was deleted; export the file again."
                raise SourceError(path, text, line=raw.line + 1, hint=hint)
            continue
        name = words.column_name(header) or words.slug(header)
        if header.endswith(","):
            note = f'"{header}" is taken as the column {name}: a dot was replaced by a comma'
            if note not in findings.notes:
                findings.notes.append(note)
        sub = raw.sub_labels[index] if index < len(raw.sub_labels) else ""
        for other in (f"{name}_{words.slug(sub)}" if sub else "", words.slug(header)):
            if name in taken and other:
                name = other
        serial, base = 2, name
        while name in taken:
            name, serial = f"{base}_{serial}", serial + 1
        taken.add(name)
        plans.append(_Plan(index, name, header, raw.units[index], name in words.TEXT_COLUMNS))
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
        found = words.point_number(words.repaired(text))
        if found is None or found[0] <= before:
            expected = f"a number above {before}" if found else "a point number"
            message = f"found {shorten(text)}, expected {expected}"
            hint = "Rows are missing, repeated or moved; export the file again."
            raise SourceError(path, message, line=row.line, hint=hint)
        point[i] = before = found[0]
        valid[i] &= found[1]
    return point, valid


def _is_free_text(raw: RawInterval, plan: _Plan, signs: Separators) -> bool:
    """Tell a column of text that is not known: no unit, and a cell that is no number."""
    if plan.unit or words.column_name(plan.header):
        return False
    cells = [c for r in raw.rows if isinstance(c := r.cells[plan.index], str)]
    return any(c.strip() not in _ABSENT and plain_number(c, signs) is None for c in cells)


def _unit(raw: RawInterval, plan: _Plan, path: Path) -> tuple[float, str]:
    known = words.SI_OF.get(words.column_name(plan.header) or "")
    try:
        found = words.unit_of(plan.unit) if plan.unit else words.unit_of("[1]")
    except InputError:
        if known is None:
            return 1.0, plan.unit.strip("[] ")  # an unknown quantity keeps its own unit
        text = f"found the unit {shorten(plan.unit)} of {plan.header}, expected one of {' or '.join(known)}"
        raise SourceError(path, text, line=raw.line + 1, hint="Correct the row of units, or export again.") from None
    is_kelvin = found.si == "K" and known is not None and "degC" in known
    if known is not None and found.si not in known and not is_kelvin:
        text = f'{plan.header} is in "{plan.unit}", expected a unit of {" or ".join(known)}'
        hint = "Correct the row of units, or export again; nothing is guessed."
        raise SourceError(path, text, line=raw.line + 1, hint=hint)
    # The radian is often left out; "angular" in the heading says it.
    is_angular = found.si == "1/s" and words.column_name(plan.header) == "angular_frequency"
    return found.factor, "rad/s" if is_angular else found.si


def _by_unit(name: str, si: str) -> str:
    """Name a frequency by its unit: in rad/s it is an angular one, whatever its heading says."""
    if name in ("frequency", "angular_frequency"):
        return "angular_frequency" if si == "rad/s" else "frequency"
    return name


def _numbers(raw: RawInterval, plan: _Plan, signs: Separators, path: Path, findings: Findings) -> Floats:
    values = np.full(len(raw.rows), np.nan)
    for i, row in enumerate(raw.rows):
        # A workbook may hold numbers as text, with a dot whatever the country.
        value = _number(row.cells[plan.index], (DOT, signs) if row.sheet else (signs,))
        if value is None:
            column = sum(len(text_of(c)) + 1 for c in row.cells[: plan.index]) + raw.first + 1
            raise not_a_number(text_of(row.cells[plan.index]), path=path, line_number=row.line, column=column)
        values[i] = value
        findings.absent += int(np.isnan(value))
    return values


def _number(cell: Cell, signs: Sequence[Separators]) -> float | None:
    """Return a number, NaN for an absent one, None for anything else."""
    if isinstance(cell, float):
        return cell
    text = (cell or "").strip()
    if text in _ABSENT:
        return float("nan")
    return next((v for s in signs if (v := plain_number(text, s)) is not None), None)

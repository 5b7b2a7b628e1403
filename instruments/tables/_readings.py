"""From the cells of a table to intervals of readings in SI: the columns that count, their units, and their order.

Strict about the columns that a sweep, a response or a shift factor is made of, indifferent to all others.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from instruments._moduli import celsius, missing, needed, with_moduli
from instruments._quantities import FREQUENCIES, MODULI, RESPONSES, SI_OF, TEMPERATURES, TIMES, fits, slug, unit_of
from instruments.anton_paar import Column, Interval
from instruments.tables._headings import Heading, is_of_parameters, is_unit
from instruments.tables._layout import ABSENT, Block, is_clock, is_numeric
from instruments.tables._mapping import line_to_copy
from labpipe.arrays import Flags, Floats
from labpipe.errors import SourceError, warn_of
from labpipe.text import Separators, listed, not_a_number, plain_number, shorten

Pair = tuple[Heading, Floats]

_NO_READING = 9.9e37  # by which instruments of the SCPI standard say that there is none, or that it overflowed
_SPECIMEN = re.compile(r"(?:sample|specimen|material|probe|probenname|echantillon)(?:_(?:name|id|no|nr|number))?")
_OWN = ("point", "test", "result", "interval", "is_valid", "sample")  # names of the Dataset itself


def intervals(path: Path, block: Block, signs: Separators, first: int) -> list[Interval]:
    """Convert one table; every set or isotherm of it is an interval, numbered from ``first``.

    Raises
    ------
    SourceError
        A cell of a column that is needed is no number, its unit is none of its quantity, or columns of several
        specimens stand side by side.
    """
    _settle_headings(path, block)
    wanted = _needed(path, block)
    for k, heading in enumerate(block.headings):
        named = (
            [row[k] for _, row in block.rows if k < len(row) and row[k]] if _SPECIMEN.fullmatch(heading.name) else []
        )
        names, changes = sorted(set(named)), sum(a != b for a, b in pairwise(named))
        is_counter = all(map(is_numeric, names)) and 2 * changes > len(named)  # of the readings of a sweep
        if 1 < len(names) <= len(named) / 2 and not is_counter:
            text = f"{heading.text} names {len(names)} specimens ({shorten(', '.join(names))})"
            raise SourceError(path, text, line=block.line, hint="Give each specimen a file of its own.")
    short = _short_rows(path, block, wanted)
    values = numbers(path, block, signs, wanted)
    values[short] = np.nan
    point = next((v for h, v in zip(block.headings, values.T, strict=True) if h.name == "point"), None)
    unnumbered = np.zeros(len(values), dtype=bool) if point is None else np.isnan(point) & np.isfinite(point).any()
    found: list[Interval] = []
    for pairs in _parts(path, block, values, wanted):
        columns = _converted(path, block, pairs, wanted)
        is_whole = ~short & ~unnumbered & _are_readings(path, columns)
        for rows in _ordered(columns, len(values)):
            own = np.arange(1, rows.size + 1) if point is None or np.isnan(point).any() else point[rows].astype(int)
            kept = (replace(c, values=np.asarray(c.values)[rows]) for name, c in columns.items() if name != "set")
            title, number = block.title or "table", first + len(found)
            found.append(Interval(path.stem, title, number, None, own, is_whole[rows], tuple(kept)))
    return found


def _settle_headings(path: Path, block: Block) -> None:
    """Take for other quantities the columns that only share a name, and name the temperature and the sets."""
    fitting = {h.name for h in block.headings if h.is_known and fits(h.name, h.unit)}
    for k, heading in enumerate(block.headings):
        cells = [row[k] if k < len(row) else "" for _, row in block.rows]
        # A stiffness K* (N/m) next to E*; a time of day next to frequencies.
        is_other = (
            heading.is_known and heading.unit and heading.name in fitting and not fits(heading.name, heading.unit)
        )
        is_other = is_other or (heading.name in TIMES and any(map(is_clock, cells)))
        if heading.name == "set" and not all(is_numeric(cell) or not cell for cell in cells):
            numbers = {name: str(count) for count, name in enumerate(dict.fromkeys(cells))}
            is_other = len(numbers) == len(cells) > 1  # each row with a name of its own
            for _, row in block.rows if not is_other else ():
                row[k : k + 1] = [numbers[row[k] if k < len(row) else ""]]
        if is_other:
            block.headings[k] = replace(heading, name=slug(heading.text), is_known=False)
        elif heading.name in FREQUENCIES and is_unit(heading.unit):  # the unit decides
            name = {"rad/s": "angular_frequency", "Hz": "frequency"}.get(unit_of(heading.unit).si, heading.name)
            block.headings[k] = replace(heading, name=name)
    if not block.names() & {*TEMPERATURES}:
        places = [k for k, h in enumerate(block.headings) if not h.is_known and h.unit and fits("temperature", h.unit)]
        if len(places) == 1:
            text = block.headings[places[0]].text
            block.headings[places[0]] = replace(block.headings[places[0]], name="temperature", is_known=True)
            warn_of(path, f"{shorten(text)}, the only column in degrees, is taken for the temperature", line=block.line)


def _unit(block: Block, heading: Heading) -> str:
    """Return the unit of a column as stated, or as the format or the quantity leaves no other."""
    if not heading.unit and heading.name == "angular_frequency":
        return "rad/s"
    if not heading.unit and is_of_parameters(block.above):  # RepTate's own units
        usual = {"frequency": "rad/s", "time": "s"}.get(heading.name, "Pa")
        return usual if fits(heading.name, usual) else ""
    return heading.unit


def _needed(path: Path, block: Block) -> set[str]:
    """Return the quantities that a result is made of; refuse one in a unit that is none of it.

    Of other columns in such a unit a note is made, and they count as unknown.
    """
    misfits = [h for h in block.headings if h.is_known and h.name in SI_OF and not fits(h.name, _unit(block, h))]
    names = block.names()
    fitting = names - {heading.name for heading in misfits} | set(block.facts)
    wanted = needed(names)
    stated = [same for same in (FREQUENCIES, {*TEMPERATURES}) if fitting & same]  # by another column, or above
    for heading in misfits:
        unit = heading.unit
        is_in = f"is in {shorten(unit)}" if unit else "has no unit"
        wants = " or ".join(si for si in SI_OF[heading.name] if si != "degF")
        line = block.unit_line or block.line
        if heading.name in wanted and not any(heading.name in same for same in stated):
            hint = "State the units in the headings or in a row below them, or name the columns with their units: "
            hint += line_to_copy(block.headings)
            raise SourceError(path, f"{heading.text} {is_in}, expected a unit of {wants}", line=line, hint=hint)
        at = block.headings.index(heading)
        block.headings[at] = replace(heading, name=slug(heading.text), is_known=False)
        if any(at < len(row) and row[at] for _, row in block.rows) and unit:
            warn_of(path, f"{heading.text} {is_in}; nothing is made of it, so it is kept as written", line=line)
    if any(h.unit.strip("[]() ") == "mPa" and h.name in wanted for h in block.headings):
        message = "moduli are in mPa, which is read as MPa (megapascal); if it is millipascal, write 1e-3 Pa"
        warn_of(path, message, line=block.unit_line or block.line)
    return wanted


def _short_rows(path: Path, block: Block, wanted: set[str]) -> Flags:
    """Find rows that lost cells, in a table whose other rows are whole.

    Which cell was lost is not known, so nothing of such a row is believed. Where every row lacks as many at the end,
    the columns are read in their order from the left, if none that is needed comes so late.
    """
    width = max((k + 1 for k, heading in enumerate(block.headings) if heading.text), default=0)
    widest = max(block.widths)
    if widest > len(block.headings):
        number = next(number for (number, _), w in zip(block.rows, block.widths, strict=True) if w == widest)
        hint = "A cell was added; compare the row with its neighbours."
        if (long := max(len(row) for _, row in block.rows)) > len(block.headings):
            raise SourceError(path, f"found {long} cells, expected {len(block.headings)}", line=number, hint=hint)
    if widest < width:
        late = [heading for heading in block.headings[widest:] if heading.text]
        if any(heading.name in wanted and heading.is_known for heading in late):
            raise SourceError(
                path,
                f"the headings name {width} columns, the rows hold {widest} numbers",
                line=block.line,
                hint=f"Name those that the rows hold by their number: {line_to_copy(block.headings, by_number=True)}",
            )
        names = shorten(", ".join(heading.text for heading in late))
        warn_of(
            path,
            f"the headings name {width} columns, the rows hold {widest} numbers: {names} are taken as absent",
            line=block.line,
        )
        del block.headings[widest:]
        width = widest
    is_short = np.array(block.widths) < width
    if is_short.any():
        short = [number for (number, _), is_one in zip(block.rows, is_short, strict=True) if is_one]
        warn_of(
            path,
            f"{listed(short)}: {len(short)} of {len(block.rows)} rows hold fewer than {width} cells; it is unknown "
            "which are missing, so these rows are marked invalid",
        )
    return is_short


def numbers(path: Path, block: Block, signs: Separators, wanted: set[str]) -> Floats:
    """Return the numbers of all columns, NaN for an absent one; other text is refused in a column that is needed."""
    table = np.full((len(block.rows), len(block.headings)), np.nan)
    strange: dict[str, list[int]] = {}
    for i, (number, cells) in enumerate(block.rows):
        for j, cell in enumerate(cells[: len(block.headings)]):
            if cell.casefold() in ABSENT:
                continue
            value = plain_number(cell, signs)
            heading = block.headings[j]
            if value is None and heading.is_known and heading.name in wanted:
                at = sum(len(before) + 1 for before in cells[:j]) + 1
                raise not_a_number(cell, path=path, line_number=number, column=at)
            if value is None and heading.is_known:
                strange.setdefault(heading.text, []).append(number)
            elif value is not None and abs(value) < _NO_READING:
                table[i, j] = value
    for text, numbers in strange.items():
        warn_of(path, f"{listed(numbers)}: {shorten(text)} holds cells that are no numbers; they are no readings")
    for heading, column in zip(block.headings, table.T, strict=True):
        has_value = np.isfinite(column)  # merged cells of a spreadsheet stand in their first row alone
        if heading.name in (*TEMPERATURES, "set") and has_value[0] and 2 * has_value.sum() <= column.size:
            column[:] = column[np.maximum.accumulate(np.where(has_value, np.arange(column.size), 0))]
    return table


def _parts(path: Path, block: Block, values: Floats, wanted: set[str]) -> Iterator[list[Pair]]:
    """Yield the columns of a table, or those of each frequency or temperature that headings state.

    Of columns side by side, ``E'(1 Hz)`` and ``E'(10 Hz)``, each place is a part; a temperature that is repeated
    before each belongs to the columns to its right.
    """
    pairs = list(zip(block.headings, values.T, strict=True))
    places = list(dict.fromkeys(heading.at for heading in block.headings if heading.at is not None))
    if not places:
        yield _unique(path, block, pairs, wanted)
        return
    for place in places:
        its = [k for k, pair in enumerate(pairs) if pair[0].at == place]
        shared: dict[str, Pair] = {}
        for k, pair in enumerate(pairs):
            if pair[0].at is None and (pair[0].name not in shared or k < its[0]):
                shared[pair[0].name] = pair
        name = pairs[its[0]][0].place
        shared.pop(name, None)
        constant = (Heading(f"{place[0]:g} {place[1]}", name, place[1], is_known=True), np.full(len(values), place[0]))
        yield _unique(path, block, [*shared.values(), *(pairs[k] for k in its), constant], wanted)


def _unique(path: Path, block: Block, pairs: Sequence[Pair], wanted: set[str]) -> list[Pair]:
    """Keep the first of columns with the same quantity; refuse moduli and responses that differ."""
    kept: dict[str, Pair] = {}
    for heading, column in pairs:
        before = kept.setdefault(heading.name, (heading, column))
        if before[1] is column or not heading.is_known or heading.name not in wanted - TIMES:
            continue
        # The same readings, in units of their own or rounded to three digits.
        scale = unit_of(_unit(block, heading)).factor / unit_of(_unit(block, before[0])).factor
        if np.allclose(column * scale, before[1], rtol=2e-3, equal_nan=True):
            continue
        if heading.name in MODULI | RESPONSES:
            raise SourceError(
                path,
                f"several columns are {shorten(heading.text)} and differ, as of several specimens or runs side by side",
                line=block.line,
                hint="Export each to a file of its own, or name the columns of one by their number: "
                + line_to_copy(block.headings, by_number=True),
            )
        message = f"two columns hold {heading.name.replace('_', ' ')} and differ; the first, {before[0].text}, is taken"
        warn_of(path, message, line=block.line)
    return list(kept.values())


def _converted(path: Path, block: Block, pairs: Sequence[Pair], wanted: set[str]) -> dict[str, Column]:
    """Convert columns to SI by the units that the file states, and make the moduli of them."""
    found: dict[str, Column] = {}
    count = len(pairs[0][1])
    for heading, values in pairs:
        if heading.is_known and heading.name != "point":
            if heading.name in wanted or np.isfinite(values).any():
                found[heading.name] = _column(path, block, heading, values)
        elif np.isfinite(values).any() and heading.name not in (*found, *_OWN):
            found[heading.name] = Column(heading.name, heading.text, heading.unit, heading.unit or "1", values)
    for name, (value, unit) in block.facts.items():
        if not found.keys() & (FREQUENCIES if name == "frequency" else {*TEMPERATURES}):
            heading = Heading(f"{name} of the header", name, unit, is_known=True)
            found[name] = _column(path, block, heading, np.full(count, value))
    if "temperature" not in found and "temperature_set" in found:
        found["temperature"] = replace(found["temperature_set"], name="temperature")
    found, contradictions = with_moduli(found)
    for said in contradictions:
        warn_of(path, said, line=block.line)
    for name in ("a_T", "ln_aT"):
        if name in found and "log10_aT" not in found:
            column = found.pop(name)
            shift = np.asarray(column.values, dtype=float)
            if name == "a_T" and (shift <= 0).any():
                raise SourceError(path, f"{column.header} is zero or negative; shift factors are not")
            made = np.log10(shift) if name == "a_T" else shift / np.log(10.0)
            found["log10_aT"] = replace(column, name="log10_aT", si="1", values=made)
    return found


def _column(path: Path, block: Block, heading: Heading, values: Floats) -> Column:
    """Convert one column to SI, temperatures to degC; 1/s of an angular frequency leaves the radian out."""
    stated = _unit(block, heading)
    factor, si = unit_of(stated)
    si = "rad/s" if heading.name == "angular_frequency" else si
    column = (10.0**values if heading.is_logarithm else values) * factor
    if heading.name in TEMPERATURES:
        line = block.unit_line or block.line
        column, si = celsius(column, si, path=path, line=line, header=heading.text, stated=stated), "degC"
    return Column(heading.name, heading.text or heading.name, stated, si, column)


def _are_readings(path: Path, columns: dict[str, Column]) -> Flags:
    """Mark rows of frequency zero, with which analysers mark the steps of a procedure, as no readings."""
    good = np.ones(len(next(iter(columns.values())).values), dtype=bool)
    for name in FREQUENCIES & columns.keys():
        good &= ~(np.asarray(columns[name].values) <= 0.0)
    if not good.all():
        message = f"{np.count_nonzero(~good)} of {good.size} rows have a frequency of zero or below"
        warn_of(path, f"{message}; they are no readings and are marked invalid")
    return good


def _ordered(columns: dict[str, Column], count: int) -> list[NDArray[np.intp]]:
    """Return the rows of every set: by a column that names the sets, else by temperature.

    A grid of temperature and frequency may be sorted by frequency, or not at all. The frequency that occurs most
    often gives the number of isotherms; the widest gaps between temperatures part them. They are taken so where
    the rows are not isotherms one after the other already, and no isotherm then holds a frequency twice.
    """
    everything = np.arange(count)
    if "set" in columns:
        numbers = np.asarray(columns["set"].values, dtype=float)
        numbered = np.maximum.accumulate(np.where(np.isnan(numbers), 0, everything))
        return _groups(numbers[numbered])
    frequency = next((columns[name] for name in sorted(FREQUENCIES & columns.keys())), None)
    temperature = columns.get("temperature_set", columns.get("temperature"))
    if frequency is None or temperature is None:
        return [everything]
    f, t = (np.asarray(column.values, dtype=float) for column in (frequency, temperature))
    if not (np.isfinite(f) & np.isfinite(t)).all():
        return [everything]
    names = np.unique(np.round(np.log(np.where(f > 0, f, 1.0)), 3), return_inverse=True)[1]
    levels = int(np.bincount(names).max())
    seen: set[int] = set()
    runs = 1
    for name in names.tolist():
        if name in seen:
            seen, runs = set(), runs + 1
        seen.add(name)
    if levels == count or runs <= levels:
        return [everything]
    order = np.argsort(t, kind="stable")
    cuts = np.sort(np.argsort(np.diff(t[order]), kind="stable")[count - levels :])
    level = np.empty(count, dtype=int)
    level[order] = np.searchsorted(cuts, np.arange(count) - 1, side="right") if levels > 1 else 0
    is_grid = all(np.bincount(names[level == k]).max() == 1 for k in range(levels))
    return _groups(level.astype(float)) if is_grid else [everything]


def _groups(numbers: Floats) -> list[NDArray[np.intp]]:
    """Return the rows of equal number, in the order in which the numbers begin."""
    _, first, member = np.unique(numbers, return_index=True, return_inverse=True)
    return [np.flatnonzero(member == k) for k in np.argsort(first, kind="stable")]


def lacking(block: Block) -> str:
    """Say which quantity a table lacks to be of use, "" for none."""
    return missing(block.names())

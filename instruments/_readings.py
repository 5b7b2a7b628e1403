"""From the cells of a table to intervals of readings in SI: the columns that count, their units, and their order.

Strict about the columns that a sweep, a response or a shift factor is made of, indifferent to all others.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from instruments._headings import Heading, is_of_parameters
from instruments._intervals import Column, Interval
from instruments._layout import ABSENT, Block, is_clock, is_numeric
from instruments._mapping import line_to_copy
from instruments._moduli import needed, with_moduli
from instruments._quantities import FREQUENCIES, MODULI, RESPONSES, SI_OF, TEMPERATURES, TIMES, is_unit, slug, unit_of
from instruments._sheets import Notes
from labpipe.arrays import Flags, Floats
from labpipe.errors import SourceError
from labpipe.text import Separators, listed, not_a_number, plain_number, shorten
from labpipe.units import ZERO_CELSIUS

Pair = tuple[Heading, Floats]

_NO_READING = 9.9e37  # by which instruments of the SCPI standard say that there is none, or that it overflowed
_SPECIMEN = re.compile(r"(?:sample|specimen|material|probe|probenname|echantillon)(?:_(?:name|id|no|nr|number))?")
_OWN = ("point", "test", "result", "interval", "is_valid", "sample")  # names of the Dataset itself


def intervals(notes: Notes, block: Block, signs: Separators, first: int) -> list[Interval]:
    """Convert one table; every set or isotherm of it is an interval, numbered from ``first``.

    SourceError where a needed cell is no number, its unit is none of its quantity, or there are several specimens.
    """
    fitting = {h.name for h in block.headings if h.is_known and is_unit(h.unit, h.name)}
    for k, heading in enumerate(block.headings):
        cells = [row[k] if k < len(row) else "" for _, row in block.rows]
        # A stiffness K* (N/m) next to E*, or a time of day next to frequencies, only shares a name.
        is_misfit = heading.is_known and heading.unit and not is_unit(heading.unit, heading.name)
        is_other = (is_misfit and heading.name in fitting) or (heading.name in TIMES and any(map(is_clock, cells)))
        if heading.name == "set" and not all(is_numeric(cell) or not cell for cell in cells):
            numbered = {name: str(count) for count, name in enumerate(dict.fromkeys(cells))}
            is_other = len(numbered) == len(cells) > 1  # each row with a name of its own
            for _, row in block.rows if not is_other else ():
                row[k : k + 1] = [numbered[row[k] if k < len(row) else ""]]
        if is_other:
            block.headings[k] = replace(heading, name=slug(heading.text), is_known=False)
        named = [cell for cell in cells if cell] if _SPECIMEN.fullmatch(heading.name) else []
        names, changes = sorted(set(named)), sum(a != b for a, b in pairwise(named))
        is_counter = all(map(is_numeric, names)) and 2 * changes > len(named)  # of the readings of a sweep
        if 1 < len(names) <= len(named) / 2 and not is_counter:
            text = f"{heading.text} names {len(names)} specimens ({shorten(', '.join(names))})"
            hint = "Give each specimen a file of its own."
            raise SourceError(block.place(notes.path), text, line=block.line, hint=hint)
    wanted = settled_units(notes, block)
    short = short_rows(notes, block, wanted)
    values = numbers(notes, block, signs, wanted)
    values[short] = np.nan
    point = next((v for h, v in zip(block.headings, values.T, strict=True) if h.name == "point"), None)
    unnumbered = np.zeros(len(values), dtype=bool) if point is None else np.isnan(point) & np.isfinite(point).any()
    found: list[Interval] = []
    for pairs in _parts(notes, block, values, wanted):
        columns = converted(notes, block, pairs, wanted)
        is_whole = ~short & ~unnumbered
        for name in FREQUENCIES & columns.keys():  # with a frequency of zero analysers mark the steps of a procedure
            is_step = np.asarray(columns[name].values) <= 0.0
            if is_step.any():
                text = "rows have a frequency of zero or below; they are no readings and are marked invalid"
                notes.add(f"{np.count_nonzero(is_step)} of {is_step.size} {text}")
            is_whole &= ~is_step
        for rows in _ordered(columns, len(values)):
            own = np.arange(1, rows.size + 1) if point is None or np.isnan(point).any() else point[rows].astype(int)
            kept = (replace(c, values=np.asarray(c.values)[rows]) for name, c in columns.items() if name != "set")
            title, number = block.title or "table", first + len(found)
            found.append(Interval(notes.path.stem, title, number, None, own, is_whole[rows], tuple(kept)))
    return found


def _unit(block: Block, heading: Heading) -> str:
    """Return the unit of a column as stated, or as the format or the quantity leaves no other."""
    if not heading.unit and heading.name == "angular_frequency":
        return "rad/s"
    if not heading.unit and is_of_parameters(block.above):  # RepTate's own units
        usual = {"frequency": "rad/s", "time": "s"}.get(heading.name, "Pa")
        return usual if is_unit(usual, heading.name) else ""
    return heading.unit


def settled_units(notes: Notes, block: Block) -> set[str]:
    """Return the quantities that a result is made of; refuse one in a unit that is none of it, and note other columns.

    The unit decides which frequency a column holds.
    """
    for k, heading in enumerate(block.headings):
        if heading.is_known and heading.name in FREQUENCIES and is_unit(heading.unit):
            name = {"rad/s": "angular_frequency", "Hz": "frequency"}.get(unit_of(heading.unit).si, heading.name)
            block.headings[k] = replace(heading, name=name)
    misfits = [h for h in block.headings if h.is_known and h.name in SI_OF and not is_unit(_unit(block, h), h.name)]
    names = block.names()
    fitting = names - {heading.name for heading in misfits} | set(block.facts)
    wanted = needed(names)
    stated = [same for same in (FREQUENCIES, {*TEMPERATURES}) if fitting & same]  # by another column, or above
    line = block.unit_line or block.line
    for heading in misfits:
        text = f"{heading.text} is in {shorten(heading.unit)}" if heading.unit else f"{heading.text} has no unit"
        text += f", expected a unit of {' or '.join(si for si in SI_OF[heading.name] if si != 'degF')}"
        if heading.name in wanted and not any(heading.name in same for same in stated):
            hint = "State the units in the headings or in a row below them, or name the columns with their units: "
            raise SourceError(block.place(notes.path), text, line=line, hint=hint + line_to_copy(block.headings))
        at = block.headings.index(heading)
        block.headings[at] = replace(heading, name=slug(heading.text), is_known=False)
        if any(at < len(row) and row[at] for _, row in block.rows) and heading.unit:
            notes.add(f"{text}; nothing is made of it, so it is kept as written", line)
    if any(h.unit.strip("[]() ") == "mPa" and h.name in wanted for h in block.headings):
        notes.add("moduli are in mPa, which is read as MPa (megapascal); if it is millipascal, write 1e-3 Pa", line)
    return wanted


def short_rows(notes: Notes, block: Block, wanted: set[str]) -> Flags:
    """Find rows that lost cells, of which nothing is believed, in a table whose other rows are whole.

    Where every row lacks as many at the end, the columns are read from the left, if none that is needed comes so late.
    """
    path = block.place(notes.path)
    width = max((k + 1 for k, heading in enumerate(block.headings) if heading.text), default=0)
    widest = max(block.widths)
    long = max(len(row) for _, row in block.rows)
    if long > len(block.headings):
        number = next(number for (number, _), w in zip(block.rows, block.widths, strict=True) if w == widest)
        hint = "A cell was added; compare the row with its neighbours."
        raise SourceError(path, f"found {long} cells, expected {len(block.headings)}", line=number, hint=hint)
    if widest < width:
        late = [heading for heading in block.headings[widest:] if heading.text]
        text = f"the headings name {width} columns, the rows hold {widest} numbers"
        if any(heading.name in wanted and heading.is_known for heading in late):
            hint = f"Name those that the rows hold by their number: {line_to_copy(block.headings, by_number=True)}"
            raise SourceError(path, text, line=block.line, hint=hint)
        names = shorten(", ".join(heading.text for heading in late))
        notes.add(f"{text}: {names} are taken as absent", block.line)
        del block.headings[widest:]
        width = widest
    is_short = np.array(block.widths) < width
    if short := [number for (number, _), is_one in zip(block.rows, is_short, strict=True) if is_one]:
        text = f"{listed(short)}: {len(short)} of {len(block.rows)} rows hold fewer than {width} cells; it is unknown "
        notes.add(f"{text}which are missing, so these rows are marked invalid")
    return is_short


def numbers(notes: Notes, block: Block, signs: Separators, wanted: set[str]) -> Floats:
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
                column = sum(len(before) + 1 for before in cells[:j]) + block.inset + 1
                raise not_a_number(cell, path=block.place(notes.path), line_number=number, column=column)
            if value is None and heading.is_known:
                strange.setdefault(heading.text, []).append(number)
            elif value is not None and abs(value) < _NO_READING:
                table[i, j] = value
    for text, lines in strange.items():
        notes.add(f"{listed(lines)}: {shorten(text)} holds cells that are no numbers; they are no readings")
    for heading, values in zip(block.headings, table.T, strict=True):
        has_value = np.isfinite(values)  # merged cells of a spreadsheet stand in their first row alone
        if heading.name in (*TEMPERATURES, "set") and has_value[0] and 2 * has_value.sum() <= values.size:
            values[:] = values[np.maximum.accumulate(np.where(has_value, np.arange(values.size), 0))]
    return table


def _parts(notes: Notes, block: Block, values: Floats, wanted: set[str]) -> Iterator[list[Pair]]:
    """Yield the columns of a table, or those of each place side by side, as ``E'(1 Hz)`` and ``E'(10 Hz)``.

    A temperature that is repeated before each belongs to the columns to its right.
    """
    pairs = list(zip(block.headings, values.T, strict=True))
    places = list(dict.fromkeys(heading.at for heading in block.headings if heading.at is not None))
    if not places:
        yield _unique(notes, block, pairs, wanted)
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
        yield _unique(notes, block, [*shared.values(), *(pairs[k] for k in its), constant], wanted)


def _unique(notes: Notes, block: Block, pairs: Sequence[Pair], wanted: set[str]) -> list[Pair]:
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
            text = f"several columns are {shorten(heading.text)} and differ, as of several specimens or runs side by "
            hint = "Export each to a file of its own, or name the columns of one by their number: "
            hint += line_to_copy(block.headings, by_number=True)
            raise SourceError(block.place(notes.path), f"{text}side", line=block.line, hint=hint)
        message = f"two columns hold {heading.name.replace('_', ' ')} and differ; the first, {before[0].text}, is taken"
        notes.add(message, block.line)
    return list(kept.values())


def converted(notes: Notes, block: Block, pairs: Sequence[Pair], wanted: set[str]) -> dict[str, Column]:
    """Convert columns to SI by the units that the file states, and make the moduli of them."""
    found: dict[str, Column] = {}
    path, own = block.place(notes.path), {heading.name for heading, _ in pairs}
    facts = [
        (Heading(f"{name} of the header", name, unit, is_known=True), np.full(len(block.rows), value))
        for name, (value, unit) in block.facts.items()
        if not own & (FREQUENCIES if name == "frequency" else {*TEMPERATURES})
    ]
    for heading, values in [*pairs, *facts]:
        name, stated = heading.name, _unit(block, heading)
        if heading.is_known and name != "point" and (name in wanted or np.isfinite(values).any()):
            factor, si = unit_of(stated)
            column = (10.0**values if heading.is_logarithm else values) * factor
            if name in TEMPERATURES:
                scales = {"K": column - ZERO_CELSIUS, "degF": (column - 32.0) * 5.0 / 9.0}
                if (scales.get(si, column) < -ZERO_CELSIUS).any():
                    text = f'{heading.text} is in "{stated}" and holds {np.nanmin(column):g}, below absolute zero'
                    hint = "Correct the row of units, or export again."
                    raise SourceError(path, text, line=block.unit_line or block.line, hint=hint)
                column, si = scales.get(si, column), "degC"
            si = "rad/s" if name == "angular_frequency" else si  # 1/s leaves the radian out
            found[name] = Column(name, heading.text or name, stated, si, column)
        elif not heading.is_known and np.isfinite(values).any() and name not in (*found, *_OWN):
            found[name] = Column(name, heading.text, stated, stated.strip("[] ") or "1", values)
    if "temperature" not in found and "temperature_set" in found:
        found["temperature"] = replace(found["temperature_set"], name="temperature")
    found = with_moduli(found)
    for name in ("a_T", "ln_aT"):
        if name in found and "log10_aT" not in found:
            shifts = found.pop(name)
            shift = np.asarray(shifts.values, dtype=float)
            if name == "a_T" and (shift <= 0).any():
                raise SourceError(path, f"{shifts.header} is zero or negative; shift factors are not")
            made = np.log10(shift) if name == "a_T" else shift / np.log(10.0)
            found["log10_aT"] = replace(shifts, name="log10_aT", si="1", values=made)
    return found


def _ordered(columns: dict[str, Column], count: int) -> list[NDArray[np.intp]]:
    """Return the rows of every set: by a column that names the sets, else by temperature, whatever their order.

    The frequency that occurs most often gives the number of isotherms; the widest gaps between temperatures part them,
    where the rows are not isotherms one after the other already and no isotherm then holds a frequency twice.
    """
    everything = np.arange(count)
    if "set" in columns:
        numbers = np.asarray(columns["set"].values, dtype=float)
        return _groups(numbers[np.maximum.accumulate(np.where(np.isnan(numbers), 0, everything))])
    frequency = next((columns[name] for name in sorted(FREQUENCIES & columns.keys())), None)
    temperature = columns.get("temperature_set", columns.get("temperature"))
    if frequency is None or temperature is None:
        return [everything]
    f, t = (np.asarray(column.values, dtype=float) for column in (frequency, temperature))
    if not (np.isfinite(f) & np.isfinite(t)).all():
        return [everything]
    names = np.unique(np.round(np.log(np.where(f > 0, f, 1.0)), 3), return_inverse=True)[1]
    levels, runs, seen = int(np.bincount(names).max()), 1, set[int]()
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

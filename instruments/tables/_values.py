"""From the cells of a table to columns in SI: what is a reading, its unit, and the moduli that columns make."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from instruments import anton_paar
from instruments._moduli import are_confirmed, missing, with_moduli
from instruments._symbols import FREQUENCIES
from instruments._temperatures import celsius
from instruments.anton_paar import Column
from instruments.tables import _words
from instruments.tables._cells import ABSENT, BLANKS, is_numeric, plain
from instruments.tables._columns import (
    BESIDE,
    UNITLESS,
    Pair,
    example,
    name_the_temperature,
    of_their_unit,
    parted,
    without_clocks,
)
from instruments.tables._layout import Block, is_of_parameters
from instruments.tables._words import Heading
from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError, SourceError, warn_of
from labpipe.text import Separators, listed, not_a_number, plain_number, shorten

_NO_READING = 9.9e37  # by which instruments of the SCPI standard say that there is none, or that it overflowed
_ALONE = "Cells hold numbers alone; the units stand in the headings or in a row below them."
_WITH_UNIT = re.compile(r"[+-]?\d[\d.,]*(?:[eE][+-]?\d+)?\s*(?:°\s?[CF]|[A-Za-z%][\w/°]*)")
_SPECIMEN = (
    "sample",
    "specimen",
    "material",
    "probe",
    "sample_name",
    "sample_id",
    "specimen_id",
    "echantillon",
    "name",
)
# What names a row of statistics below readings, in the languages of exports.
_STATISTICS = (
    "mean", "average", "avg", "median", "min", "max", "minimum", "maximum", "std", "stdev", "std.dev", "std dev",
    "standard deviation", "sd", "s.d", "cv", "rsd", "variance", "mittelwert", "standardabweichung", "moyenne",
    "écart-type", "ecart type", "media", "promedio", "desviación estándar", "n", "count", "anzahl", "sum", "summe",
    "range", "spannweite", "sigma", "σ",
)  # fmt: skip
_OWN = ("point", "test", "result", "interval", "is_valid", "sample")  # names of the Dataset itself


class Table:
    """One table of the file, converted to SI.

    Attributes
    ----------
    block : Block
    columns : dict of str to Column
        With storage and loss modulus, where they can be made.
    is_whole : array of bool
        False of rows that lost cells.
    missing : str
        What is missing in it, in words; "" of a complete table.
    """

    def __init__(self, path: Path, block: Block, signs: Separators) -> None:
        self.block = block
        if not block.rows:
            raise SourceError(path, "found no row of numbers below the headings", line=block.line, hint=_ALONE)
        self.missing = missing(block.names())
        self.columns: dict[str, Column] = {}
        self.is_whole = np.ones(len(block.rows), dtype=bool)
        if self.missing:
            return
        block.headings = without_clocks(block, of_their_unit(block.headings))
        name_the_temperature(path, block)
        _leave_out_statistics(path, block)
        _number_sets(block)
        unnamed = _end_without_numbers(block)
        short = _short_rows(path, block)
        values = _values(path, block, signs)
        values[short] = np.nan
        _tell_of_specimens(path, block)
        _fill_merged(block, values)
        parts = list(parted(path, block, values))
        self.is_whole = np.tile(~short, len(parts))
        converted = [] if missing(block.names()) else [_converted(path, block, part) for part in parts]
        if unnamed:
            _check_order(path, block, unnamed, converted[0] if converted else {})
        self.columns = _joined(converted)
        self._leave_out_marks(path)

    def _leave_out_marks(self, path: Path) -> None:
        """Mark rows of frequency zero invalid, with which analysers mark the steps of a procedure."""
        for name in ("frequency", "angular_frequency"):
            if name in self.columns:
                is_none = np.asarray(self.columns[name].values) <= 0.0
                if is_none.any():
                    warn_of(
                        path,
                        f"{int(is_none.sum())} of {is_none.size} rows have a frequency of zero or below; "
                        "they are no readings and are marked invalid",
                    )
                self.is_whole &= ~is_none


def _leave_out_statistics(path: Path, block: Block) -> None:
    """Take rows of means and deviations, which programs and people put below readings, out of a table."""
    named = [k for k, heading in enumerate(block.headings) if k == 0 or heading.is_known]
    kept = [
        not any(row[k].casefold().strip(" .:") in _STATISTICS for k in named if k < len(row)) for _, row in block.rows
    ]
    if not all(kept) and any(kept):
        left_out = [number for (number, _), is_kept in zip(block.rows, kept, strict=True) if not is_kept]
        warn_of(path, f"{listed(left_out)}: rows of means or deviations are no readings; left out")
        block.rows = [row for row, is_kept in zip(block.rows, kept, strict=True) if is_kept]
        block.widths = [width for width, is_kept in zip(block.widths, kept, strict=True) if is_kept]


def _number_sets(block: Block) -> None:
    """Give sets that are named in words, ``ramp``, ``sweep``, numbers; a name of each row's own tells of none."""
    for k, heading in enumerate(block.headings):
        names = [row[k] if k < len(row) else "" for _, row in block.rows]
        if heading.name != "set" or all(is_numeric(name) or not name for name in names):
            continue
        number = {name: str(count) for count, name in enumerate(dict.fromkeys(names))}
        if len(number) == len(names) > 1:
            block.headings[k] = replace(heading, name=anton_paar.slug(heading.text), is_known=False)
            continue
        for (_, row), name in zip(block.rows, names, strict=True):
            if k < len(row):
                row[k] = number[name]


def _end_without_numbers(block: Block) -> list[Heading]:
    """Take the last headings off where rows between blanks hold fewer numbers, and return them.

    An empty column leaves no trace between blanks, so it may have been any: :func:`_check_order` decides.
    """
    count = max(block.widths)
    width = max((k + 1 for k, heading in enumerate(block.headings) if heading.text), default=0)
    if block.separator != BLANKS or min(block.widths) < count or width <= count:
        return []
    unnamed = block.headings[count:width]
    del block.headings[count:]
    return unnamed


def _check_order(path: Path, block: Block, unnamed: list[Heading], columns: dict[str, Column]) -> None:
    """Refuse columns that were counted from the left, unless what is given twice agrees."""
    count = len(block.headings)
    message = f"the headings name {count + len(unnamed)} columns, the rows hold {count} numbers between blanks"
    if not are_confirmed(columns):
        block.headings += unnamed
        hint = f'Name the columns in order: columns="{example(block)}", without those that hold no numbers.'
        raise SourceError(path, message, line=block.line, hint=hint)
    warn_of(
        path,
        f"{message}; {', '.join(heading.text for heading in unnamed)} at the end are taken as "
        "empty, for the moduli agree with what else is given of them",
        line=block.line,
    )


def _short_rows(path: Path, block: Block) -> Flags:
    """Find rows that lost cells, in a table whose other rows are whole.

    Which cell was lost is not known: two numbers may have become one, and those behind it stand in
    the wrong columns. An empty cell is no lost one; nor are those that every row lacks alike.
    """
    width = max((k + 1 for k, heading in enumerate(block.headings) if heading.text), default=0)
    is_short = np.array(block.widths) < width
    if is_short.all() and len(set(block.widths)) <= 1:
        return np.zeros(len(block.rows), dtype=bool)
    short = [number for (number, _), is_one in zip(block.rows, is_short, strict=True) if is_one]
    if short:
        warn_of(
            path,
            f"{listed(short)}: {len(short)} of {len(block.rows)} rows hold fewer than "
            f"{width} cells; it is unknown which are missing, so these rows are marked invalid",
        )
    return is_short


def _values(path: Path, block: Block, signs: Separators) -> Floats:
    """Return the numbers of the known columns, NaN for an absent one; text of others is no number."""
    width = len(block.headings)
    table = np.full((len(block.rows), width), np.nan)
    for i, (number, cells) in enumerate(block.rows):
        if len(cells) > width:
            text, hint = (
                f"found {len(cells)} cells, expected {width}",
                "A cell was added; compare the row with its neighbours.",
            )
            raise SourceError(path, text, line=number, hint=hint)
        for j, cell in enumerate(cells):
            if cell.casefold() in ABSENT:
                continue
            value = plain_number(plain(cell).replace("D", "E").replace("d", "e"), signs)
            if value is not None and abs(value) >= _NO_READING:
                continue
            if value is None and block.headings[j].is_known:
                if _WITH_UNIT.fullmatch(cell):
                    raise SourceError(path, f"found {shorten(cell)}, expected a number alone", line=number, hint=_ALONE)
                at = sum(len(before) + 1 for before in cells[:j]) + 1
                raise not_a_number(cell, path=path, line_number=number, column=at)
            table[i, j] = np.nan if value is None else value
    return table


def _fill_merged(block: Block, values: Floats) -> None:
    """Give every row the temperature or number of its set where cells of a spreadsheet were merged."""
    for heading, column in zip(block.headings, values.T, strict=True):
        stated = np.isfinite(column)
        is_merged = heading.name in ("temperature", "temperature_set", "set") and stated[0]
        if is_merged and 2 * np.count_nonzero(stated) <= column.size:
            column[:] = column[np.maximum.accumulate(np.where(stated, np.arange(column.size), 0))]


def _tell_of_specimens(path: Path, block: Block) -> None:
    """Say that a column names several specimens, whose rows are read as those of one."""
    for k, heading in enumerate(block.headings):
        if heading.name in _SPECIMEN:
            names = sorted({row[k] for _, row in block.rows if k < len(row) and row[k]})
            if len(names) > 1:
                warn_of(
                    path,
                    f"{heading.text} names {len(names)} specimens ({shorten(', '.join(names))}), "
                    "which are read as one; if they are of different materials, give each a file of its own",
                    line=block.line,
                )


def _converted(path: Path, block: Block, pairs: Sequence[Pair]) -> dict[str, Column]:
    """Convert columns to SI by the units that the file states, and make the moduli of them."""
    found: dict[str, Column] = {}
    for heading, values in pairs:
        # What is not made use of is kept as written where its unit is not one of its quantity.
        is_used = heading.is_known and not (
            heading.name in BESIDE and not (np.isfinite(values).any() and _words.fits(heading.name, heading.unit))
        )
        if not is_used:
            if np.isfinite(values).any() and heading.name not in (*found, *_OWN):
                found[heading.name] = Column(heading.name, heading.text, heading.unit, heading.unit or "1", values)
            continue
        if heading.name not in found:
            found[heading.name] = _column(path, block, heading, values)
    count = len(next(iter(found.values())).values)
    for name, (value, unit) in block.facts.items():
        has = found.keys() & (FREQUENCIES if name == "frequency" else {name})
        if not has:
            heading = Heading(f"{name} of the header", name, unit, is_known=True)
            found[name] = _column(path, block, heading, np.full(count, value))
    if "temperature" not in found and "temperature_set" in found:
        found["temperature"] = replace(found["temperature_set"], name="temperature")
    found, contradictions = with_moduli(found)
    for said in contradictions:
        warn_of(path, said, line=block.line)
    return _with_log_shift(path, found)


def _column(path: Path, block: Block, heading: Heading, values: Floats) -> Column:
    """Convert one column to SI."""
    name, stated = heading.name, heading.unit
    wanted = _words.SI_OF.get(name, ("1",))
    if not stated and name == "angular_frequency":
        stated = "rad/s"  # that is what an angular frequency is in
    if not stated and is_of_parameters(block.above[1]):
        stated = {"frequency": "rad/s", "time": "s"}.get(name, "Pa" if "Pa" in wanted else "")  # RepTate's own units
    try:
        unit = _words.unit_of(stated) if stated or name in UNITLESS or "1" in wanted else None
    except InputError:
        unit = None
    if unit is None or unit.si not in wanted:
        is_in = f"is in {shorten(stated)}" if stated else "has no unit"
        spelled = " or ".join(dict.fromkeys("degC" if si == "degF" else si for si in wanted))
        raise SourceError(
            path,
            f"{heading.text} {is_in}, expected a unit of {spelled}",
            line=block.unit_line or block.line,
            hint="State the units in the headings or in a row below them, or give all columns in order: "
            f'columns="{example(block)}".',
        )
    if stated.strip("[]() ") == "mPa":
        warn_of(
            path,
            f"{heading.text} is in mPa, which is read as MPa (megapascal); if it is in millipascal, write 1e-3 Pa",
            line=block.unit_line or block.line,
        )
    column = 10.0**values if heading.is_logarithm else values
    si = "rad/s" if name == "angular_frequency" else "Hz" if name == "frequency" else unit.si
    factor = unit.factor
    if name == "angular_frequency" and unit.si == "Hz":
        factor *= 2.0 * np.pi
    if name == "frequency" and unit.si == "rad/s":
        factor /= 2.0 * np.pi
    column = column * factor
    if "degC" in wanted:
        line = block.unit_line or block.line
        column, si = celsius(column, si, path=path, line=line, header=heading.text, stated=stated), "degC"
    return Column(name, heading.text or name, stated, si, column)


def _with_log_shift(path: Path, columns: dict[str, Column]) -> dict[str, Column]:
    """Return shifts as their decimal logarithm, however they were written."""
    for name in ("a_T", "ln_aT"):
        if name not in columns or "log10_aT" in columns:
            continue
        column = columns.pop(name)
        values = np.asarray(column.values, dtype=float)
        if name == "a_T" and (values <= 0).any():
            raise SourceError(path, f"{column.header} is zero or negative; shift factors are not")
        found = np.log10(values) if name == "a_T" else values / np.log(10.0)
        columns["log10_aT"] = replace(column, name="log10_aT", si="1", values=found)
    return columns


def _joined(parts: Sequence[dict[str, Column]]) -> dict[str, Column]:
    """Put tables that stood side by side one below the other, numbered as sets."""
    if len(parts) == 1:
        return parts[0]
    names = [name for name in parts[0] if all(name in part for part in parts)]
    joined = {
        name: replace(parts[0][name], values=np.concatenate([np.asarray(part[name].values) for part in parts]))
        for name in names
    }
    count = len(next(iter(parts[0].values())).values)
    numbers = np.repeat(np.arange(len(parts), dtype=float), count)
    return joined | {"set": Column("set", "", "", "1", numbers)}

"""Tables of sweeps, of responses over time and of shift factors, and tables whose columns the user names."""

import json
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import xarray as xr

from instruments._headings import stated_in_title
from instruments._intervals import Interval, assemble
from instruments._layout import COMMA, Block, Lines, blocks, signs_of
from instruments._mapping import Columns, chosen, line_to_copy, located, suggestion, time_step
from instruments._moduli import missing
from instruments._quantities import SHIFTS
from instruments._readings import intervals
from instruments._sheets import Notes, open_sheets
from instruments.tables._traces import trace
from labpipe.errors import SourceError
from labpipe.text import DOT, check_decimal
from labpipe.units import Measure

DEVICE = "plain table of a dynamic mechanical analysis"
_HEADER = 100  # lines in which a file states how it is written
_DECIMAL = re.compile(r"#DE[CZ]IMAL:\s*(\w+)")
_SIGNS = {"point": ".", "punkt": ".", "comma": ",", "komma": ","}


def read(
    path: str | os.PathLike[str],
    *,
    columns: Columns | None = None,
    cycle: Measure | None = None,
    encoding: str | None = None,
    decimal: str | None = None,
    allow_incomplete: bool = False,
) -> xr.Dataset:
    """Read sweeps, responses over time or shift factors from a table, or the columns of any table that are named.

    Parameters
    ----------
    path : path-like
        Text with TAB, semicolon, comma or blanks between the columns, or a workbook (.xlsx, .xls, .ods).
    columns : mapping or str, optional
        Quantity to the heading of its column, ``{"time": "Time (s)", "displacement": "Position (m)"}``, to its
        number from 1, or to both with a unit, ``{"column": "Position", "unit": "m"}``; the same as text, as in
        session.toml. Or all columns in their order with their units, ``"f (Hz), E' (MPa), E'' (MPa), T (degC)"``.
        By default the quantities are recognised by their headings.
    cycle : str or float or Quantity, optional
        Time between the rows of a displacement without a column of times and without ``Delta_X`` of LabVIEW.
    encoding, decimal : str, optional
        By default decided from the file.
    allow_incomplete : bool
        Drop a last row that has no line end; by default it is kept if it is whole, and else refused.

    Returns
    -------
    Dataset
        Over ``sample``, as :func:`instruments.anton_paar.read`: ``frequency`` [Hz], ``storage_modulus``,
        ``loss_modulus`` [Pa], ``temperature`` [degC] where the file gives it; ``interval`` counts the sets and tables.
        Of responses ``time`` [s] and ``relaxation_modulus`` [Pa] or ``creep_compliance`` [1/Pa]; of shifts
        ``temperature`` and ``log10_aT``. Of a named displacement as :func:`instruments.keyence.read`, of position and
        force (compression positive) as :func:`instruments.mach1.read`.

    Raises
    ------
    SourceError
        With file, line and column of the fault.

    Warns
    -----
    UserWarning
        Columns, rows or tables that nothing is made of are left out; a last line has no end.
    """
    check_decimal(decimal)
    notes, named = Notes(Path(path)), None if columns is None else chosen(columns)
    path, opened = notes.path, open_sheets(notes, encoding, allow_incomplete=allow_incomplete)
    found = [(title, [(1, title), *own] if own and stated_in_title(title) else own) for title, own in opened.sheets]
    open_line = opened.open_line
    stated = (_DECIMAL.match(line) for _, lines in found for _, line in lines[:_HEADER])
    decimal = decimal or next((_SIGNS.get(word[1].casefold()) for word in stated if word), None)
    if named is None:
        return _sweeps(notes, _blocks(path, found), decimal, open_line, opened.encoding)
    faults: list[SourceError] = []
    for _, own in found:  # the first sheet that has them
        try:
            block = located(path, own, named)
            break
        except SourceError as error:
            faults.append(error)
    else:
        raise next((each for each in faults if each.line), (*faults, SourceError(path, "the file holds no line"))[0])
    if {each.name for each in named}.isdisjoint({"displacement", "force"}):
        return _sweeps(notes, [block], decimal, open_line, opened.encoding)
    if open_line == block.rows[-1][0]:
        notes.add("the last line has no line end; if the file was cut, its last number is wrong", open_line)
    signs = DOT if block.separator == COMMA else signs_of(path, [block], decimal)
    made = trace(notes, block, signs, cycle, time_step(own, block.line))
    return made.assign_attrs(source=path.name, encoding=opened.encoding, decimal=signs.decimal)


def _blocks(path: Path, found: Sequence[tuple[str, Lines]]) -> list[Block]:
    """Find the tables; sheets and lines without any, such as remarks, are passed over."""
    tables = [replace(block, sheet=title) for title, lines in found for block in blocks(lines)]
    whole = [block for block in tables if block.rows]
    if tables and not whole:
        text = "found no row of numbers below the headings"
        hint = "Cells hold numbers alone; the units stand in the headings or in a row below them."
        raise SourceError(tables[0].place(path), text, line=tables[0].line, hint=hint)
    if not whole:
        hint = next((text for _, lines in found if (text := suggestion(lines))), "")
        hint = hint or """columns = "f (Hz), E' (MPa), E'' (MPa), T (degC)\""""
        text = "no line names the columns: expected frequency, temperature, storage and loss modulus (or tan δ, phase)"
        line = next((lines[0][0] for _, lines in found if lines), 1)
        hint = f"Name the columns in a first line, or say which they are: {hint}"
        raise SourceError(path, f"{text}, or temperature and log_aT", line=line, hint=hint)
    return whole


def _sweeps(notes: Notes, tables: list[Block], decimal: str | None, open_line: int, encoding: str) -> xr.Dataset:
    """Convert the tables that can be used to one Dataset; refuse a file that has none, naming the missing quantity."""
    path, last = notes.path, tables[-1]
    if open_line and last.rows and last.rows[-1][0] == open_line:
        if len(last.rows[-1][1]) < max(len(row) for _, row in last.rows):
            text = "the last line has no line end and fewer cells than the others; it is cut"
            hint = "Complete the line, or drop it with allow_incomplete=True."
            raise SourceError(path, text, line=open_line, hint=hint)
        text = "the last line has no line end; it is kept, as no cell is missing; if the file was cut, its end is wrong"
        notes.add(text, open_line)
    lacking = [missing(block.names()) for block in tables]
    whole = [block for block, text in zip(tables, lacking, strict=True) if not text]
    if not whole:
        block = tables[0]
        known = [h.name for h in block.headings if h.is_known and h.name not in ("point", "set")]
        names = dict.fromkeys(name.replace("_", " ") for name in known)
        hint = "Export the table again with it; if a column is there under another name, name all that are needed: "
        text = f"found {', '.join(names)}; no {lacking[0]}"
        raise SourceError(block.place(path), text, line=block.line, hint=hint + line_to_copy(block.headings))
    sweeps = [block for block in whole if not block.names() & SHIFTS]
    if sweeps and len(sweeps) < len(whole):
        notes.add("a table of shift factors among the readings is left out; give it as a file of its own")
        whole = sweeps
    for block, text in zip(tables, lacking, strict=True):
        if text:
            title = f' "{block.title or block.sheet}"' if block.title or block.sheet else ""
            notes.add(f"the table{title} is left out: it has no {text}", block.line)
    signs = signs_of(path, tables, decimal)
    made: list[Interval] = []
    for block in whole:
        made += intervals(notes, block, signs, len(made) + 1)
    sizes = [interval.point.size for interval in made]
    is_cut = len(sizes) > 2 and len(set(sizes[:-1])) == 1 and sizes[-1] < sizes[0]
    if is_cut:
        notes.add(f"the last set holds {sizes[-1]} rows, all others {sizes[0]}; the file may be cut")
    work = {"bytes_read": path.stat().st_size, "rows_read": sum(sizes), "intervals_read": len(made)}
    facts = {
        "instrument": DEVICE,
        "layout": "plain table",
        "encoding": encoding,
        "header": "",
        "work": json.dumps(work),
    }
    facts |= {"delimiter": whole[0].separator, "decimal": signs.decimal}
    return assemble(made, path, **facts, **({"incomplete": 1} if is_cut else {}))

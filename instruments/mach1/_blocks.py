"""The grammar of Mach-1 Motion text files: lines to blocks, in the units of the file.

::

    <Mach-1 File>
    <INFO> … <END INFO>                     one block: its header,
    <Sinusoid>                              its function and declared parameters,
    Frequency, Hz:→0.10000
    <DATA>                                  and its rows (→ is one TAB)
    Time, s→Position (z), mm→Fz, gf
    0.000000→1.877600→20051.351733
    <divider>                               end of a ramp, the time goes on
    <END DATA>
    <INFO> …                                the next block; its time restarts at zero

Everything that departs from it is refused with file, line and column.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError, SourceError, warn_of
from labpipe.text import Separators, TextFile, not_a_number, parse_rows, plain_number, shorten
from labpipe.units import Unit, unit

TITLE = "<Mach-1 File>"
DIVIDER = "<divider>"
END_DATA = "<END DATA>"
_STRUCTURE = frozenset({"Mach-1 File", "INFO", "END INFO", "DATA", "END DATA", "divider"})
_TAG = re.compile(r"<([^<>\t]+)>\s*")
_COPY_AGAIN = "The recording stopped, or the file was copied before it was complete: copy it again, or read the "
_COPY_AGAIN += "readings that are there with allow_incomplete=True."
#: Functions that always record; one of them without rows is a file cut short.
_RECORDING = frozenset({"Stress Relaxation", "Find Contact", "Sinusoid"})
#: Functions that may end a file without having recorded anything.
_SILENT = frozenset({"Move Relative", "Move Absolute", "Wait", "Zero Load"})

#: Declared numbers by their key (without unit), and the variable each becomes.
DECLARED = {
    "Amplitude": "declared_amplitude",
    "Velocity": "declared_velocity",
    "Stage Velocity": "declared_velocity",
    "Frequency": "declared_frequency",
    "Freqency": "declared_frequency",  # so spelt by the software of about 2017
    "Number of Cycles": "declared_number_of_cycles",
    "Number of Ramp": "declared_number_of_ramps",
    "Fixed Relaxation Time": "declared_relaxation_time",
    "Relaxation Rate": "declared_relaxation_rate",
    "Time for Measurement of the Slope": "declared_slope_time",
    "Contact Criteria": "declared_contact_force",
    "Stop criteria": "declared_contact_force",
    "Stage Limit": "declared_stage_limit",
    "Offset": "declared_offset",
}

_INFO_NUMBERS = re.compile(r"Load Cell (Calibration Factor|Offset|Low-pass filter (Order|Cutoff frequency \(Hz\)))")
# A unit that lost a letter may be another unit ("mm" and "m"), so only those met are taken.
_UNITS = {
    r"Time": {"s"},
    r"Position \([xyz]\)": {"mm", "um", "µm"},
    r"Position \(theta\)": {"deg"},
    r"F[xyz]": {"N", "mN", "gf", "kgf"},
    r"T[xyz]": {"N-mm", "N·mm", "Nmm"},
}
_DECLARED_UNITS = frozenset({"1", "s", "mm", "deg", "mm/s", "deg/s", "Hz", "N", "gf", "N/min", "gf/min"})
_UNITS_MET = "Units of Mach-1 files are s; mm, um; deg; N, mN, gf, kgf; N-mm."
_NOT_SET = frozenset({"", "None", "N/A"})
_BATCH = 1 << 16  # rows parsed at a time: the text of a mapping file never is whole in memory


class Column(NamedTuple):
    """One column: its header cell as written, the quantity, and the unit's text and meaning."""

    header: str
    quantity: str
    unit_text: str
    unit: Unit


class Parameter(NamedTuple):
    """One ``key:→value`` line, with number and unit where it holds a number in a known unit."""

    key: str
    text: str
    number: float | None
    unit: Unit | None


@dataclass(frozen=True, slots=True)
class Block:
    """One block of a file, as written.

    ``function`` is its tag without brackets; ``info_lines``, ``parameter_lines`` are unchanged; ``columns`` are empty
    without a data section; ``values`` (row, column) are in the units of the file; ``dividers`` count the rows before
    each divider; ``is_complete`` if the data section is ended.
    """

    function: str
    info_lines: tuple[str, ...]
    parameter_lines: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    columns: tuple[Column, ...]
    values: Floats
    dividers: tuple[int, ...] = ()
    has_data: bool = True
    is_complete: bool = True

    @property
    def info(self) -> dict[str, str]:
        """Keys and values of the header."""
        return dict(filter(None, map(pair_of, self.info_lines)))


class Cursor:
    """The current line of a file with its number; ``None`` after the last. The caller may allow departures."""

    def __init__(self, source: TextFile, decimal: str, allow_incomplete: bool) -> None:
        self.source, self.signs, self.allow_incomplete = source, Separators(decimal, ""), allow_incomplete
        self.cut: str | None = None
        self.number = 0
        self._lines = source.lines()
        self.advance()

    def advance(self) -> None:
        """Go to the next line; a cut last line is put aside, as a number that lost digits still reads as one."""
        self.line = next(self._lines, None)
        self.number += self.line is not None
        is_cut = self.number == self.source.n_lines and not self.source.is_ended
        if is_cut and self.line is not None and self.line.rstrip() != END_DATA:
            self.cut, self.line = self.line, None

    def rows(self) -> Iterator[str]:
        """Go on to the next line that starts with a tag."""
        while self.line is not None and not self.line.startswith("<"):
            yield self.line
            self.advance()

    def refuse_incomplete(self, message: str) -> None:
        """Refuse a file that ends too early, or only warn where the caller allows it."""
        if self.cut is not None:
            message += f"; the line is {shorten(self.cut)}"
        if not self.allow_incomplete:
            raise self.error(message, hint=_COPY_AGAIN)
        warn_of(self.source.path, message, line=self.number)

    def error(self, message: str, column: int = 1, hint: str | None = None) -> SourceError:
        """Make the error for the current line."""
        return SourceError(self.source.path, message, line=max(self.number, 1), column=column, hint=hint)

    def number_of(self, text: str, is_needed: bool) -> float | None:
        """Return the number behind the tab of the current line; SourceError for no number where one is needed."""
        value = plain_number(text, self.signs)
        if value is None and is_needed:
            column = (self.line or "").find("\t") + 2
            raise not_a_number(text, path=self.source.path, line_number=self.number, column=column)
        return value


def tag_of(line: str | None) -> str | None:
    """Return the text between the brackets of a tag, None for any other line."""
    match = _TAG.fullmatch(line) if line is not None else None
    return match[1] if match else None


def pair_of(line: str, separators: tuple[str, ...] = (":\t", "\t")) -> tuple[str, str] | None:
    """Split at the first colon that a tab follows: values hold colons of their own, as ``25kg SN:1886652``."""
    for separator in separators:
        key, found, value = line.partition(separator)
        if found and key.strip():
            return key.strip(), value.strip()
    return (line.rstrip("\t ")[:-1], "") if line.rstrip("\t ").endswith(":") else None


def parse(cursor: Cursor) -> list[Block]:
    """Read all blocks of a file; SourceError with line and column of the first departure from the grammar."""
    if tag_of(cursor.line) != "Mach-1 File":
        hint = "Mach-1 Motion text files begin with this line; take the file as the program wrote it, not one that a "
        text = f"found {shorten(cursor.line or cursor.cut or '')}, expected {TITLE}"
        raise cursor.error(text, hint=f"{hint}spreadsheet saved.")
    cursor.advance()
    blocks: list[Block] = []
    info_lines: tuple[str, ...] | None = None
    is_header_used = True
    while cursor.line is not None:
        tag = tag_of(cursor.line)
        if tag == "INFO" and is_header_used:
            info_lines, is_header_used = _read_info(cursor), False
        elif tag is not None and info_lines is not None and tag not in _STRUCTURE:
            blocks.append(_read_block(cursor, tag, info_lines))
            is_header_used = True
        elif tag == "Mach-1 File" or not cursor.line.strip():
            if tag:
                text = f"a second {TITLE}: two files were joined; their blocks are numbered through"
                warn_of(cursor.source.path, text, line=cursor.number)
            cursor.advance()
        else:
            expected = "<INFO> or the tag of a function" if is_header_used else "a function's tag"
            raise cursor.error(f"found {shorten(cursor.line)}, expected {expected}")
    if not blocks:
        raise cursor.error("the file ends before its first block", hint=_COPY_AGAIN)
    if blocks[-1].is_complete and (cursor.cut is not None or not is_header_used):
        cursor.refuse_incomplete("the file ends between two blocks")
        blocks[-1] = replace(blocks[-1], is_complete=False)
    return blocks


def _read_info(cursor: Cursor) -> tuple[str, ...]:
    lines: list[str] = []
    opened = cursor.number
    cursor.advance()
    while tag_of(cursor.line) != "END INFO":
        if cursor.line is None:
            cursor.refuse_incomplete(f"the file ends inside the header that opens on line {opened}")
            return tuple(lines)
        pair = pair_of(cursor.line)
        if tag_of(cursor.line) or pair is None:
            raise cursor.error(f"found {shorten(cursor.line)}, expected 'Key:', a tab and a value, or <END INFO>")
        # a header number that is none would be passed over later without a word
        cursor.number_of(pair[1], _INFO_NUMBERS.fullmatch(pair[0]) is not None)
        lines.append(cursor.line)
        cursor.advance()
    cursor.advance()
    return tuple(lines)


def _read_block(cursor: Cursor, function: str, info_lines: tuple[str, ...]) -> Block:
    cursor.advance()
    lines: list[str] = []
    parameters: list[Parameter] = []
    for line in cursor.rows():
        lines.append(line)
        pair = pair_of(line, (":\t",))
        if pair is None and function in _RECORDING:
            raise cursor.error(f"found {shorten(line)}, expected 'Key:', a tab and a value")
        if pair is None:  # functions that are not known may hold tables of coordinates
            continue
        key, text = pair
        name, unit_text = parts_of(key)
        value = cursor.number_of(text, name in DECLARED and text not in _NOT_SET)
        if name in DECLARED and unit_text not in _DECLARED_UNITS:
            message = f"found the unit {shorten(unit_text)}, expected one of {', '.join(sorted(_DECLARED_UNITS))}"
            raise cursor.error(message, column=len(name) + 3)
        parameters.append(parameter_of(key, text, value))
    block = Block(function, info_lines, tuple(lines), tuple(parameters), (), np.empty((0, 0)), has_data=False)
    if tag_of(cursor.line) == "DATA":
        return _read_data(cursor, block)
    if cursor.line is None and (function not in _SILENT or cursor.cut is not None):
        cursor.refuse_incomplete(f"the file ends inside <{function}>")
        return replace(block, is_complete=False)
    if function in _RECORDING:
        raise cursor.error(f"found {shorten(cursor.line or '')}, expected <DATA> of <{function}>")
    return block


def parameter_of(key: str, text: str, value: float | None) -> Parameter:
    """Make a parameter: a number with a unit where the key ends with one that is known, else a text."""
    unit_text = parts_of(key)[1]
    return Parameter(key, text, value, unit(unit_text) if value is not None and is_known(unit_text) else None)


def parts_of(key: str) -> tuple[str, str]:
    """Split a key such as ``Velocity, mm/s`` into name and unit, "1" where it has none."""
    name, _, unit_text = key.rpartition(", ")
    return (name, unit_text) if name else (key, "1")


def is_known(unit_text: str) -> bool:
    """Return whether a unit is one of labpipe's."""
    try:
        return bool(unit(unit_text))
    except InputError:
        return False


def _read_data(cursor: Cursor, block: Block) -> Block:
    cursor.advance()
    columns, n_rows = _read_columns(cursor), 0
    parts: list[Floats] = []
    dividers: list[int] = []
    starts: list[tuple[int, int]] = []  # (rows before, line number): to name the line of a row
    while cursor.line is not None and tag_of(cursor.line) != "END DATA":
        if tag_of(cursor.line) == "divider":
            dividers.append(n_rows)
            cursor.advance()
            continue
        if cursor.line.startswith("<") or not columns:
            raise cursor.error(f"found {shorten(cursor.line)}, expected a row, {DIVIDER} or {END_DATA}")
        path, first, rows = cursor.source.path, cursor.number, cursor.rows()
        starts.append((n_rows, first))
        while batch := list(islice(rows, _BATCH)):
            at = first + n_rows - starts[-1][0]
            parts.append(parse_rows(batch, len(columns), "\t", path=path, first_line=at, signs=cursor.signs))
            n_rows += len(batch)
    is_complete = cursor.line is not None
    if not is_complete:
        cursor.refuse_incomplete(f"the file ends inside <{block.function}>, expected {END_DATA}")
    cursor.advance()
    values = np.concatenate(parts) if parts else np.empty((0, len(columns)))
    time = values[:, 0] if len(values) else np.zeros(1)  # which must be a grid from zero
    steps = np.diff(time)
    interval = float(np.median(steps)) if steps.size else 0.0
    for wrong, fault in (
        (np.flatnonzero(steps <= 0) + 1, "the time does not go on"),
        (np.flatnonzero(np.abs(steps - interval) > interval / 2) + 1, "rows are missing or added: the step is not "),
        (np.flatnonzero(np.abs(time[:1]) > interval / 2), "the first rows are missing: time must start at zero"),
    ):
        if wrong.size:
            row = int(wrong[0])
            before, line = max(start for start in starts if start[0] <= row)
            found = f"from {time[row - 1]:.6f} to {time[row]:.6f} s" if row else f"at {time[0]:.6f} s"
            text = f"{fault}{f'{interval:.6f} s' if fault.endswith(' ') else ''} ({found})"
            hint = "The file was joined, repaired or edited: copy it from the instrument again."
            raise SourceError(cursor.source.path, text, line=line + row - before, column=1, hint=hint)
    block = replace(block, columns=columns, values=values, dividers=tuple(dividers))
    return replace(block, has_data=True, is_complete=is_complete)


def _read_columns(cursor: Cursor) -> tuple[Column, ...]:
    """Parse the header row; its cells are ``quantity, unit``, split at tabs only."""
    if cursor.line is None or cursor.line.startswith("<"):
        return ()
    columns: list[Column] = []
    unknown = []
    position = 1
    for cell in cursor.line.rstrip("\t").split("\t"):
        quantity, separator, unit_text = cell.strip().rpartition(", ")
        if not separator:
            raise cursor.error(f"found {shorten(cell)}, expected a quantity, a comma and its unit", column=position)
        met = next((units for name, units in _UNITS.items() if re.fullmatch(name, quantity)), None)
        if not (is_known(unit_text) if met is None else unit_text in met):
            message = f"found the unit {shorten(unit_text)}, expected {' or '.join(sorted(met or ()))}"
            message = message if is_known(unit_text) else f'unknown unit "{unit_text}"'
            raise cursor.error(message, column=position + len(quantity) + 2, hint=_UNITS_MET)
        unknown += [shorten(cell)] if met is None else []
        if quantity in (column.quantity for column in columns):
            raise cursor.error(f"there are two columns {shorten(quantity)}")
        columns.append(Column(cell, quantity, unit_text, unit(unit_text)))
        position += len(cell) + 1
    if columns[0].quantity != "Time":
        raise cursor.error(f"found {shorten(columns[0].header)}, expected 'Time, s' as first column")
    if unknown:
        text = f"the column {', '.join(unknown)} is not known; it is read under its own name"
        warn_of(cursor.source.path, text, line=cursor.number)
    cursor.advance()
    return tuple(columns)

"""Markers that Keyence sensors write for missing readings, and the layout of numbers.

The names of the states are those of Keyence's own library (LKIF2); SUSPECT is ours, for tokens whose meaning is not
documented. A marker becomes NaN and its state, never a number.
"""

import re
from enum import IntEnum
from typing import NamedTuple


class Status(IntEnum):
    """State of one reading."""

    VALID = 0
    RANGEOVER_P = 1
    RANGEOVER_N = 2
    WAITING = 3
    ALARM = 4
    INVALID = 5
    SUSPECT = 6


#: Patterns of whole cells, without case, and the states that they stand for; the first that fits counts.
MARKERS: tuple[tuple[str, Status], ...] = (
    (r"\+F{7}", Status.RANGEOVER_P),  # LK-G serial, LK-G5000 library
    (r"-F{7}", Status.RANGEOVER_N),
    (r"F{7}", Status.SUSPECT),  # forum, not documented
    (r"X{8}", Status.WAITING),  # LK-G serial
    (r"-{5,8}", Status.WAITING),  # display and library: no judgement yet
    (r"alarm", Status.ALARM),
    (r"invalid", Status.INVALID),
    (r"-1048576|0xFFF00000", Status.INVALID),  # LK-G5000 Ethernet: output unused
    (r"[+-]?E+\.E+", Status.ALARM),  # IL serial: sensor error
    (r"\+100000000", Status.ALARM),  # IL Ethernet
    (r"\+099999999", Status.RANGEOVER_P),
    (r"-099999999", Status.RANGEOVER_N),
    (r"-099999998|-999999", Status.INVALID),  # IL Ethernet, CL-3000 serial
    (r"-9999\.999|-999\.9999", Status.SUSPECT),  # forum, not documented
    (r"#NAME\?|#VALUE!", Status.SUSPECT),  # a spreadsheet took a marker for a formula
)
_ANY = re.compile("|".join(f"(?:{pattern})" for pattern, _ in MARKERS), re.IGNORECASE)

_IL_NINES = re.compile(r"[+-](?:99\.999|999\.99|9999\.9)")  # of the IL series, where a column has this layout

#: Markers that also read as numbers, and numbers of all nines; rows that hold one are looked at cell by cell.
NUMERIC_MARKER = re.compile(r"[+-](?:1048576|100000000|0?9[9.,]*8?)(?![\d.])")

_NUMBER = re.compile(r"([+-]?)([0-9]+)(?:[.,]([0-9]*))?")


class Layout(NamedTuple):
    """How every number of a column is written: signed, digits before and after the sign."""

    is_signed: bool
    whole: int
    decimals: int


def layout(cell: str) -> Layout | None:
    """Return the layout of a number, None for anything else."""
    match = _NUMBER.fullmatch(cell.strip())
    return Layout(bool(match[1]), len(match[2]), len(match[3] or "")) if match else None


def marker_status(cell: str, column: Layout | None = None) -> Status | None:
    """Return the state that a cell stands for, None for any other cell.

    ``column`` is the layout of the column when it is fixed: all nines are a legal number there unless they are the
    largest that it can show.
    """
    cell = cell.strip()
    if _ANY.fullmatch(cell):
        return next(status for pattern, status in MARKERS if re.fullmatch(pattern, cell, re.IGNORECASE))
    found = layout(cell)
    if found is None or column is None or not found.is_signed or set(cell[1:]) - set("9.,"):
        return None
    if found == column and found.whole > 1:
        return Status.RANGEOVER_P if cell.startswith("+") else Status.RANGEOVER_N
    return Status.SUSPECT if _IL_NINES.fullmatch(cell.replace(",", ".")) else None

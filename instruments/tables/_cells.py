"""Cells of a line of a table: what parts them, and which of them are numbers, dates or nothing."""

import csv
import re
from collections.abc import Sequence

#: Ways to part a line, in the order in which they are tried.
TAB, SEMICOLON, COMMA, BAR, GAPS, BRACKETS, BLANKS = "\t", ";", ",", "|", "two blanks", "after brackets", "blanks"
SEPARATORS = (TAB, SEMICOLON, COMMA, BAR, GAPS, BRACKETS, BLANKS)
OF_ROWS = (TAB, SEMICOLON, COMMA, BAR, BLANKS)

#: What stands where there is no reading.
ABSENT = (
    "", "-", "--", "---", "nan", "n/a", "na", "n.a.", "n. a.", "nd", "n.d.", "n. d.", "n.v.", "k.a.", "s.o.", "null",
    "none", "missing", "invalid", "error", "err", "failed", "#n/a", "#num!", "#div/0!", "#value!", "#ref!",
    *("*" * count for count in range(1, 9)), *("#" * count for count in range(1, 16)), "?", "...",
    "inf", "-inf", "+inf", "infinity", "∞", "1.#inf", "-1.#inf", "1.#ind", "-1.#ind", "1.#qnan",
    "over", "under", "overload", "overflow", "underflow", "ovld", "ovl", "ovf", "ovr", "ol", "o.l.",
)  # fmt: skip

_POWER = r"\s*[x×*·]\s*10\^?\(?([+-]?\d+)\)?"
_GROUPS = r"\d{1,3}(?:['\u2019\u00a0\u202f ]\d{3})+"
_NUMERIC = re.compile(rf"[+-]?(?:(?:{_GROUPS}|\d)[\d.,]*|[.,]\d+)(?:[eEdD][+-]?\d+|{_POWER})?")
_GROUPED = re.compile(rf"([+-]?{_GROUPS})((?:[.,]\d*)?(?:[eEdD].*)?)")
_TIMES_TEN = re.compile(_POWER + "$")
_RAISED = re.compile("(?<=10)[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_LOWERED = str.maketrans("⁻⁺⁰¹²³⁴⁵⁶⁷⁸⁹", "-+0123456789")
_BARE_POWER = re.compile(r"^([+-]?)10\^\(?([+-]?\d+)\)?$")
_DATE = r"\d{1,4}([-/.])\d{1,2}\1\d{1,4}"
_CLOCK = re.compile(rf"(?:{_DATE}[T ,]*)?\d{{1,2}}:\d{{2}}(?::\d{{2}}(?:[.,]\d+)?)?(?:\s*[AP]M)?", re.IGNORECASE)


def cells(line: str, separator: str) -> list[str]:
    """Part one line into cells."""
    if separator in (TAB, SEMICOLON, COMMA, BAR):
        text = line.strip().strip("|") if separator == BAR else line
        # A quotation mark that stands for two primes does not begin a quotation.
        quoted = re.search(rf'(?:^|{re.escape(separator)})\s*"[^"]*"\s*(?:{re.escape(separator)}|$)', text)
        if quoted:
            return [cell.strip() for cell in next(csv.reader([text], delimiter=separator, skipinitialspace=True))]
        return [cell.strip() for cell in text.split(separator)]
    if separator == GAPS:
        return re.split(r"\s{2,}|\t", line.strip())
    if separator == BRACKETS:
        return re.split(r"(?<=[)\]])\s+", line.strip())
    return line.split()


def trimmed(found: list[str]) -> list[str]:
    """Drop what a spreadsheet padded at the end of a line."""
    while found and not found[-1]:
        found = found[:-1]
    return found


def is_numeric(cell: str) -> bool:
    """Tell whether a cell can be a number, whatever its decimal sign."""
    return _NUMERIC.fullmatch(_with_powers(cell.strip())) is not None


def is_clock(cell: str) -> bool:
    """Tell a time of day, a date, or both, which are no number.

    Examples
    --------
    >>> is_clock("14:02:11,5"), is_clock("2021-03-06 14:02"), is_clock("14.02")
    (True, True, False)
    """
    return _CLOCK.fullmatch(cell) is not None


def _with_powers(cell: str) -> str:
    """Write raised digits and a bare power of ten out: ``10⁻²`` is 1e-2."""
    raised = _RAISED.sub(lambda match: "^" + match[0].translate(_LOWERED), cell)
    return _BARE_POWER.sub(r"\g<1>1e\2", raised)


def plain(cell: str) -> str:
    """Return a number without what people put in: blanks or apostrophes between thousands, ×10^.

    Examples
    --------
    >>> plain("1'234'567.5"), plain("2 500,0"), plain("1.2x10^6")
    ('1234567.5', '2500,0', '1.2e6')
    """
    cell = _with_powers(cell)
    grouped = _GROUPED.fullmatch(cell)
    text = re.sub(r"\D", "", grouped[1]) if grouped else cell
    if grouped:
        sign = cell[0] if cell[0] in "+-" else ""
        text = sign + text + grouped[2]
    return _TIMES_TEN.sub(r"e\1", text)


def numbers_of(line: str) -> list[str]:
    """Return the cells of a line that are all numbers, [] of another line.

    Examples
    --------
    >>> numbers_of("1;2,5;3"), numbers_of("1 2 three")
    (['1', '2,5', '3'], [])
    """
    rows = (trimmed(cells(line, way)) for way in (TAB, SEMICOLON, COMMA, BLANKS))
    return next((row for row in rows if is_all_numbers(row)), [])


def is_all_numbers(row: Sequence[str]) -> bool:
    """Tell whether every cell of a row, of two at least, is a number or says that there is no reading."""
    return len(row) > 1 and all(is_numeric(cell) or cell.casefold() in ABSENT for cell in row)

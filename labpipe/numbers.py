"""Numbers in text files: the decimal sign, and what counts as a number."""

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from labpipe.errors import InputError

_MOST_LISTED = 5  # lines
_NUMBER = re.compile(r"\s*[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\s*")


class Separators(NamedTuple):
    """The decimal sign of a file, and its thousands sign ("" when it has none)."""

    decimal: str
    thousands: str


#: What instruments write unless a spreadsheet of another country has been at the file.
DOT = Separators(".", "")


def is_number(cell: str) -> bool:
    """Tell whether a cell is a finite decimal number with a dot (not ``nan``, not ``1_000``).

    Examples
    --------
    >>> is_number("+00.1234"), is_number("1,5"), is_number("nan")
    (True, False, False)
    """
    return _NUMBER.fullmatch(cell) is not None and abs(float(cell)) != float("inf")


def check_decimal(given: str | None) -> None:
    """Refuse another decimal sign than the dot and the comma.

    Raises
    ------
    InputError
        It is another; None says that the file decides.
    """
    if given not in (None, ".", ","):
        raise InputError(f'decimal must be "." or ",", found "{given}"')


_GROUPED = {
    ",": re.compile(r"[+-]?[1-9][0-9]{0,2}(?:,[0-9]{3})+(?:\.[0-9]*)?"),
    ".": re.compile(r"[+-]?[1-9][0-9]{0,2}(?:\.[0-9]{3})+(?:,[0-9]*)?"),
}


def separators(cells: Iterable[str]) -> Separators:
    """Decide from cells which sign is the decimal one, or refuse to guess.

    ``0,010`` and ``1,5`` can only have a decimal comma, ``1,234,567`` only thousands, ``1.234,5``
    shows both; but ``1,234`` alone may be either, and a file that shows nothing else is refused.

    Parameters
    ----------
    cells : iterable of str
        Cells of one file, already split at the delimiter; those that are no numbers are ignored.

    Returns
    -------
    Separators

    Raises
    ------
    InputError
        The evidence is ambiguous or contradicts itself.

    Examples
    --------
    >>> separators(["+00,1234", "-00,0120"])
    Separators(decimal=',', thousands='')
    >>> separators(["1.234,50", "2,00"])
    Separators(decimal=',', thousands='.')
    """
    proved: set[Separators] = set()
    ambiguous: str | None = None
    for cell in map(str.strip, cells):
        verdict = _evidence(cell)
        if verdict is None:
            continue
        if verdict:
            proved.add(verdict[0])
        else:
            ambiguous = ambiguous or cell
    return _weigh(proved, ambiguous)


def _evidence(cell: str) -> tuple[Separators, ...] | None:
    """Return what a cell proves; () when it may be read in two ways; None when it says nothing."""
    has_comma, has_dot = "," in cell, "." in cell
    if not (has_comma or has_dot) or not cell.strip("+-").replace(",", "").replace(".", "").isdigit():
        return None
    sign, other = (",", ".") if has_comma else (".", ",")
    if has_comma and has_dot:
        decimal = max(sign, other, key=cell.rfind)
        thousands = "," if decimal == "." else "."
        is_regular = _GROUPED[thousands].fullmatch(cell) is not None
        return (Separators(decimal, thousands),) if is_regular else None
    grouped = _GROUPED[sign].fullmatch(cell) is not None
    if cell.count(sign) > 1:
        return (Separators(other, sign),) if grouped else None
    # One dot is the decimal sign unless something else in the file proves otherwise.
    if grouped:
        return ()
    return (Separators(sign, ""),)


def _weigh(proved: set[Separators], ambiguous: str | None) -> Separators:
    decimals = {each.decimal for each in proved}
    if len(decimals) > 1:
        raise InputError(
            "both the dot and the comma are used as decimal sign; "
            'say which one is meant with decimal="." or decimal=","'
        )
    if proved:
        thousands = max(each.thousands for each in proved)
        return Separators(decimals.pop(), thousands)
    if ambiguous is not None and "," in ambiguous:
        raise InputError(
            f'"{ambiguous}" may hold a decimal comma or a thousands comma, and nothing else in '
            'the file decides it; say which with decimal="." or decimal=","'
        )
    return Separators(".", "")


def plain_number(cell: str, signs: Separators = DOT) -> float | None:
    """Read one cell, or return None when it is not a finite number with these signs.

    Examples
    --------
    >>> plain_number("1.234,50", Separators(",", "."))
    1234.5
    >>> plain_number("1.5", Separators(",", "")) is None
    True
    """
    if signs != DOT:
        other = "." if signs.decimal == "," else ","
        if other in cell:
            if signs.thousands != other or not _GROUPED[other].fullmatch(cell.strip()):
                return None
            cell = cell.replace(other, "")
        cell = cell.replace(signs.decimal, ".")
    return float(cell) if is_number(cell) else None


def listed(lines: Sequence[int]) -> str:
    """Name lines for a message.

    Examples
    --------
    >>> listed([3]), listed([3, 7]), listed(range(10, 20))
    ('line 3', 'lines 3, 7', 'lines 10, 11, 12, 13, 14 and 5 more')
    """
    shown = ", ".join(map(str, lines[:_MOST_LISTED]))
    more = f" and {len(lines) - _MOST_LISTED} more" if len(lines) > _MOST_LISTED else ""
    return f"line{'s' * (len(lines) > 1)} {shown}{more}"


def shorten(text: str, length: int = 60) -> str:
    """Quote a piece of a file for a message: control characters escaped, long text cut.

    Examples
    --------
    >>> shorten("1.2e" + "0" * 99, length=8)
    "'1.2e000…'"
    """
    return repr(text if len(text) <= length else text[: length - 1] + "…")

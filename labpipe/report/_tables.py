"""Formatting of texts and of numbers with units and uncertainties, and tables of them.

Values arrive in SI and leave with the prefix that fits their size: 0.0015 with the unit "m" is
shown as 1.5 mm. A value with a standard uncertainty is rounded as the GUM (JCGM 100:2008, 7.2.6)
recommends: two significant digits of the uncertainty, and the value to the same place.
"""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from statistics import median
from typing import Any, NamedTuple

from labpipe.errors import InputError

NOT_AVAILABLE = "–"
MINUS = "\N{MINUS SIGN}"

# SI unit -> the forms a reader expects, as (factor to SI, text), largest first.
_FORMS: dict[str, tuple[tuple[float, str], ...]] = {
    "1": ((1.0, ""),),
    "m": ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm")),
    "m2": ((1.0, "m²"), (1e-6, "mm²"), (1e-12, "µm²")),
    "s": ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")),
    "Hz": ((1e9, "GHz"), (1e6, "MHz"), (1e3, "kHz"), (1.0, "Hz"), (1e-3, "mHz")),
    "m/s": ((1.0, "m/s"), (1e-3, "mm/s"), (1e-6, "µm/s")),
    "m/s2": ((1e3, "km/s²"), (1.0, "m/s²"), (1e-3, "mm/s²")),
    "m/px": ((1e-3, "mm/px"), (1e-6, "µm/px"), (1e-9, "nm/px")),
    "kg": ((1.0, "kg"), (1e-3, "g"), (1e-6, "mg")),
    "kg/m3": ((1.0, "kg/m³"),),
    "N": ((1e3, "kN"), (1.0, "N"), (1e-3, "mN"), (1e-6, "µN")),
    "N/m": ((1e6, "MN/m"), (1e3, "kN/m"), (1.0, "N/m"), (1e-3, "mN/m")),
    "N/s": ((1.0, "N/s"), (1e-3, "mN/s")),
    "N m": ((1.0, "N·m"), (1e-3, "mN·m"), (1e-6, "µN·m"), (1e-9, "nN·m")),
    "Pa": ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa"), (1.0, "Pa"), (1e-3, "mPa")),
    "1/Pa": ((1.0, "1/Pa"), (1e-3, "1/kPa"), (1e-6, "1/MPa"), (1e-9, "1/GPa")),
    "Pa s": ((1e9, "GPa·s"), (1e6, "MPa·s"), (1e3, "kPa·s"), (1.0, "Pa·s"), (1e-3, "mPa·s")),
    "J": ((1.0, "J"), (1e-3, "mJ"), (1e-6, "µJ"), (1e-9, "nJ")),
    "J/m2": ((1.0, "J/m²"), (1e-3, "mJ/m²")),
    "J/m": ((1.0, "J/m"), (1e-3, "mJ/m"), (1e-6, "µJ/m")),
    "rad": ((math.pi / 180, "°"),),
    "V": ((1.0, "V"), (1e-3, "mV"), (1e-6, "µV")),
    "m/V": ((1.0, "m/V"), (1e-3, "mm/V"), (1e-6, "µm/V")),
    "degC": ((1.0, "°C"),),
    "deg": ((1.0, "°"),),
}

# Plain decimals are read at a glance inside this range, powers of ten outside it.
_PLAIN_FROM, _PLAIN_BELOW = 1e-4, 1e6
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Control characters, half characters, and marks that reorder the text around them, so that a name reads as another one.
_UNWANTED = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff\u202a-\u202e\u2066-\u2069\u200e\u200f\u061c]"
)


def clean(text: str) -> str:
    """Replace control characters, half characters and reordering marks."""
    if text.isascii() and text.isprintable():
        return text
    return _UNWANTED.sub("\N{REPLACEMENT CHARACTER}", text.replace("\r\n", "\n"))


class DisplayUnit(NamedTuple):
    """A unit as it is shown: ``shown = SI value / factor``."""

    factor: float
    text: str


def display_unit(values: Iterable[float], unit: str) -> DisplayUnit:
    """Choose the prefix in which the values are read most easily.

    Parameters
    ----------
    values : iterable of float
        Numbers in SI; the median of their magnitudes decides. NaN, infinities and zeros are
        left out.
    unit : str
        SI unit text as in a Dataset's ``units``. Any other text is shown unchanged.

    Examples
    --------
    >>> display_unit([0.0015, 0.007], "m")
    DisplayUnit(factor=0.001, text='mm')
    >>> display_unit([3.1e9], "Pa").text
    'GPa'
    """
    forms = _FORMS.get(unit)
    if forms is None:
        return DisplayUnit(1.0, unit)
    sizes = [abs(float(v)) for v in values if math.isfinite(v) and v != 0]
    if not sizes:
        return DisplayUnit(*next((f for f in forms if f[0] == 1.0), forms[0]))
    typical = median(sizes)
    # 0.99999... of a unit is that unit with rounding, not 1000 of the next smaller one.
    fitting = (form for form in forms if typical >= form[0] * (1 - 1e-9))
    return DisplayUnit(*next(fitting, forms[-1]))


def number(value: float, digits: int = 4) -> str:
    """Write a number with the given count of significant digits.

    Examples
    --------
    >>> number(0.00001234, 3)
    '1.23 × 10⁻⁵'
    >>> number(-12.5, 3)
    '−12.5'
    """
    if not math.isfinite(value):
        return _not_finite(value)
    if value == 0:
        return "0"
    exponent = _exponent(value, digits)
    if _PLAIN_FROM <= abs(value) < _PLAIN_BELOW:
        return _fixed(value, digits - 1 - exponent)
    return f"{_fixed(value / 10.0**exponent, digits - 1)} × {power_of_ten(exponent)}"


def power_of_ten(exponent: int) -> str:
    """Write a power of ten, as ``10⁻⁵``."""
    return "10" + str(exponent).translate(SUPERSCRIPT)


def value_with_uncertainty(value: float, u: float, unit: str = "1") -> str:
    """Write a value with its standard uncertainty, both rounded to the digits that the latter supports.

    Parameters
    ----------
    value, u : float
        Value and standard uncertainty in SI. ``u = 0`` means exact (no ``±`` is written); a
        NaN `u` is said to be unknown.
    unit : str
        SI unit text; a prefix is chosen for the reader. Other texts are shown unchanged.

    Raises
    ------
    InputError
        The uncertainty is negative.

    Examples
    --------
    >>> value_with_uncertainty(0.72918, 0.01234)
    '0.729 ± 0.012'
    >>> value_with_uncertainty(1.50234e-3, 12e-6, "m")
    '(1.502 ± 0.012) mm'
    >>> value_with_uncertainty(0.8e-6, 2e-6, "m")
    '(0.8 ± 2.0) µm'
    """
    shown = display_unit([u if u > abs(value) else value], unit)
    suffix = shown.text if shown.text in ("", "°") else f" {shown.text}"
    if not math.isfinite(value):
        return _not_finite(value)
    if math.isnan(u):
        return f"{number(value / shown.factor)}{suffix} (uncertainty unknown)"
    text = plus_minus(value / shown.factor, u / shown.factor)
    return f"({text}){suffix}" if suffix and u else f"{text}{suffix}"


def quantity(value: float, unit: str = "1", digits: int = 3) -> str:
    """Write a value whose uncertainty is not stated, with its unit and few digits.

    Examples
    --------
    >>> quantity(-3.98793e-6, "m")
    '−3.99 µm'
    """
    shown = display_unit([value], unit)
    return f"{number(value / shown.factor, digits)} {shown.text}".rstrip()


def plus_minus(value: float, u: float) -> str:
    """Write ``value ± u`` rounded to two significant digits of `u`, without a unit.

    Raises
    ------
    InputError
        The uncertainty is negative.

    Examples
    --------
    >>> plus_minus(56789.0, 1234.0)
    '56800 ± 1200'
    >>> plus_minus(3.2e-7, 4.4e-9)
    '(3.200 ± 0.044) × 10⁻⁷'
    """
    if u < 0:
        raise InputError(f"a standard uncertainty cannot be negative, found {u}; pass its magnitude")
    if not (math.isfinite(value) and math.isfinite(u)):
        return f"{number(value)} ± {_not_finite(u)}" if math.isfinite(value) else _not_finite(value)
    if u == 0:  # up to six digits, no zeros that claim precision
        mantissa, times, exact_power = number(value, 6).partition(" × ")
        return (mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa) + times + exact_power
    largest = max(abs(value), u)
    place = _exponent(u, 2) - 1
    if _PLAIN_FROM <= largest < _PLAIN_BELOW and place > -9:
        return f"{_fixed(value, -place)} ± {_fixed(u, -place)}"
    power = _exponent(largest, 2)
    factor = 10.0**power
    value_text, u_text = _fixed(value / factor, power - place), _fixed(u / factor, power - place)
    return f"({value_text} ± {u_text}) × {power_of_ten(power)}"


def _exponent(value: float, digits: int) -> int:
    """Return the decimal exponent after rounding, so that 0.0999 with two digits counts as 0.1."""
    return int(f"{abs(value):.{max(digits - 1, 0)}e}".partition("e")[2])


def _fixed(value: float, decimals: int) -> str:
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    is_zero = not any(character in "123456789" for character in text)
    return text.lstrip("-") if is_zero else text.replace("-", MINUS)


def _not_finite(value: float) -> str:
    if math.isnan(value):
        return NOT_AVAILABLE
    return "∞" if value > 0 else f"{MINUS}∞"


class CellBlock:
    """A block of a page that may be the cell of a table as well: a Link, a Notice, a Picture."""


Cell = float | int | str | bool | tuple[float | None, float | None] | CellBlock | None
"""A pair is a value with its standard uncertainty."""


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    title : str
        Heading.
    unit : str
        SI unit of the numbers below; the heading shows the prefix that was chosen. A text that
        is no SI unit (``"mm"``, ``"%"``) is shown unchanged and nothing is rescaled.
    digits : int
        Significant digits of numbers without an uncertainty.
    """

    title: str
    unit: str = ""
    digits: int = 4


@dataclass(frozen=True)
class Table:
    """A table; numbers are in SI, ``None`` and NaN are shown as a dash.

    A cell may be a pair of a value and its standard uncertainty, a Link to the page of the row, a Notice of its state,
    or a small Picture: those are in a column without a title.

    Raises
    ------
    InputError
        A row is longer or shorter than the columns.

    Examples
    --------
    >>> table = Table((Column("restitution"),), (((0.72918, 0.01234),),))
    >>> table_view(table)[1][0][0].text
    '0.729 ± 0.012'
    """

    columns: tuple[Column, ...]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    sortable: bool = True

    def __post_init__(self) -> None:
        """Refuse rows that do not fit the columns."""
        for index, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise InputError(
                    f'table "{self.caption}": row {index} has {len(row)} cells, expected '
                    f"{len(self.columns)} (one for each column)"
                )


@dataclass(frozen=True)
class Listed:
    """A column with its cells, for :func:`listed`.

    Attributes
    ----------
    title, unit, digits
        As of :class:`Column`.
    cells : sequence
        Its cells, from the top.
    u : sequence of float, optional
        Standard uncertainties of the cells.
    """

    title: str
    cells: Sequence[Cell]
    unit: str = ""
    u: Sequence[Cell] | None = None
    digits: int = 4


def listed(columns: Iterable[Listed], caption: str = "", *, sortable: bool = True) -> Table:
    """Make a table of columns that bring their cells; those of a shorter column end with missing ones.

    Examples
    --------
    >>> table = listed([Listed("impact", [1, 2]), Listed("restitution", [0.8, 0.75], u=[0.01, 0.01])])
    >>> [[cell.text for cell in row] for row in table_view(table)[1]]
    [['1', '0.800 ± 0.010'], ['2', '0.750 ± 0.010']]
    """
    given = list(columns)
    heads = tuple(Column(column.title, column.unit, column.digits) for column in given)
    cells: Any = (c.cells if c.u is None else list(zip(c.cells, c.u, strict=True)) for c in given)
    return Table(heads, list(zip_longest(*cells)), caption, sortable)


class CellView(NamedTuple):
    """A cell ready for the page: its text, the key it is sorted by, and its kind, or the block that it holds."""

    text: str
    key: str = ""
    is_number: bool = False
    block: CellBlock | None = None


class HeadingView(NamedTuple):
    """A heading ready for the page."""

    title: str
    unit: str
    is_number: bool


def table_view(table: Table) -> tuple[list[HeadingView], list[tuple[CellView, ...]]]:
    """Return headings and rows for the page: prefixes per column, uncertainties joined to their values."""
    headings, columns = [], []
    for index, column in enumerate(table.columns):
        cells = [row[index] for row in table.rows]
        pairs: list[tuple[Any, Any]] = [cell if isinstance(cell, tuple) else (cell, None) for cell in cells]
        # a value far below its own uncertainty takes the prefix of that
        sizes = (max((abs(float(c)) for c in pair if _is_number(c)), default=0.0) for pair in pairs)
        unit = display_unit(sizes, column.unit)
        views = [_cell(cell, u, column, unit.factor) for cell, u in pairs]
        is_number = any(view.is_number for view in views)
        # a missing number, or the reason why, stands where the number would stand
        columns.append([v._replace(is_number=is_number and v.block is None) for v in views])
        headings.append(HeadingView(column.title, unit.text, is_number))
    return headings, list(zip(*columns, strict=True)) if columns else [()] * len(table.rows)


def _cell(cell: Any, u: Any, column: Column, factor: float) -> CellView:
    if isinstance(cell, bool):
        return CellView("yes" if cell else "no", str(int(cell)))
    if cell is None or isinstance(cell, str):
        return CellView(NOT_AVAILABLE) if cell is None else CellView(cell, cell)
    if not _is_number(cell):
        text = getattr(cell, "text", "")
        return CellView(text, text, block=cell)
    value = float(cell) / factor
    if math.isfinite(value) and _is_number(u):
        text = plus_minus(value, float(u) / factor)
    elif isinstance(cell, int) and factor == 1.0:
        text = str(cell).replace("-", MINUS)
    else:
        text = number(value, column.digits)
    return CellView(text, "" if math.isnan(value) else repr(float(cell)), True)


def _is_number(cell: object) -> bool:
    # numpy scalars are numbers too, but importing numpy to ask would slow the start.
    return not isinstance(cell, bool | str | None) and hasattr(cell, "__float__")

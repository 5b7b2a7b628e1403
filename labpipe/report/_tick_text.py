"""Numbers at ticks as plain text with raised digits, not as formulas.

matplotlib writes every power of ten, and on request every number, as a formula, and parsing
formulas took two thirds of the time of a picture. Raised digits are characters of their own.
"""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from matplotlib.ticker import Formatter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RAISED = str.maketrans("0123456789+-\N{MINUS SIGN}.", "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻⁻·")
_POWER = re.compile(r"\^\{([0-9+\-\N{MINUS SIGN}]+)\}")
_NUMBER = re.compile(r"[0-9.,+\-\N{MINUS SIGN}×⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻· eE]*")


def plain_number(text: str) -> str:
    r"""Return a tick's number without its formula; what is more than a number stays as it is.

    Examples
    --------
    >>> plain_number(r"$\mathdefault{10^{-3}}$"), plain_number(r"$\mathdefault{0.25}$")
    ('10⁻³', '0.25')
    >>> plain_number(r"$\mathdefault{\frac{1}{2}}$")
    '$\\mathdefault{\\frac{1}{2}}$'
    """
    if "$" not in text:
        return text
    bare = text.replace("$", "").replace(r"\times", "×").replace(r"\mathdefault", "")
    bare = _POWER.sub(lambda found: found[1].translate(_RAISED), bare)
    bare = bare.replace("{", "").replace("}", "").strip()
    return bare if _NUMBER.fullmatch(bare) else text


class _Plain(Formatter):
    """Another formatter, its numbers as plain text."""

    def __init__(self, inner: Formatter) -> None:
        self.inner = inner

    def set_axis(self, axis: Any) -> None:
        self.inner.set_axis(axis)

    def set_locs(self, locs: Any) -> None:
        self.inner.set_locs(locs)

    def __call__(self, x: float, pos: int | None = None) -> str:
        return plain_number(self.inner(x, pos))

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        return [plain_number(text) for text in self.inner.format_ticks(list(values))]

    def get_offset(self) -> str:
        return plain_number(self.inner.get_offset())


def write_plain_numbers(figure: "Figure") -> None:
    """Have all ticks of a figure write their numbers as plain text."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            for which in ("major", "minor"):
                formatter: Formatter = getattr(axis, f"get_{which}_formatter")()
                if not isinstance(formatter, _Plain):
                    getattr(axis, f"set_{which}_formatter")(_Plain(formatter))

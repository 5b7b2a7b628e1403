"""Where the ticks of a still picture stand, and what is written at them."""

import math
from typing import NamedTuple

from labpipe.report.tables import power_of_ten

_MINUS = "\N{MINUS SIGN}"
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
# A step is spelt out between these powers of ten; elsewhere a power is written behind the number.
_SMALLEST_SPELT, _LARGEST_SPELT = -6, 7
_MOST_DECADES_WITH_MINOR = 10
# Below so many decades, 2 and 5 between the powers are named too.
_FEW_DECADES = 2.0
# Rounding of a range's ends must not lose a tick that stands on one of them.
_SLACK = 1e-9


class Ticks(NamedTuple):
    """Ticks of one axis: positions with their texts, and positions of ticks without text."""

    positions: tuple[float, ...]
    texts: tuple[str, ...]
    minor: tuple[float, ...] = ()


def ticks(low: float, high: float, scale: str, most: int) -> Ticks:
    """Choose the ticks of an axis.

    Parameters
    ----------
    low, high : float
        Ends of the axis, ascending; above zero on a logarithmic axis.
    scale : {"linear", "log"}
        Kind of axis.
    most : int
        How many ticks with text there is room for; at least two are tried for.

    Returns
    -------
    Ticks

    Examples
    --------
    >>> ticks(-0.3, 1.1, "linear", 5).texts
    ('0.0', '0.5', '1.0')
    >>> ticks(0.01, 200.0, "log", 8).texts
    ('0.01', '0.1', '1', '10', '100')
    """
    if scale == "log":
        found = _logarithmic(low, high, most)
        if len(found.positions) > 1:
            return found
    return _linear(low, high, most)


def _linear(low: float, high: float, most: int) -> Ticks:
    step = _step((high - low) / max(most, 2))
    first, last = math.ceil(low / step - _SLACK), math.floor(high / step + _SLACK)
    positions = tuple(n * step for n in range(first, last + 1))
    return Ticks(positions, _spelt(positions, step))


def _step(at_least: float) -> float:
    """Return the smallest of 1, 2, 2.5, 5 times a power of ten that is not smaller."""
    power = math.floor(math.log10(at_least))
    return next(
        factor * 10.0**power
        for factor in (*_STEPS, 20.0)
        if factor * 10.0**power >= at_least * (1 - _SLACK)
    )


def _spelt(positions: tuple[float, ...], step: float) -> tuple[str, ...]:
    """Write all numbers of an axis with the same number of decimals."""
    largest = max(map(abs, positions), default=0.0)
    exponent = math.floor(math.log10(largest)) if largest else 0
    if _SMALLEST_SPELT < exponent < _LARGEST_SPELT:
        return tuple(_fixed(x, _decimals(step)) for x in positions)
    power, unit = power_of_ten(exponent), 10.0**exponent
    decimals = _decimals(step / unit)
    return tuple(f"{_fixed(x / unit, decimals)}·{power}" if x else "0" for x in positions)


def _decimals(step: float) -> int:
    power = math.floor(math.log10(step) + _SLACK)
    has_another_digit = abs(step / 10.0**power - 2.5) < _SLACK
    return max(has_another_digit - power, 0)


def _fixed(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    return text.replace("-", "" if float(text) == 0.0 else _MINUS)


def _logarithmic(low: float, high: float, most: int) -> Ticks:
    first = math.ceil(math.log10(low) - _SLACK)
    last = math.floor(math.log10(high) + _SLACK)
    stride = max(-(-(last - first + 1) // max(most, 2)), 1)
    exponents = range(first, last + 1, stride)
    named = {10.0**n: _power(n) for n in exponents}
    span = math.log10(high / low)
    between = [
        digit * 10.0**n
        for n in range(math.floor(math.log10(low)), last + 1)
        for digit in range(2, 10)
        if low <= digit * 10.0**n <= high
    ]
    if span < _FEW_DECADES:
        named |= {x: _between(x) for x in between if _digit(x) in {2, 5}}
    if stride > 1:
        minor = [10.0**n for n in range(first, last + 1) if 10.0**n not in named]
    else:
        minor = [x for x in between if x not in named] if span < _MOST_DECADES_WITH_MINOR else []
    positions = tuple(sorted(named))
    return Ticks(positions, tuple(named[x] for x in positions), tuple(minor))


def _power(exponent: int) -> str:
    return f"{10.0**exponent:.6g}" if -3 <= exponent <= 3 else power_of_ten(exponent)


def _digit(value: float) -> int:
    return round(value / 10.0 ** math.floor(math.log10(value) + _SLACK))


def _between(value: float) -> str:
    exponent = math.floor(math.log10(value) + _SLACK)
    spelt = f"{value:.1g}" if -3 <= exponent < 0 else f"{value:.0f}"
    return spelt if -3 <= exponent <= 3 else f"{_digit(value)}·{power_of_ten(exponent)}"

"""The axes of a still picture: from values to places, ticks with their texts, and the width of texts."""

import math
from dataclasses import dataclass, replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.report._packing import padded_range
from labpipe.report._tables import power_of_ten

UNITS = 20
"""Places are whole numbers of 1/20 point: finer than a printer's dots, and shorter than decimals."""

# Widths of DejaVu Sans, the first font of the pictures and wider than those that stand in for it
# (Arial, Helvetica), as parts of the size of its letters; characters not listed count as 0.65.
_WIDTHS = {
    character: width
    for width, characters in (
        (0.3, "'ijlIJ"),
        (0.35, " ,.·’/:;\\|f-"),
        (0.41, "()[]t!r²³⁰¹⁴⁵⁶⁷⁸⁹"),
        (0.53, '"*_`°–sz“”?⁻⁺'),
        (0.79, "ABCDGHNOQRUVXZKα&ΔΩ"),
        (0.86, "w#+<=>^~−×±ωM≤≥∞"),
        (1.0, "%mW@…—"),
    )
    for character in characters
}
_USUAL = 0.65

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_PLAIN = 1e-6, 1e7
"""Sizes between which numbers at ticks are written without a power of ten."""
_MOST_TICKS = 9
_TICK_EVERY = 22.0, 15.0
"""Points that a tick takes at least along x and along y."""
TICK_TEXT, _BETWEEN = 7.0, 7.0
"""Points: the size of their texts, and what is left free between two of them."""
_BEYOND = 3.0  # sizes of a panel by which a curve may leave it: beyond, places would only be long
_DECADES_WITH_SMALL = 8.0


def text_width(text: str, size: float) -> float:
    """Reckon the width of a text in points; ``size`` is that of its letters."""
    return size * sum(_WIDTHS.get(character, _USUAL) for character in text)


@dataclass(frozen=True, slots=True)
class Tick:
    """A value that is marked on an axis; a small one has a shorter mark and no line across."""

    value: float
    text: str
    is_small: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """A rectangle of a picture, and the window of values that it shows.

    Attributes
    ----------
    left, top, width, height : float
        In points, from the upper left corner of the picture.
    x, y : (float, float)
        The window.
    x_scale, y_scale : {"linear", "log"}
    """

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    x_scale: str
    y_scale: str

    @property
    def diagonal(self) -> float:
        """Length in points."""
        return math.hypot(self.width, self.height)

    def across(self, values: "Floats | float") -> Floats:
        """Places along x in :data:`UNITS`; NaN where the axis cannot show a value."""
        return UNITS * (self.left + self.width * _part(values, self.x, self.x_scale))

    def down(self, values: "Floats | float") -> Floats:
        """Places along y in :data:`UNITS`, growing downwards as a picture's do."""
        return UNITS * (self.top + self.height * (1.0 - _part(values, self.y, self.y_scale)))

    def with_equal_units(self) -> "Panel":
        """Widen one of the windows until a unit is as long along x as along y."""
        wide, tall = (self.x[1] - self.x[0]) / self.width, (self.y[1] - self.y[0]) / self.height
        unit = max(wide, tall)
        x, y = (
            (sum(w) / 2 - unit * size / 2, sum(w) / 2 + unit * size / 2)
            for w, size in ((self.x, self.width), (self.y, self.height))
        )
        return replace(self, x=x, y=y)

    def x_ticks(self, most: int = _MOST_TICKS) -> list[Tick]:
        """Return the ticks along x, as many as have room for their texts."""
        for count in range(min(most, int(self.width / _TICK_EVERY[0])), 1, -1):
            found = _ticks(*self.x, self.x_scale, count)
            if self._has_room(found):
                return found
        found = _ticks(*self.x, self.x_scale, 2)
        return [replace(tick, text="") if tick.is_small and not self._has_room(found) else tick for tick in found]

    def _has_room(self, ticks: "list[Tick]") -> bool:
        """Whether no text along x touches its neighbour."""
        named = sorted((tick.value, tick.text) for tick in ticks if tick.text)
        places = self.across(np.array([value for value, _ in named])) / UNITS
        halves = np.array([text_width(text, TICK_TEXT) / 2 for _, text in named])
        return bool(np.all(np.diff(places) >= halves[1:] + halves[:-1] + _BETWEEN))

    def y_ticks(self, most: int = _MOST_TICKS) -> list[Tick]:
        """Return the ticks along y."""
        return _ticks(*self.y, self.y_scale, min(most, int(self.height / _TICK_EVERY[1])))


def _part(values: "Floats | float", window: tuple[float, float], scale: str) -> Floats:
    """Where values lie in a window, as a part of it."""
    found, (low, high) = np.asarray(values, float), window
    if scale == "log":
        found = np.log10(np.where(found > 0.0, found, np.nan))
        low, high = math.log10(low), math.log10(high)
    return np.clip((found - low) / (high - low), -_BEYOND, 1.0 + _BEYOND)


def y_window(extremes: "list[float]", scale: str) -> tuple[float, float]:
    """Return the window that shows all extremes."""
    if not extremes:
        return (1.0, 10.0) if scale == "log" else (0.0, 1.0)
    return padded_range(min(extremes), max(extremes), scale, 0.05)


def _ticks(low: float, high: float, scale: str, most: int) -> list[Tick]:
    most = max(most, 2)
    if scale == "log" and low > 0.0:
        found = _power_ticks(low, high, most)
        if sum(bool(tick.text) for tick in found) > 1:
            return found
        plain = [tick for tick in _plain_ticks(low, high, most) if tick.value > 0.0]
        named = {tick.value for tick in plain}
        return [*plain, *(replace(tick, text="", is_small=True) for tick in found if tick.value not in named)]
    return _plain_ticks(low, high, most)


def _plain_ticks(low: float, high: float, most: int) -> list[Tick]:
    """Round numbers, evenly apart."""
    least = (high - low) / most
    decade = 10.0 ** math.floor(math.log10(least))
    step = next(decade * s for s in _STEPS if decade * s >= least * (1.0 - 1e-9))
    places = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    size = max(abs(low), abs(high))
    exponent = 0 if _PLAIN[0] <= size < _PLAIN[1] else math.floor(math.log10(size))
    scaled = step / 10.0**exponent
    digits = max(0, -math.floor(math.log10(scaled) + 1e-9))
    digits += round(scaled * 10.0**digits, 6) % 1.0 != 0.0
    return [Tick(n * step, _written(n * step, exponent, digits)) for n in places]


def _written(value: float, exponent: int, digits: int) -> str:
    text = f"{value / 10.0**exponent:.{digits}f}".replace("-", "\N{MINUS SIGN}")
    return text if not exponent or not value else f"{text}·{power_of_ten(exponent)}"


def _power_ticks(low: float, high: float, most: int) -> list[Tick]:
    """Powers of ten, and 2 to 9 times those where they are few."""
    first, last = math.log10(low), math.log10(high)
    powers = range(math.ceil(first - 1e-9), math.floor(last + 1e-9) + 1)
    every = -(-len(powers) // most) or 1
    found = [Tick(10.0**n, f"{10.0**n:.6g}" if -3 <= n <= 3 else power_of_ten(n)) for n in powers if n % every == 0]
    if last - first > _DECADES_WITH_SMALL:
        return found
    is_named = last - first < 2
    for n in range(math.floor(first), math.ceil(last)):
        for digit in range(2, 10):
            if low <= digit * 10.0**n <= high:
                text = f"{digit * 10.0**n:g}" if -3 <= n <= 3 else f"{digit}·{power_of_ten(n)}"
                found.append(Tick(digit * 10.0**n, text if is_named and digit in (2, 5) else "", is_small=True))
    return found

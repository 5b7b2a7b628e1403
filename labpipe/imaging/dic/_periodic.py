"""Patterns that repeat themselves: lines, grids, dots, told up to a period only.

Lines that are sharper than the pixels have waves that the pixels cannot hold; they appear folded, as
a moiré that moves otherwise than the specimen. Where lines and their moiré are all there is, they
match a wrong place perfectly, so that the reference itself must tell them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Floats32

#: Half width of the tiles whose waves are looked at, and their distance (px).
_REACH, _APART = 24, 24
#: Periods of a wave in a tile at least, and share of the variance that so many of them have together
#: where a pattern may repeat itself.
_LEAST_PERIODS, _WAVES, _LIKELY = 2.5, 4, 0.72
#: Share of the variance of these waves and their multiples, up to so many in all, where it does.
_SHARE, _COUNTED = 0.9, 4
#: Amplitude of a second wave over that of the first from which both make a grid.
_SECOND = 0.4
#: Zeros added to a spectrum, in widths, and half width of a wave of a Hann window in steps of the spectrum.
_PADDED, _LOBE = 2, 2.0
#: Highest multiples of the waves of lines and of a grid that are looked for.
_LINES, _GRID = 15, 5
#: Share of the squared slopes in folded waves from which a pattern is sharper than the pixels: they
#: would move the answer by two thousandths of a pixel.
_FOLDED = 1e-3
#: Multiple of the mean squared amplitude around it, which other texture has, that a folded wave must exceed to count,
#: and places around it, in steps of the spectrum.
_ABOVE_OTHERS = 8.0
_AROUND = np.array([(x, y) for x in (-4, -2, 0, 2, 4) for y in (-4, -2, 0, 2, 4) if max(abs(x), abs(y)) > _LOBE])


@dataclass(frozen=True)
class Repeats:
    """How the patterns of subsets repeat themselves.

    Attributes
    ----------
    period : array (point,) [px]
        Shortest displacement in which a grid matches itself; infinite where there is none.
    is_folded : bool array (point,)
        Lines or a grid of edges sharper than the pixels.
    """

    period: Floats
    is_folded: Flags


def find_repeats(image: Floats, layout: NDArray[np.integer]) -> Repeats:
    """Tell which subsets hold a pattern that repeats itself.

    ``image``: (row, column), the reference, not blurred; ``layout``: integer (point, 2 or more) [px], column and
    row of the centres.
    """
    found = Repeats(np.full(len(layout), np.inf), np.zeros(len(layout), bool))
    half = min(_REACH, (min(image.shape) - 1) // 2)
    size = 2 * half + 1
    if size < 4 * _LEAST_PERIODS or not len(layout):
        return found
    last = np.array(image.shape)[::-1] - 1 - half
    tiles, own = np.unique(
        np.clip(np.rint(layout[:, :2] / _APART).astype(int) * _APART, half, last), axis=0, return_inverse=True
    )
    window = np.outer(*2 * [np.hanning(size + 2)[1:-1]]).astype(np.float32)
    columns, rows = (tiles[:, k, None] + np.arange(-half, half + 1) for k in (0, 1))
    areas: Floats32 = image[rows[:, :, None], columns[:, None, :]].astype(np.float32)
    areas -= (np.einsum("nij,ij->n", areas, window) / window.sum())[:, None, None]
    areas *= window
    for n in np.flatnonzero(_is_regular(areas)):
        period, is_folded = _judge(areas[n].astype(float), window.astype(float))
        found.period[own.reshape(-1) == n] = period
        found.is_folded[own.reshape(-1) == n] = is_folded
    return found


def _is_regular(areas: Floats32) -> Flags:
    """Whether a few waves have most of the variance of windowed areas (tile, row, column)."""
    from scipy.fft import rfft2

    count, size, _ = areas.shape
    power = np.abs(rfft2(areas)) ** 2
    total = power.sum(axis=(1, 2))
    down, across = np.fft.fftfreq(size, 1.0 / size)[:, None], np.arange(power.shape[2])
    power[:, np.hypot(down, across) < _LEAST_PERIODS] = 0.0
    share = np.zeros(count)
    for _ in range(_WAVES):
        row, column = np.unravel_index(power.reshape(count, -1).argmax(axis=1), power.shape[1:])
        for y in (-1, 0, 1):
            for x in (-1, 0, 1):
                near = np.arange(count), (row + y) % size, np.clip(column + x, 0, power.shape[2] - 1)
                share += power[near]
                power[near] = 0.0
    return np.asarray(share > _LIKELY * total)


def _judge(area: Floats, window: Floats) -> tuple[float, bool]:
    """Period of one windowed area, and whether some of its waves are folded."""
    size = len(area)
    spectrum = _Spectrum(area, window)
    first = spectrum.strongest(None)
    second = spectrum.strongest(first)
    waves, period = first[None], np.inf
    if spectrum.amplitude(second) > _SECOND * spectrum.amplitude(first):
        waves = np.stack([first, second])
        period = _shortest(waves)
    whole = float((area**2).sum() / (window**2).sum())
    counted = _multiples(waves, _COUNTED, half=True)
    # Waves of a random pattern have multiples that lie together, and would be counted twice.
    is_apart = (np.hypot(*counted.T) * size >= _LEAST_PERIODS).all()
    if not is_apart or 0.5 * (spectrum.amplitude(counted) ** 2).sum() < _SHARE * whole:
        return np.inf, False
    most = _LINES if len(waves) == 1 else _GRID
    frequency = _multiples(waves, most)
    seen = frequency - np.rint(frequency)
    is_held = (np.abs(frequency) < 0.5).all(axis=1)
    folded = seen[~is_held]
    apart = np.abs(_wrapped(folded[:, None] - seen[None, is_held])).max(axis=2) * size
    # several may be folded to one place
    places = np.unique(np.rint(folded[(apart > _LOBE).all(axis=1)] * size), axis=0) / size
    square = spectrum.amplitude(places) ** 2
    around = places[:, None] + _AROUND / size
    # other waves of the pattern may lie near, which are no texture
    counts = np.abs(_wrapped(around[:, :, None] - seen)).max(axis=3).min(axis=2) * size > _LOBE
    others = spectrum.amplitude(around.reshape(-1, 2)).reshape(counts.shape) ** 2
    usual = np.where(counts, others, 0.0).sum(axis=1) / np.maximum(counts.sum(axis=1), 1)
    square[square < _ABOVE_OTHERS * usual] = 0.0
    energy = float(((places**2).sum(axis=1) * square).sum())
    held = float(((waves**2).sum(axis=1) * spectrum.amplitude(waves) ** 2).sum())
    return period, energy > 2.0 * _FOLDED * held


class _Spectrum:
    """Waves of a windowed area."""

    def __init__(self, area: Floats, window: Floats) -> None:
        self._area = area
        self._weight = float(window.sum())
        self._axis = np.arange(len(area)) - len(area) // 2
        padded = _PADDED * len(area)
        self._power = np.abs(np.fft.rfft2(area, (padded, padded))) ** 2
        self._frequency = np.fft.fftfreq(padded), np.fft.rfftfreq(padded)

    def amplitude(self, frequency: Floats) -> Floats:
        """Amplitude of waves (wave, 2) [1/px], columns first, or of one."""
        x = np.exp(-2j * np.pi * np.multiply.outer(frequency[..., 0], self._axis))
        y = np.exp(-2j * np.pi * np.multiply.outer(frequency[..., 1], self._axis))
        return np.asarray(2.0 / self._weight * np.abs(np.einsum("...i,ij,...j->...", y, self._area, x)))

    def strongest(self, other: Floats | None) -> Floats:
        """Strongest wave, apart from another, its multiples, and what varies over the whole area."""
        size = len(self._area)
        row, column = self._frequency[0][:, None], self._frequency[1][None, :]
        is_free = np.hypot(row, column) * size >= _LEAST_PERIODS
        multiples = [] if other is None else [k * other for k in (-3, -2, -1, 1, 2, 3)]
        for x, y in multiples:
            away = np.maximum(np.abs(_wrapped(column - x)), np.abs(_wrapped(row - y)))
            is_free &= away * size > _LOBE
        power = np.where(is_free, self._power, 0.0)
        down, across = np.unravel_index(int(power.argmax()), power.shape)
        place = np.array([self._frequency[1][across], self._frequency[0][down]])
        step = 0.5 / (_PADDED * size)
        for _ in range(3):
            for axis in np.eye(2):
                left, middle, right = np.log(self.amplitude(place + step * np.outer((-1, 0, 1), axis)) + 1e-300)
                bend = left - 2.0 * middle + right
                if bend < 0.0:
                    place = place + axis * step * np.clip(0.5 * (left - right) / bend, -2.0, 2.0)
        return place


def _multiples(waves: Floats, most: int, *, half: bool = False) -> Floats:
    """Return the sums (sum, 2) of up to so many of the waves (wave, 2), or only those of one sign."""
    orders = np.stack(np.meshgrid(*[np.arange(-most, most + 1)] * len(waves), indexing="ij"), axis=-1)
    orders = orders.reshape(-1, len(waves))
    chosen = np.abs(orders).sum(axis=1) <= most
    if half:
        chosen &= orders @ np.array([most + 1, 1])[: len(waves)] > 0
    return np.asarray(orders[chosen] @ waves)


def _wrapped(frequency: Floats) -> Floats:
    """Frequencies between -0.5 and 0.5, as pixels show them."""
    return np.asarray(frequency - np.rint(frequency))


def _shortest(waves: Floats) -> float:
    """Shortest displacement (px) that moves two waves by whole periods."""
    if abs(np.linalg.det(waves)) < 1e-6:
        return np.inf
    counts = np.array([(i, j) for i in range(-3, 4) for j in range(-3, 4) if (i, j) != (0, 0)])
    return float(np.hypot(*(np.linalg.inv(waves) @ counts.T)).min())

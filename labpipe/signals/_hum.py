"""Hum of the mains in a record: one line and its multiples, fitted where nothing else can swing.

Where a body rests or flies its position is a polynomial of time, whatever its material. A line
at the frequency of the mains is then the sensor's, not the specimen's; contacts and the ringing
after them are no part of the fit. Each stretch has a polynomial of its own, and one line
runs through all of them, so that short stretches determine amplitude and phase and their distance in time
the frequency.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats

MAINS = (50.0, 60.0)
_U_MAINS = 0.05
"""Hz, standard uncertainty of the frequency of a grid before it is measured: the range in which grids are kept."""
_ORDERS = (1, 2, 3)  # the mains, what a rectifier makes of it, and what a transformer does
_FURTHEST = 0.5  # Hz, from which on a line is none of the mains
_SURE = 1e-6  # probability by chance of a line that is told
_BESIDE, _CONTROLS = 0.45, 16
"""Of the frequency of the mains, how far from a line, and at how many places, its noise is looked for."""
_NEAREST, _FAR = 0.12, 0.35  # nearest, and at most so
_SHORTEST = 0.1  # of a period, that a stretch lasts at least
_UPDATES = 4  # of the frequency, about which the fit is linear
_PERIODS = 0.6  # without which hum cannot be told from drift
_PER_PERIOD = 8  # readings without which a line is not followed
_RATE_STEP = 1e-3  # rad, over which a rate is a difference: good to 2e-7
_DECIDED = 14.0  # of the sum of squares over the variance, by which one frequency of the mains is better than another


@dataclass(frozen=True, slots=True)
class Hum:
    """``sum of a_k cos(2 pi k f s) + b_k sin(2 pi k f s)``, s from ``epoch``, k from ``orders``.

    Attributes
    ----------
    frequency : float [Hz]
    epoch : float [s]
    orders : tuple of int
    parameters : array (2 n,)
        a and b of each order, in the unit of the record.
    covariance : array (2 n + 1, 2 n + 1)
        Of them and of the frequency.
    """

    frequency: float
    epoch: float
    orders: tuple[int, ...]
    parameters: Floats
    covariance: Floats

    @property
    def amplitude(self) -> float:
        """Root of the sum of the squares of all amplitudes."""
        return float(np.linalg.norm(self.parameters))

    def at(self, time: Floats) -> Floats:
        """Return the hum at times (n,) [s]."""
        return np.asarray(_waves(time - self.epoch, self.frequency, self.orders) @ self.parameters)

    def modes(self, time: Floats) -> Floats:
        """Return the possible remainder of the hum: independent errors (n, p) of all readings, of one u each."""
        design = _design(time - self.epoch, self.frequency, self.orders, self.parameters)
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(design @ (vectors * np.sqrt(np.maximum(values, 0.0))))

    def remaining(self, time: Floats) -> Floats:
        """Return the standard uncertainty (n,) of the hum at times [s]."""
        return np.asarray(np.linalg.norm(self.modes(time), axis=1))

    def remaining_rate(self, time: Floats) -> Floats:
        """Return the standard uncertainty (n,) of the rate of the hum [unit/s]."""
        step = _RATE_STEP / (2 * np.pi * self.frequency * max(self.orders))
        return np.asarray(np.linalg.norm(self.modes(time + step) - self.modes(time - step), axis=1)) / (2 * step)

    def scaled(self, factor: float) -> "Hum":
        """Return the same hum in another unit."""
        by = np.append(np.full(len(self.parameters), factor), 1.0)
        return replace(self, parameters=factor * self.parameters, covariance=self.covariance * np.outer(by, by))

    def to_text(self) -> str:
        """Write as JSON."""
        return json.dumps({one.name: np.asarray(getattr(self, one.name)).tolist() for one in fields(self)})

    @classmethod
    def of_text(cls, text: str | None) -> "Hum | None":
        """Read the text of :meth:`to_text`; None of no text."""
        if text is None:
            return None
        kept = json.loads(text)
        arrays = {name: np.array(kept[name]) for name in ("parameters", "covariance")}
        return cls(**kept | arrays | {"orders": tuple(kept["orders"])})


class Stretch(NamedTuple):
    """Readings that follow a polynomial: at rest (a drift, 1) or in flight (an arc, 2)."""

    part: slice
    degree: int


def hum_at_rest(time: Floats, values: Floats, noise: float) -> tuple[Hum, bool] | None:
    """Find the hum of readings at rest.

    Parameters
    ----------
    time, values : array (n,) [s], any unit
        At rest but for a drift; no NaN.
    noise : float
        Standard deviation of a reading, below which a hum is not distinguished from other noise of a short rest.

    Returns
    -------
    (Hum, bool) or None
        The hum, and whether the frequency of the mains is determined, without which it
        must not be continued beyond these readings. None where none is found.
    """
    span = float(time[-1] - time[0])
    stretches = _Stretches(time, values, [Stretch(slice(None), 1)])
    found = []
    for line in MAINS:
        if span * line < _PERIODS or line * span * _PER_PERIOD > time.size:
            continue
        gain = stretches.gain(line, stretches.values)
        left = stretches.sum_of_squares - gain
        # The probability that white noise looks like this is (left/all)^((n - 4)/2).
        is_sure = left < stretches.sum_of_squares * _SURE ** (2 / (time.size - 4))
        found.append((gain, line, left / (time.size - 4), is_sure))
    if not found or not max(found)[3]:
        return None
    found.sort(reverse=True)
    gain, line, variance, _ = found[0]
    hum = stretches.fitted(line, (1,), variance)
    is_decided = len(found) > 1 and gain - found[1][0] > _DECIDED * variance
    return (hum, is_decided) if hum.amplitude > noise else None


def hum_of(
    time: Floats, values: Floats, noise: float, stretches: Sequence[Stretch], otherwise: Hum | None = None
) -> Hum | None:
    """Find the hum that runs through all stretches of a record in which nothing can swing.

    ``noise`` is the standard deviation of the white part; stretches shorter than a tenth of a period are left out.
    ``otherwise`` is returned where they span too few periods to resolve a line from its neighbours, None where no line
    of the mains exceeds those.

    Notes
    -----
    The noise of a line is that of the neighbouring frequencies in the same stretches, so that flicker or
    flights that are no parabolas do not pass for a hum. Of white noise, the power of a line over the mean of
    the others is F(2, 2 m).
    """
    known = _Stretches(time, values, stretches)
    if not known.count or max(_NEAREST, 1.0 / (known.span * MAINS[0])) > _FAR:
        return otherwise

    def beside(line: float, order: int, left: Floats) -> float:
        """Return the variance of white noise with the mean power of the lines about a multiple of the mains."""
        steps = np.linspace(max(_NEAREST, 1.0 / (known.span * line)), _BESIDE, _CONTROLS // 2)
        return float(np.mean([known.gain((order + step) * line, left) / 2 for step in [*steps, *-steps]]))

    def is_sure(gain: float, variance: float) -> bool:
        return (1.0 + gain / (2 * variance) / _CONTROLS) ** -_CONTROLS < _SURE

    best: tuple[float, float, tuple[int, ...]] | None = None
    for line in MAINS:
        gains, left = {}, known.values
        for order in _ORDERS:
            gain = known.gain(order * line, left)
            if is_sure(gain, noise**2):
                design = known.reduced(order * line, (1,))
                gains[order], left = gain, left - design @ np.linalg.lstsq(design, left, rcond=None)[0]
        gains = {o: gain for o, gain in gains.items() if is_sure(gain, max(noise**2, beside(line, o, left)))}
        if gains and (best is None or sum(gains.values()) > best[0]):
            best = (sum(gains.values()), line, tuple(gains))
    if best is None:
        return None
    _, line, orders = best
    hum = known.fitted(line, orders, noise**2)
    # The neighbouring power is known once the line is out at its own frequency.
    left = known.values - known.reduced(hum.frequency, hum.orders) @ hum.parameters
    hum = known.fitted(line, orders, max(noise**2, *(beside(hum.frequency, order, left) for order in orders)))
    return hum if abs(hum.frequency - line) < _FURTHEST else None


class _Stretches:
    """Readings of all stretches less the polynomial of each."""

    def __init__(self, time: Floats, values: Floats, stretches: Sequence[Stretch]) -> None:
        self._parts: list[tuple[Floats, Floats]] = []
        readings = [np.zeros(0)]
        for part, degree in stretches:
            t = time[part]
            if len(t) > 4 * (degree + 1) and t[-1] - t[0] > _SHORTEST / MAINS[0]:
                s = (t - t[0]) / (t[-1] - t[0])
                basis = np.linalg.qr(np.polynomial.polynomial.polyvander(s, degree))[0]
                self._parts.append((t, basis))
                readings.append(values[part] - basis @ (basis.T @ values[part]))
        self.values = np.concatenate(readings)
        self.count = self.values.size
        self._middle = float(np.mean(np.concatenate([t for t, _ in self._parts]))) if self._parts else 0.0
        self.span = float(self._parts[-1][0][-1] - self._parts[0][0][0]) if self._parts else 0.0
        self.sum_of_squares = float(self.values @ self.values)

    def reduced(self, frequency: float, orders: tuple[int, ...], parameters: Floats | None = None) -> Floats:
        """Return the waves, or all derivatives at parameters, less their part in the polynomials."""
        columns = []
        for t, basis in self._parts:
            s = t - self._middle
            waves = _waves(s, frequency, orders) if parameters is None else _design(s, frequency, orders, parameters)
            columns.append(waves - basis @ (basis.T @ waves))
        return np.concatenate(columns)

    def gain(self, frequency: float, values: Floats) -> float:
        """Return the decrease of the sum of squares by one line."""
        design = self.reduced(frequency, (1,))
        right = design.T @ values
        return float(right @ np.linalg.lstsq(design.T @ design, right, rcond=None)[0])

    def fitted(self, line: float, orders: tuple[int, ...], variance: float) -> Hum:
        """Fit the line; its frequency is known beforehand as a grid keeps it."""
        frequency = line
        parameters: Floats = np.asarray(np.linalg.lstsq(self.reduced(frequency, orders), self.values)[0], float)
        for _ in range(_UPDATES):
            design = self.reduced(frequency, orders, parameters)
            normal = design.T @ design / variance
            right = design.T @ (self.values - design[:, :-1] @ parameters) / variance
            normal[-1, -1] += 1.0 / _U_MAINS**2
            right[-1] += (line - frequency) / _U_MAINS**2
            step = np.linalg.solve(normal, right)
            parameters, frequency = np.asarray(parameters + step[:-1], float), frequency + float(step[-1])
        return Hum(frequency, self._middle, orders, parameters, np.asarray(np.linalg.inv(normal), float))


def _waves(s: Floats, frequency: float, orders: tuple[int, ...]) -> Floats:
    angles = [2 * np.pi * order * frequency * s for order in orders]
    return np.stack([wave(angle) for angle in angles for wave in (np.cos, np.sin)], axis=-1)


def _design(s: Floats, frequency: float, orders: tuple[int, ...], parameters: Floats) -> Floats:
    """Return derivatives by all parameters and the frequency."""
    waves = _waves(s, frequency, orders)
    weights = 2 * np.pi * np.repeat(orders, 2) * parameters
    return np.column_stack([waves, s * (waves[:, ::2] @ weights[1::2] - waves[:, 1::2] @ weights[::2])])

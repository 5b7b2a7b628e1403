"""Hum of the mains in a record: one line and its multiples, fitted where nothing else can swing.

Where a body rests or flies its position is a polynomial of time, whatever its material. What is
left there at the frequency of the mains is the sensor's, not the specimen's; contacts, and what
rings after them, are no part of the fit. Each stretch has a polynomial of its own, and one line
runs through all of them, so that short stretches tell amplitude and phase and their distance in time
the frequency.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
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
        """Return what may be left of the hum: independent errors (n, p) of all readings, of one u each."""
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
        by = np.full(len(self.parameters) + 1, factor)
        by[-1] = 1.0
        return Hum(
            self.frequency, self.epoch, self.orders, factor * self.parameters, self.covariance * np.outer(by, by)
        )

    def to_text(self) -> str:
        """Write as JSON."""
        return json.dumps(
            {
                "frequency": self.frequency,
                "epoch": self.epoch,
                "orders": list(self.orders),
                "parameters": self.parameters.tolist(),
                "covariance": self.covariance.tolist(),
            }
        )

    @classmethod
    def of_text(cls, text: str | None) -> "Hum | None":
        """Read what :meth:`to_text` wrote; None of no text."""
        if text is None:
            return None
        kept = json.loads(text)
        parameters, covariance = np.array(kept["parameters"]), np.array(kept["covariance"])
        return cls(kept["frequency"], kept["epoch"], tuple(kept["orders"]), parameters, covariance)


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
        Standard deviation of a reading, below which a hum is not told from other noise of a short rest.

    Returns
    -------
    (Hum, bool) or None
        The hum, and whether it is told at which of the frequencies of the mains it is, without which it
        must not be continued beyond these readings. None where none is found.
    """
    span = float(time[-1] - time[0])
    stretches = _Stretches(time, values, [Stretch(slice(None), 1)])
    found = []
    for line in MAINS:
        if span * line < _PERIODS or line * span * _PER_PERIOD > time.size:
            continue
        gain = stretches.gain(line)
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
    ``otherwise`` is returned where they span too few periods to tell a line from what is beside it, None where no line
    of the mains exceeds that.

    Notes
    -----
    The noise of a line is that of the frequencies beside it, in the same stretches, so that flicker or
    flights that are no parabolas do not pass for a hum.
    """
    known = _Stretches(time, values, stretches)
    if not known.count or _nearest(known, MAINS[0]) > _FAR:
        return otherwise
    best: tuple[float, float, tuple[int, ...]] | None = None
    for line in MAINS:
        gains, left = {}, known.values
        for order in _ORDERS:
            gain = known.gain(order * line, left)
            if _is_sure(gain, noise**2):
                gains[order], left = gain, known.without(order * line, left)
        told = {
            order: gain
            for order, gain in gains.items()
            if _is_sure(gain, max(noise**2, _power_beside(known, line, order, left)))
        }
        if told and (best is None or sum(told.values()) > best[0]):
            best = (sum(told.values()), line, tuple(told))
    if best is None:
        return None
    _, line, orders_of = best
    hum = known.fitted(line, orders_of, noise**2)
    # What is beside the line is known once the line is out at its own frequency.
    left = known.without_hum(hum)
    beside = max(_power_beside(known, hum.frequency, order, left) for order in orders_of)
    hum = known.fitted(line, orders_of, max(noise**2, beside))
    return hum if abs(hum.frequency - line) < _FURTHEST else None


def _power_beside(known: "_Stretches", line: float, order: int, values: Floats) -> float:
    """Return the mean power of lines beside a multiple of the mains, over what white noise of 1 has."""
    steps = np.linspace(_nearest(known, line), _BESIDE, _CONTROLS // 2)
    return float(np.mean([known.gain((order + step) * line, values) / 2 for step in [*steps, *-steps]]))


def _nearest(known: "_Stretches", line: float) -> float:
    """Return from where on, of the frequency of the mains, another line is told from it."""
    return max(_NEAREST, 1.0 / (known.span * line))


def _is_sure(gain: float, variance: float) -> bool:
    """Whether a line exceeds the noise of others: its power over their mean is F(2, 2 m), (1 + F/m)^-m by chance."""
    return (1.0 + gain / (2 * variance) / _CONTROLS) ** -_CONTROLS < _SURE


class _Stretches:
    """Readings of all stretches without what a polynomial in each of them takes."""

    def __init__(self, time: Floats, values: Floats, stretches: Sequence[Stretch]) -> None:
        self._time, self._bases = [], []
        for part, degree in stretches:
            t = time[part]
            if len(t) > 4 * (degree + 1) and t[-1] - t[0] > _SHORTEST / MAINS[0]:
                s = (t - t[0]) / (t[-1] - t[0])
                self._time.append(t)
                self._bases.append((part, np.linalg.qr(np.polynomial.polynomial.polyvander(s, degree))[0]))
        self.count = sum(len(t) for t in self._time)
        self._middle = float(np.mean(np.concatenate(self._time))) if self._time else 0.0
        self.span = float(self._time[-1][-1] - self._time[0][0]) if self._time else 0.0
        self.values = np.concatenate([_beside(values[part], q) for part, q in self._bases] or [np.zeros(0)])
        self.sum_of_squares = float(self.values @ self.values)

    def _reduced(self, frequency: float, orders: tuple[int, ...], parameters: Floats | None = None) -> Floats:
        columns = []
        for t, (_, q) in zip(self._time, self._bases, strict=True):
            s = t - self._middle
            waves = _waves(s, frequency, orders) if parameters is None else _design(s, frequency, orders, parameters)
            columns.append(_beside(waves, q))
        return np.concatenate(columns)

    def gain(self, frequency: float, values: Floats | None = None) -> float:
        """By how much a line lowers the sum of squares."""
        design = self._reduced(frequency, (1,))
        right = design.T @ (self.values if values is None else values)
        return float(right @ np.linalg.lstsq(design.T @ design, right, rcond=None)[0])

    def without(self, frequency: float, values: Floats) -> Floats:
        """Return the readings without a line."""
        design = self._reduced(frequency, (1,))
        return np.asarray(values - design @ np.linalg.lstsq(design, values, rcond=None)[0])

    def without_hum(self, hum: Hum) -> Floats:
        """Return the readings without a hum at its own frequency."""
        return np.asarray(self.values - self._reduced(hum.frequency, hum.orders) @ hum.parameters)

    def fitted(self, line: float, orders: tuple[int, ...], variance: float) -> Hum:
        """Fit the line; its frequency is known beforehand as a grid keeps it."""
        frequency = line
        design = self._reduced(frequency, orders)
        parameters = np.linalg.lstsq(design, self.values, rcond=None)[0]
        for _ in range(_UPDATES):
            design = self._reduced(frequency, orders, parameters)
            normal = design.T @ design / variance
            left = self.values - design[:, :-1] @ parameters
            right = design.T @ left / variance
            normal[-1, -1] += 1.0 / _U_MAINS**2
            right[-1] += (line - frequency) / _U_MAINS**2
            step = np.linalg.solve(normal, right)
            parameters, frequency = parameters + step[:-1], frequency + float(step[-1])
        return Hum(frequency, self._middle, orders, parameters, np.asarray(np.linalg.inv(normal), float))


def _beside(columns: Floats, basis: Floats) -> Floats:
    """Return columns without their part in an orthonormal basis."""
    return np.asarray(columns - basis @ (basis.T @ columns))


def _waves(s: Floats, frequency: float, orders: tuple[int, ...]) -> Floats:
    angles = [2 * np.pi * order * frequency * s for order in orders]
    return np.stack([wave(angle) for angle in angles for wave in (np.cos, np.sin)], axis=-1)


def _design(s: Floats, frequency: float, orders: tuple[int, ...], parameters: Floats) -> Floats:
    """Return derivatives by all parameters and the frequency."""
    waves = _waves(s, frequency, orders)
    turned = np.zeros(len(s))
    for i, order in enumerate(orders):
        a, b = parameters[2 * i : 2 * i + 2]
        turned += 2 * np.pi * order * s * (b * waves[:, 2 * i] - a * waves[:, 2 * i + 1])
    return np.column_stack([waves, turned])

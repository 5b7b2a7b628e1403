"""Hum of the mains in a record: one line, fitted where nothing else can swing.

Where a body rests or flies its position is a polynomial of time, whatever its material: a line at the frequency of
the mains is then the sensor's. Each stretch has a polynomial of its own, and one line runs through all of them, so
that short stretches determine amplitude and phase, and their distance in time the frequency.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats

MAINS = (50.0, 60.0)
_U_MAINS = 0.05  # Hz, standard uncertainty of the frequency of a grid: the range in which grids are kept
_SURE = 1e-6  # probability by chance of a line that is reported
_CONTROLS = 16  # neighbouring frequencies at which the noise of a line is determined


@dataclass(frozen=True, slots=True)
class Hum:
    """``a cos(2 pi f s) + b sin(2 pi f s)``, f = ``frequency`` [Hz], s from ``epoch`` [s].

    ``parameters`` (2,) are a and b, in the unit of the record; ``covariance`` (3, 3) is that of them and of f.
    """

    frequency: float
    epoch: float
    parameters: Floats
    covariance: Floats

    @property
    def amplitude(self) -> float:
        """Amplitude, in the unit of the record."""
        return float(np.linalg.norm(self.parameters))

    def at(self, time: Floats) -> Floats:
        """Return the hum at times (n,) [s]."""
        return np.asarray(_waves(time - self.epoch, self.frequency) @ self.parameters)

    def modes(self, time: Floats) -> Floats:
        """Return the possible remainder of the hum: independent errors (n, p) of all readings, of one u each."""
        values, vectors = np.linalg.eigh(self.covariance)
        design = _waves(time - self.epoch, self.frequency, self.parameters)
        return np.asarray(design @ (vectors * np.sqrt(np.maximum(values, 0.0))))

    def scaled(self, factor: float) -> "Hum":
        """Return the same hum in another unit."""
        by = np.array([factor, factor, 1.0])
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
        return cls(**kept | {name: np.array(kept[name]) for name in ("parameters", "covariance")})


class Stretch(NamedTuple):
    """Readings that follow a polynomial: at rest (a drift, 1) or in flight (an arc, 2)."""

    part: slice
    degree: int


def hum_at_rest(time: Floats, values: Floats, noise: float) -> tuple[Hum, bool] | None:
    """Find the hum of readings at rest.

    ``time``, ``values`` (n,) [s, any unit] are at rest but for a drift; ``noise`` is the standard deviation of a
    reading, below which a hum is not distinguished from other noise of a short rest. Returned is also whether the
    frequency of the mains is determined, without which the hum must not be continued beyond these readings; None where
    none is found.
    """
    rest = _Stretches(time, values, [Stretch(slice(None), 1)])
    # Hardly a period cannot be distinguished from drift, and few readings a period do not follow a line.
    lines = [line for line in MAINS if rest.span * line >= 0.6 and 8 * line * rest.span <= time.size]
    found = sorted(((rest.gain(line, rest.values), line) for line in lines), reverse=True)
    if not found:
        return None
    gain, line = found[0]
    total, freedom = float(rest.values @ rest.values), time.size - 4
    left = total - gain
    # The probability that white noise looks like this is (left/all)^(freedom / 2).
    if left >= total * _SURE ** (2 / freedom):
        return None
    hum = rest.fitted(line, left / freedom)
    # One frequency of the mains is better than the other by 14 in chi-square: odds of a thousand.
    is_decided = len(found) > 1 and gain - found[1][0] > 14.0 * left / freedom
    return (hum, is_decided) if hum.amplitude > noise else None


def hum_of(
    time: Floats, values: Floats, noise: float, stretches: Sequence[Stretch], otherwise: Hum | None = None
) -> Hum | None:
    """Find the hum that runs through all stretches of a record in which nothing can swing.

    ``noise`` is the standard deviation of the white part. ``otherwise`` is returned where the stretches span too few
    periods to resolve a line from its neighbours, None where no line of the mains exceeds those: the noise of a line is
    that of the neighbouring frequencies, so that flicker or flights that are no parabolas do not pass for a hum. Of
    white noise, the power of a line over the mean of m others is F(2, 2 m).
    """
    known = _Stretches(time, values, stretches)
    # The controls lie at least a line's width away, and nearer than the next multiple.
    nearest = max(0.12, 1.0 / (known.span * MAINS[0])) if known.span else np.inf
    if nearest > 0.35:
        return otherwise
    gain, line = max((known.gain(line, known.values), line) for line in MAINS)
    hum = known.fitted(line, noise**2)
    # The neighbouring power is known once the line is out at its own frequency.
    left = known.values - known.reduced(hum.frequency) @ hum.parameters
    away = np.linspace(nearest, 0.45, _CONTROLS // 2)
    near = [known.gain((1.0 + step) * hum.frequency, left) / 2 for step in [*away, *-away]]
    variance = max(noise**2, float(np.mean(near)))
    by_chance = (1.0 + gain / (2 * variance) / _CONTROLS) ** -_CONTROLS
    if by_chance >= _SURE or abs(hum.frequency - line) >= 10 * _U_MAINS:
        return None
    return known.fitted(line, variance)


class _Stretches:
    """Readings of all stretches, a tenth of a period or longer, less the polynomial of each."""

    def __init__(self, time: Floats, values: Floats, stretches: Sequence[Stretch]) -> None:
        self._parts: list[tuple[Floats, Floats]] = []
        readings = [np.zeros(0)]
        for part, degree in stretches:
            t = time[part]
            if len(t) > 4 * (degree + 1) and t[-1] - t[0] > 0.1 / MAINS[0]:
                s = (t - t[0]) / (t[-1] - t[0])
                basis = np.linalg.qr(np.polynomial.polynomial.polyvander(s, degree))[0]
                self._parts.append((t, basis))
                readings.append(values[part] - basis @ (basis.T @ values[part]))
        self.values = np.concatenate(readings)
        times = np.concatenate([t for t, _ in self._parts]) if self._parts else np.zeros(1)
        self._middle, self.span = float(np.mean(times)), float(times[-1] - times[0])

    def reduced(self, frequency: float, parameters: Floats | None = None) -> Floats:
        """Return the waves, or all derivatives at parameters, less their part in the polynomials."""
        columns = []
        for t, basis in self._parts:
            waves = _waves(t - self._middle, frequency, parameters)
            columns.append(waves - basis @ (basis.T @ waves))
        return np.concatenate(columns)

    def gain(self, frequency: float, values: Floats) -> float:
        """Return the decrease of the sum of squares by one line."""
        design = self.reduced(frequency)
        right = design.T @ values
        return float(right @ np.linalg.lstsq(design.T @ design, right, rcond=None)[0])

    def fitted(self, line: float, variance: float) -> Hum:
        """Fit the line; its frequency is known beforehand as a grid keeps it."""
        frequency = line
        parameters: Floats = np.asarray(np.linalg.lstsq(self.reduced(frequency), self.values)[0], float)
        for _ in range(4):  # the fit is linear in small changes of the frequency
            design = self.reduced(frequency, parameters)
            normal = design.T @ design / variance
            right = design.T @ (self.values - design[:, :-1] @ parameters) / variance
            normal[-1, -1] += 1.0 / _U_MAINS**2
            right[-1] += (line - frequency) / _U_MAINS**2
            step = np.linalg.solve(normal, right)
            parameters, frequency = np.asarray(parameters + step[:-1], float), frequency + float(step[-1])
        return Hum(frequency, self._middle, parameters, np.asarray(np.linalg.inv(normal), float))


def _waves(s: Floats, frequency: float, parameters: Floats | None = None) -> Floats:
    """Return cosine and sine (n, 2); with parameters the derivative by the frequency, too (n, 3)."""
    angle = 2 * np.pi * frequency * s
    waves = np.column_stack([np.cos(angle), np.sin(angle)])
    if parameters is None:
        return waves
    return np.column_stack([waves, 2 * np.pi * s * (parameters[1] * waves[:, 0] - parameters[0] * waves[:, 1])])

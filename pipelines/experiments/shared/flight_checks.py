"""Course of a record where nothing acts on the falling body: a straight line at rest, a parabola in each flight.

Noise scatters about it; a sensor, stand or table that moves leaves it, and a clock that changes bends it otherwise.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL, Check, compared, doubtful_among, in_words, not_made
from labpipe.report import quantity, value_with_uncertainty as shown
from labpipe.signals import Hum
from pipelines.experiments.shared.fall_checks import GUIDE, Fall, G

COURSE, EACH = "course at rest and in flight", f"{G} of each flight"
_MARGIN = 0.02  # of a stretch at either end, where a contact or the release may still act
_SHORTEST, _FEWEST = 4, 8  # readings in a mean, and means in a stretch
_AT_REST, _CONTACTS = "at rest", 4  # contacts without motion after which a body is
_MOSTLY = 0.8  # share of a deviation that one shape explains
_SCANNED = 200  # frequencies
_STEPPED = "the zero of the sensor jumps there: light, cable or range changed, or the sensor was moved"
_CHANGES = "the interval between the rows changes"
_WHY = "settings were changed while it recorded, or rows were left out or inserted and the others numbered anew"
TWO = f"{_CHANGES} within the record: {_WHY}; or the body did not fly freely"
VIBRATES = "table, stand or sensor vibrates"
_TOUCHED = "the body, the stand or the sensor was touched or moved there"


@dataclass(frozen=True)
class _Stretch:
    """Readings (n,) at one polynomial, orthonormal in ``basis`` (n, degree + 1), and what is left of them."""

    name: str
    time: Floats
    basis: Floats
    left: Floats
    fall: tuple[float, float] | None

    @classmethod
    def of(cls, name: str, time: Floats, height: Floats, degree: int, noise: float) -> "_Stretch":
        half = 0.5 * float(time[-1] - time[0])
        basis, upper = np.linalg.qr(np.vander((time - time.mean()) / half, degree + 1, increasing=True))
        inner = basis.T @ height
        left = height - basis @ inner
        if degree < 2:
            return cls(name, time, basis, left, None)
        scatter, bend = max(noise, float(np.sqrt(left @ left / max(time.size - 3, 1)))), float(upper[2, 2]) * half**2
        return cls(name, time, basis, left, (-2.0 * float(inner[2]) / bend, 2.0 * scatter / abs(bend)))

    def waves(self, frequency: float) -> Floats:
        """Return cosine and sine of a frequency [Hz], less their part in the polynomial."""
        angle = 2 * np.pi * frequency * self.time
        waves = np.column_stack([np.cos(angle), np.sin(angle)])
        return np.asarray(waves - self.basis @ (self.basis.T @ waves))


def of_flights(fall: Fall, moved: xr.Dataset) -> list[Check]:
    """Compare the course of every flight and of the body at rest with noise, and the flights with one another."""
    size, swing = _window(fall, moved["time"].values)
    course = _course(fall, known := _stretches(fall, moved, size, swing), swing)
    return [course, not_made(EACH, "flights that are parabolas") if course.level else _acceleration(fall, known)]


def _stretches(fall: Fall, moved: xr.Dataset, size: int, swing: float) -> list[_Stretch]:
    """Cut a record into the body at rest, its fall, its flights, and its rest."""
    time, height = moved["time"].values, np.array(moved["displacement"].values, float)
    for sign, one in ((1, moved), (-1, fall.bounces)):  # the hum of the flights is better known
        if (hum := Hum.of_text(one.attrs.get("hum"))) is not None:
            height += sign * hum.at(time)
    height *= int(fall.bounces.attrs["direction"])
    read = np.isfinite(height)
    time, height, noise = time[read], height[read], float(fall.bounces.attrs["noise"])
    touch, liftoff = fall.values("touch_time"), fall.values("liftoff_time")
    release = float(fall.values("release_time"))
    parts = [("before the release", -np.inf, release, 1), ("in the fall", release, touch[0], 2)]
    parts += [
        (f"in the flight after impact {i + 1}", *ends, 2)
        for i, ends in enumerate(zip(liftoff, touch[1:], strict=False))
    ]
    if (rest := _rest(fall, time, height, size, swing)) is not None:
        parts.append((_AT_REST, rest, np.inf, 1))
    found = list[_Stretch]()
    for name, begin, end, degree in parts:
        first, stop = np.searchsorted(time, [begin, end])
        margin = 2 + int(_MARGIN * (stop - first))
        part = slice(first + margin, stop - margin)
        if part.stop - part.start >= _SHORTEST * _FEWEST:
            found.append(_Stretch.of(name, time[part], height[part], degree, noise))
    return found


def _window(fall: Fall, time: Floats) -> tuple[int, float]:
    """Return the number of readings by which a body counts as at rest, and how far it may still swing unseen [m]."""
    lasts = _CONTACTS * float(np.nanmax(fall.values("contact_duration")))
    size = max(int(np.searchsorted(time - time[0], lasts)), _FEWEST)
    return size, float(fall.bounces.attrs["noise"]) * sqrt(2 * DOUBTFUL * sqrt(2.0 / size))


def _rest(fall: Fall, time: Floats, height: Floats, size: int, swing: float) -> float | None:
    """Find the time from which the body has rested for some contacts, whatever moves it later."""
    first = int(np.searchsorted(time, float(fall.values("settling_time"))))
    if first + size >= time.size:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(height[first:], size)
    line = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), 2))[0]
    left = windows - (windows @ line) @ line.T  # a table may sway, slowly
    still = np.flatnonzero(np.mean(left**2, axis=1) < float(fall.bounces.attrs["noise"]) ** 2 + 0.5 * swing**2)
    return float(time[first + still[0]]) if still.size else None


def _acceleration(fall: Fall, known: Sequence[_Stretch]) -> Check:
    """Compare every flight's acceleration with that of the others: a clock that changes within a record alters it."""
    g, u_g = fall.value("fall_acceleration")
    if (other := fall.bounces.attrs.get("other_fall")) is not None:
        when, seen, own = json.loads(other)
        text = f"{fall.name}: flights from {quantity(when, 's')} on have {shown(seen, own, 'm/s2')}, those before "
        text += f"{shown(g, u_g, 'm/s2')}; they are not evaluated"
        place: dict[str, Any] = {
            "cause": f"{_CHANGES} there, to {in_words(sqrt(seen / g))} times the one before: {_WHY}",
            "file": fall.name,
            "factor": False,
        }
        return compared(EACH, text, seen, own, g, u_g, allowance=GUIDE * g, **place)
    flights = [(one, *one.fall) for one in known if one.fall is not None]
    if len(flights) < 2:
        return not_made(EACH, "two flights")
    worst, seen, own = max(flights, key=lambda one: abs(one[1] - g) / one[2])
    u, begin = hypot(own, u_g) * doubtful_among(len(flights)) / DOUBTFUL, quantity(float(worst.time[0]), "s")
    text = f"{fall.name}: {shown(seen, own, 'm/s2')} {worst.name}, from {begin} on, {shown(g, u_g, 'm/s2')} in all"
    return compared(EACH, text, seen, u, g, 0.0, allowance=GUIDE * g, factor=False, file=fall.name, cause=TWO)


def _course(fall: Fall, known: Sequence[_Stretch], swing: float) -> Check:
    """Compare what is left of each stretch with noise, by means over 4, 8, 16, ... readings."""
    if not known:
        return not_made(COURSE, f"{_SHORTEST * _FEWEST} readings at rest or in flight")
    sizes = _SHORTEST * 2 ** np.arange(int(np.log2(max(one.time.size for one in known) / _SHORTEST / _FEWEST)) + 1)
    means = {
        (k, int(n)): one.left[: one.left.size // n * n].reshape(-1, n).mean(axis=1)
        for n in sizes
        for k, one in enumerate(known)
        if one.time.size >= n * _FEWEST
    }
    noise, trials = float(fall.bounces.attrs["noise"]), sum(each.size for each in means.values())
    worst = (0.0, 0.0, 0, 0.0)
    for n in map(int, sizes):
        of_size = {k: each for (k, size), each in means.items() if size == n}
        # noise that is not white shows in most stretches
        scatter = float(np.median([np.sqrt(np.mean(each**2)) for each in of_size.values()]))
        u = max(noise / sqrt(n), scatter)
        for k, each in of_size.items():
            at, allowed = int(np.argmax(np.abs(each))), swing * (known[k].name == _AT_REST)
            by, when = float(each[at]), float(known[k].time[at * n + n // 2])
            worst = max(worst, ((abs(by) - allowed) / u, by, k, when))
    beyond, by, k, when = worst
    margin = beyond * DOUBTFUL / doubtful_among(trials)
    text = f"{fall.name}: {known[k].name} readings differ by {quantity(abs(by), 'm')} from "
    course = "line" if known[k].fall is None else "parabola"
    text += f"a {course} at {quantity(when, 's')}, noise {quantity(noise, 'm')}"
    if margin <= DOUBTFUL:
        return Check(COURSE, text, None, margin, file=fall.name)
    return Check(COURSE, text, "doubtful", margin, cause=_shape(known, k, noise, when), file=fall.name)


def _shape(known: Sequence[_Stretch], k: int, noise: float, when: float) -> str:
    """Return the cause that the shape of a deviation shows: a step, a vibration of the whole record, or a touch."""
    left, basis = known[k].left, known[k].basis
    excess = float(left @ left) - left.size * noise**2
    # a step up at each reading: orthogonal to the polynomial, it takes its product with the rest
    after = np.cumsum(left[::-1])[::-1]
    size = np.arange(left.size, 0, -1) - np.sum(np.cumsum(basis[::-1], axis=0)[::-1] ** 2, axis=1)
    inner = slice(2, -2)
    gain = after[inner] ** 2 / size[inner]
    at = 2 + int(np.argmax(gain))
    if gain.max() > _MOSTLY * excess:
        step, moment = float(after[at] / size[at]), float(known[k].time[at])
        return f"at {quantity(moment, 's')} the readings step by {quantity(abs(step), 'm')}: {_STEPPED}"
    stretches = [known[k], *(one for n, one in enumerate(known) if n != k)]
    everything, size = np.concatenate([one.left for one in stretches]), left.size
    span = max(float(one.time[-1]) for one in known) - min(float(one.time[0]) for one in known)
    best = (0.0, 0.0, 0.0, 0.0)
    for frequency in np.geomspace(1.0 / span, _SCANNED / span, _SCANNED):
        waves = np.concatenate([one.waves(frequency) for one in stretches])
        fitted = np.linalg.lstsq(waves.T @ waves, waves.T @ everything, rcond=None)[0]
        course = waves @ fitted
        taken = course * (2.0 * everything - course)  # off the squares
        best = max(best, (float(taken.sum()), frequency, float(np.linalg.norm(fitted)), float(taken[size:].sum())))
    total = float(everything @ everything) - everything.size * noise**2
    # of a touch that lasts as long as a stretch the others show nothing
    is_common = best[3] > (DOUBTFUL * noise) ** 2
    if best[0] > _MOSTLY * total and (is_common or best[1] * float(known[k].time[-1] - known[k].time[0]) > 2.0):
        return f"{VIBRATES}, {quantity(best[2], 'm')} at {in_words(best[1], 2)} Hz: put it on firm ground"
    return f"{_TOUCHED} ({quantity(when, 's')})"

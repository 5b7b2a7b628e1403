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
_AT_REST = "at rest"
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


def of_flights(
    fall: Fall, moved: xr.Dataset, *, shortest: int = 4, fewest: int = 8, contacts: int = 4, margin: float = 0.02
) -> list[Check]:
    """Compare the course of every flight and of the body at rest with noise, and the flights with one another.

    What is left of each stretch is compared by means over ``shortest``, 2, 4, ... times as many readings, at least
    ``fewest`` of them in a stretch, without the ``margin`` at either end, where a contact or the release may still act.
    A body is at rest after as long as some ``contacts`` without motion.
    """
    noise, time = float(fall.bounces.attrs["noise"]), moved["time"].values
    lasts = contacts * float(np.nanmax(fall.values("contact_duration")))
    size = max(int(np.searchsorted(time - time[0], lasts)), fewest)
    swing = noise * sqrt(2 * DOUBTFUL * sqrt(2.0 / size))  # of a body that counts as at rest
    known = _stretches(fall, moved, size, swing, shortest * fewest, margin)
    if not known:
        text = f"{shortest * fewest} readings at rest or in flight"
        return [not_made(COURSE, text), _acceleration(fall, known)]
    sizes = shortest * 2 ** np.arange(int(np.log2(max(one.time.size for one in known) / shortest / fewest)) + 1)
    worst, trials = (0.0, 0.0, 0, 0.0), 0
    for n in map(int, sizes):
        means = {
            k: one.left[: one.left.size // n * n].reshape(-1, n).mean(axis=1)
            for k, one in enumerate(known)
            if one.time.size >= n * fewest
        }
        # noise that is not white shows in most stretches
        u = max(noise / sqrt(n), float(np.median([np.sqrt(np.mean(each**2)) for each in means.values()])))
        for k, each in means.items():
            at, allowed = int(np.argmax(np.abs(each))), swing * (known[k].name == _AT_REST)
            by, when = float(each[at]), float(known[k].time[at * n + n // 2])
            worst, trials = max(worst, ((abs(by) - allowed) / u, by, k, when)), trials + each.size
    beyond, by, k, when = worst
    over = beyond * DOUBTFUL / doubtful_among(trials)
    course = "line" if known[k].fall is None else "parabola"
    text = f"{fall.name}: {known[k].name} readings differ by {quantity(abs(by), 'm')} from a {course} at "
    text += f"{quantity(when, 's')}, noise {quantity(noise, 'm')}"
    if over <= DOUBTFUL:
        return [Check(COURSE, text, None, over, file=fall.name), _acceleration(fall, known)]
    bent = Check(COURSE, text, "doubtful", over, cause=_shape(known, k, noise, when), file=fall.name)
    return [bent, not_made(EACH, "flights that are parabolas")]


def _stretches(fall: Fall, moved: xr.Dataset, size: int, swing: float, least: int, share: float) -> list[_Stretch]:
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
    settled = int(np.searchsorted(time, float(fall.values("settling_time"))))
    if settled + size < time.size:  # it has rested for some contacts, whatever moves it later
        windows = np.lib.stride_tricks.sliding_window_view(height[settled:], size)
        line = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), 2))[0]
        left = windows - (windows @ line) @ line.T  # a table may sway, slowly
        still = np.flatnonzero(np.mean(left**2, axis=1) < noise**2 + 0.5 * swing**2)
        parts += [(_AT_REST, float(time[settled + still[0]]), np.inf, 1)] if still.size else []
    found = list[_Stretch]()
    for name, begin, end, degree in parts:
        first, stop = np.searchsorted(time, [begin, end])
        margin = 2 + int(share * (stop - first))
        part = slice(first + margin, stop - margin)
        if part.stop - part.start >= least:
            found.append(_Stretch.of(name, time[part], height[part], degree, noise))
    return found


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


def _shape(
    known: Sequence[_Stretch], k: int, noise: float, when: float, mostly: float = 0.8, scanned: int = 200
) -> str:
    """Return the cause that the shape of a deviation shows: a step, a vibration of the whole record, or a touch.

    A shape explains the ``mostly`` part of it; of vibrations so many frequencies are ``scanned``.
    """
    left, basis = known[k].left, known[k].basis
    excess = float(left @ left) - left.size * noise**2
    # a step up at each reading: orthogonal to the polynomial, it takes its product with the rest
    after = np.cumsum(left[::-1])[::-1]
    size = np.arange(left.size, 0, -1) - np.sum(np.cumsum(basis[::-1], axis=0)[::-1] ** 2, axis=1)
    inner = slice(2, -2)
    gain = after[inner] ** 2 / size[inner]
    at = 2 + int(np.argmax(gain))
    if gain.max() > mostly * excess:
        step, moment = float(after[at] / size[at]), float(known[k].time[at])
        return f"at {quantity(moment, 's')} the readings step by {quantity(abs(step), 'm')}: {_STEPPED}"
    stretches = [known[k], *(one for n, one in enumerate(known) if n != k)]
    everything, size = np.concatenate([one.left for one in stretches]), left.size
    span = max(float(one.time[-1]) for one in known) - min(float(one.time[0]) for one in known)
    best = (0.0, 0.0, 0.0, 0.0)
    for frequency in np.geomspace(1.0 / span, scanned / span, scanned):
        waves = np.concatenate([one.waves(frequency) for one in stretches])
        fitted = np.linalg.lstsq(waves.T @ waves, waves.T @ everything, rcond=None)[0]
        course = waves @ fitted
        taken = course * (2.0 * everything - course)  # off the squares
        best = max(best, (float(taken.sum()), frequency, float(np.linalg.norm(fitted)), float(taken[size:].sum())))
    total = float(everything @ everything) - everything.size * noise**2
    # of a touch that lasts as long as a stretch the others show nothing
    is_common = best[3] > (DOUBTFUL * noise) ** 2
    if best[0] > mostly * total and (is_common or best[1] * float(known[k].time[-1] - known[k].time[0]) > 2.0):
        return f"{VIBRATES}, {quantity(best[2], 'm')} at {in_words(best[1], 2)} Hz: put it on firm ground"
    return f"{_TOUCHED} ({quantity(when, 's')})"

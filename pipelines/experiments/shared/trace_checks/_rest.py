"""Checks of a body that should be at rest, before its release: no drift, vibration, average or hum."""

from collections.abc import Sequence
from math import pi

import numpy as np
import xarray as xr

from labpipe.judging import Check, Level, not_made, stated
from labpipe.report import quantity
from labpipe.signals import Hum
from pipelines.experiments.shared.trace_checks._trace import LIMITS, QUIET, Trace

_BEFORE = 2e-3  # s before a release that was found, while which something may move already
_TURNS = 2  # periods of a vibration, without which it cannot be told from a drift
_CHANCE = 1e-6  # probability by which white noise swings so
_AT_MOST = 2.0
"""Times what the strongest line of a spectrum explains, more than which no sine of a frequency near it does: with few
turns a drift shares a part of it."""
_PIECES, _BURSTS = 20, 3.0
"""Of what is at rest, and times as wide as the quiet ones, from which on a piece swings."""
_IN_PROPORTION = 0.3  # of the exponent 1 with which a moving average's differences grow
_SHORT = 2  # doublings of the lag at most, until they exceed what rounding adds
_FALL = (0.4, 2.5)  # times g, curvature of a beginning in mid-fall
_HUM = 0.01  # of the travel, beyond which what is left of a hum is doubtful
MOVES = (
    "the readings do not begin at rest: the record begins in mid-motion, its rows stand in reverse order, the sensor "
    "drifts or hums, or the wrong channel was recorded"
)
SWING, SMOOTHED = "vibration before the release", "noise of neighbouring readings"


def rest_of(trace: Trace, results: Sequence[xr.Dataset]) -> slice:
    """Return the readings before a release that was found, else the first ones."""
    found = [float(one["release_time"]) for one in results if "release_time" in one]
    end = int(np.searchsorted(trace.time, found[-1] - _BEFORE)) if found and np.isfinite(found[-1]) else 0
    return slice(0, max(end, QUIET))


def swing_at_rest(trace: Trace, rest: slice, fewest: int = QUIET) -> tuple[float, float] | None:
    """Return frequency [Hz] and amplitude [m] with which a body swings that should be at rest; None where it does not.

    Of white noise the best of n/2 lines leaves so little by chance with n/2 (left/all)^((n - 4)/2).
    """
    known = np.flatnonzero(np.isfinite(trace.reading[rest]))
    if known.size < fewest or trace.travel == 0.0:
        return None
    t, x = trace.time[known] - trace.time[known[0]], trace.reading[known]
    span = float(t[-1])
    flat = np.stack([np.ones_like(t), t / span, (t / span) ** 2], axis=1)  # a drift, or a fall
    drift = x - flat @ np.linalg.lstsq(flat, x, rcond=None)[0]
    power = np.abs(np.fft.rfft(drift, 4 * t.size))
    power[: 4 * _TURNS] = 0.0  # fewer turns are a drift
    limit = float(drift @ drift) * (_CHANCE / t.size) ** (2 / (t.size - 4))
    if float(drift @ drift) - _AT_MOST * 2.0 * float(power.max()) ** 2 / t.size > limit:
        return None
    guess = int(np.argmax(power)) / (4 * span * t.size / (t.size - 1))
    best, amplitude, left = 0.0, 0.0, np.inf
    for f in np.linspace(guess - 0.5 / span, guess + 0.5 / span, 21):
        design = np.column_stack([flat, np.cos(2 * pi * f * t), np.sin(2 * pi * f * t)])
        fitted = np.linalg.lstsq(design, x, rcond=None)[0]
        if (sum_of_squares := float(np.sum((x - design @ fitted) ** 2))) < left:
            best, amplitude, left = float(f), float(np.hypot(*fitted[3:])), sum_of_squares
    is_sure = left < limit
    is_seen = 2 * amplitude > LIMITS[0] * trace.travel and amplitude > trace.resolution
    return (best, amplitude) if is_sure and is_seen else None


def swing(trace: Trace, rest: slice) -> Check:
    """Look for one frequency in a body that should be at rest."""
    title, law = SWING, "before its release the body is at rest"
    if trace.reading[rest].size < QUIET:
        return not_made(title, law, f"{QUIET} readings")
    if (found := swing_at_rest(trace, rest)) is None:
        return stated(title, law, f"{trace.name}: no vibration before the release", None, file=trace.name)
    f, amplitude = found
    text = f"{trace.name}: before the release the readings swing at {f:.3g} Hz by ± {quantity(amplitude, 'm')}"
    cause = (
        f"the sensor, its clamp or the bench shakes at {f:.3g} Hz: fasten it; or another sensor, a lamp or a supply "
        "disturbs it at that frequency"
    )
    if (struck := _burst(trace, rest)) is not None:
        cause = f"something struck the bench, the stand or the sensor at {trace.at(struck)}, before the release"
    level: Level = "doubtful" if 2 * amplitude > LIMITS[1] * trace.travel else "note"
    return stated(title, law, text, level, file=trace.name, cause=cause)


def _burst(trace: Trace, rest: slice) -> int | None:
    """Return the first reading of a swing that comes at once and dies away; None for one that goes on."""
    known = np.flatnonzero(np.isfinite(trace.reading[rest]))
    pieces = np.array_split(known, _PIECES)
    spread = np.array([np.ptp(trace.reading[piece]) for piece in pieces])
    loud = np.flatnonzero(spread > _BURSTS * max(float(np.quantile(spread, 0.25)), trace.resolution))
    if loud.size < 2 or loud[0] < 2:
        return None
    dies = int(np.argmax(spread)) <= int(loud[0]) + loud.size // 3
    return int(pieces[int(loud[0])][0]) if dies else None


def smoothed(trace: Trace, rest: slice) -> Check:
    """Look whether neighbouring readings share their noise, as means over several readings do.

    The mean square of x(t + k) - x(t) is the same for all k in white noise; a moving average of n
    readings lets it grow in proportion to k up to n, a motion with k squared.
    """
    title, law = SMOOTHED, "readings that are not averaged have each a noise of its own"
    x = trace.reading[rest]
    x = x[np.isfinite(x)]
    if x.size < QUIET:
        return not_made(title, law, f"{QUIET} readings at rest")
    lags = 2 ** np.arange(int(np.log2(x.size / 3)) + 1)
    of_display = trace.resolution**2 / 6.0  # what rounding adds
    apart = np.array([float(np.mean((x[k:] - x[:-k]) ** 2)) for k in lags]) - of_display
    first = int(np.argmax(apart > of_display))
    grows = np.diff(np.log2(np.maximum(apart[first:], 1e-300)))
    lag = int(lags[first])
    text = f"{trace.name}: readings {2 * lag} apart differ {2 ** (grows[0] / 2) if grows.size else 1.0:.2g} times as "
    text += f"much as those {lag} apart"
    is_mean = first <= _SHORT and grows.size > 2 and (np.abs(grows[:2] - 1.0) < _IN_PROPORTION).all()
    if not is_mean or not apart[first] > of_display:
        return stated(title, law, text, None, file=trace.name)
    count = round(lag * float(np.median(apart[-2:]) / apart[first]))
    interval = float(np.median(np.diff(trace.time)))
    cause = (
        f"the controller averages over about {count} readings ({quantity(count * interval, 's')}), or a filter of it "
        "was left on: what is shorter, such as an impact, is smeared; set the average to 1"
    )
    return stated(title, law, text, "doubtful", file=trace.name, cause=cause)


def beginning(trace: Trace, gravity: float) -> Check:
    """Hold the first readings against a body at rest."""
    title, law = "beginning of the record", "before its release the body is at rest"
    known = np.flatnonzero(np.isfinite(trace.reading))[:QUIET]
    if known.size < QUIET:
        return not_made(title, law, f"{QUIET} readings")
    t = trace.time[known] - trace.time[known[0]]
    x = trace.reading[known]
    keep = np.abs(x - np.median(x)) <= max(0.25 * trace.travel, 20 * trace.noise)
    t, x = t[keep], x[keep]
    span = float(t[-1])
    noise = max(trace.noise, 0.3 * trace.resolution, 1e-12)
    if t.size < QUIET // 2 or span == 0.0:
        return not_made(title, law, "a quiet beginning")
    bend = 2 * float(np.polynomial.Polynomial.fit(t, x, 2).convert().coef[-1])
    u_bend = noise * np.sqrt(720.0 / t.size) / span**2
    slope = float(np.polyfit(t, x, 1)[0])
    u_slope = noise * np.sqrt(12.0 / t.size) / span
    if _FALL[0] * gravity < abs(bend) < _FALL[1] * gravity and abs(bend) > 10 * u_bend:
        text = f"{trace.name}: the first {quantity(span, 's')} are curved by {quantity(abs(bend), 'm/s2')}: a fall"
        cause = (
            "the record begins in mid-fall: the body was released before the trigger; record from earlier on. "
            "Its release and height are not measured"
        )
        return stated(title, law, text, "impossible", file=trace.name, cause=cause)
    length = float(trace.time[-1] - trace.time[0])
    drift = abs(slope) * length
    is_sure = abs(slope) > 10 * u_slope and abs(bend) * span < abs(slope)
    part = drift / trace.travel if trace.travel > 0 else 0.0
    if not is_sure or part < LIMITS[0] or drift < 10 * noise:
        return stated(title, law, f"{trace.name}: at rest in the beginning", None, file=trace.name)
    text = (
        f"{trace.name}: the readings drift by {quantity(slope, 'm/s')} before the release, "
        f"{quantity(drift, 'm')} over the record"
    )
    level: Level = "impossible" if part > LIMITS[2] else "doubtful" if part > LIMITS[1] else "note"
    cause = "drift of the sensor or of what holds it: let it warm up, or fasten it"
    return stated(title, law, text, level, file=trace.name, cause=cause)


def hum(trace: Trace, line: Hum | None, *, is_known: bool) -> Check:
    """Say which hum of the mains was taken out of a record, and what may be left of it."""
    title, law = ("noise of the record", "noise of a sensor has no line at the frequency of the mains")
    if not is_known:
        return not_made(title, law, "a displacement")
    if line is None:
        return stated(title, law, f"{trace.name}: no line of the mains", None, file=trace.name)
    left = float(np.sqrt(np.mean(line.remaining(trace.time) ** 2)))
    multiples = ", ".join(f"{order * line.frequency:.4g} Hz" for order in line.orders)
    text = (
        f"{trace.name}: hum of {quantity(line.amplitude, 'm')} at {multiples}, taken out of the readings to "
        f"± {quantity(left, 'm')}, which is in the uncertainties"
    )
    cause = "mains hum: ground the sensor, or average over one period"
    return stated(title, law, text, "note" if left < _HUM * trace.travel else "doubtful", file=trace.name, cause=cause)

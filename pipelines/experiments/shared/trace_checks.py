"""Checks of a sensor's readings by themselves, before anything is found in them.

A body has inertia: between two readings it moves no further than its speed allows, it does not
stand still in mid-flight, and its noise never repeats itself. What breaks that is the sensor, the
cable or the file, and it is told with its place in time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import pi

import numpy as np
import xarray as xr

from labpipe.judging import Check, Level, not_made, stated
from labpipe.report import quantity
from labpipe.signals import Hum, quantisation_step
from pipelines.experiments.shared.judgements import day_known

FLAT = 6
"""Equal readings in a row that a moving body does not give."""
_SLOW = 0.05  # of the largest step, below which a body may rest on one reading
_BESIDE = 4  # readings on either side of equal ones that tell whether the body moves there
_FASTER = 3.0  # times the largest usual step between two readings, beyond which it is a jump
_LEAST_JUMP = 0.02  # of the travel
_IN_NOISE = 8.0  # standard deviations of noise that a jump exceeds
_RETURN = 3  # readings within which a spike is over
_MANY_SPIKES = 0.01  # of all readings
_BLOCK = 48  # = 2 · 2 · 2 · 2 · 3, readings that do not repeat by chance
_LIVELY = 24  # of which at least so many differ from the one before
_MIXING = np.uint64(0x9E3779B97F4A7C15)
_LONG = 200  # stretches in a row that two records share by copying alone, also where noise is below the display's step
_WHOLE = 0.8  # of the shorter record
_SAME_NOISE = 0.5  # correlation of the noise of two records, from which on one is a copy of the other
_MORE = 0.2  # of a record, by which noise is shared beyond the readings that are the same
_BEYOND = 4.0  # times its usual size, to which what is no noise is cut
_COARSE, _TOO_COARSE = 5e-3, 3e-2  # of the travel
_SINE, _LINE = 0.98, 0.7
"""Of the variance; and of the power in three neighbouring lines, of which a sine has more than 0.8 in any phase."""
_BEFORE = 2e-3  # s before a release that was found, while which something may move already
_TURNS = 2  # periods of a vibration, without which it cannot be told from a drift
_CHANCE = 1e-6  # probability by which white noise swings so
_IN_PROPORTION = 0.3  # of the exponent 1 with which a moving average's differences grow
_QUIET = 200  # readings at the beginning that should be still
_FALL = (0.4, 2.5)  # times g, curvature of a beginning in mid-fall
_HUM = 0.01  # of the travel, beyond which what is left of a hum is doubtful
_OBLIQUE = pi / 4  # between line of sight and motion: no makers' sensor sees its spot from further aside
_VAGUE = pi / 60  # u of an inclination: what was measured, even by eye, is known better
_UNKNOWN = 0.2  # relative u of a calibrated length, beyond which it was not calibrated
_LOUDER, _LATE = 5.0, 0.3  # times the noise at rest, and parts of an interval, of readings at uneven times
_REGULAR = 0.02  # of a period, within which spikes come one each period
_LIMITS = (1e-3, 0.02, 0.2)  # of the travel: drift over the record that is told, doubtful, impossible

_HELD = (
    "the sensor was out of its range (clipped) or held its last value: the impact is not measured there; "
    "move the sensor or choose a larger range"
)
OUT_OF_RANGE = (
    "the sensor was out of its range, and the controller wrote that in place of a reading: the impact "
    "is not measured there; move the sensor or choose a larger range"
)
IN_MOTION = (
    "the readings do not begin at rest: the record begins in mid-motion, the sensor drifts or hums, or the wrong "
    "channel was recorded"
)
SWING = "vibration before the release"
WRONG_CHANNEL = "the wrong channel or file was recorded, or the sensor did not see the body"


@dataclass(frozen=True)
class Trace:
    """The readings of one record.

    Attributes
    ----------
    name : str
        File, for messages.
    time, reading : array (time,)
        In s and m; NaN where there is no valid reading.
    header : str
        What the file says above its readings.
    """

    name: str
    time: np.ndarray
    reading: np.ndarray
    header: str = ""

    @classmethod
    def of(cls, name: str, readings: xr.Dataset, output: str) -> "Trace | None":
        """Take one output; None where it is not there or no length."""
        if output not in readings or readings[output].attrs.get("units") != "m":
            return None
        x = np.array(readings[output].values, float)
        state = output.replace("out", "status")
        if state in readings:
            x[readings[state].values != 0] = np.nan
        return cls(name, readings["time"].values, x, str(readings.attrs.get("header", "")))

    @cached_property
    def travel(self) -> float:
        """Range of the readings without their extremes [m]."""
        low, high = np.nanquantile(self.reading, [0.005, 0.995])
        return float(high - low)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a reading, from second differences [m]."""
        bend = np.diff(self.reading, 2)
        bend = bend[np.isfinite(bend)]
        return float(1.4826 * np.median(np.abs(bend)) / np.sqrt(6.0)) if bend.size else 0.0

    @cached_property
    def resolution(self) -> float:
        """Smallest difference between two readings [m]."""
        x = self.reading[np.isfinite(self.reading)]
        return float(quantisation_step(x)) if np.unique(x).size > 1 else 0.0

    def at(self, index: int) -> str:
        """Write the time of a reading."""
        return quantity(float(self.time[index]), "s")


def checks_of(trace: Trace, gravity: float, *found_in: xr.Dataset | None) -> list[Check]:
    """Make all checks of a trace, those first that explain others; a hum is told by the last result there is."""
    if np.isfinite(trace.reading).sum() < 10 * FLAT:
        return [not_made("readings", "a record has readings", "sixty valid readings")]
    held = held_readings(trace)
    found = [unread(trace), held, repeated_rows(trace), wave(trace)]
    if held.level is None:
        found.append(jumps(trace))
    results = [one for one in found_in if one is not None]
    line = Hum.of_text(results[-1].attrs.get("hum")) if results else None
    found += [hum(trace, line, is_known=bool(results)), resolution(trace), timing(trace)]
    rest = _rest_of(trace, results)
    found.append(smoothed(trace, rest))
    if line is None:
        shaken = swing(trace, rest)
        found.append(shaken)
        if not shaken.level:
            found.append(beginning(trace, gravity))
    return found


def _rest_of(trace: Trace, results: Sequence[xr.Dataset]) -> slice:
    """Return the readings before a release that was found, else the first ones."""
    found = [float(one["release_time"]) for one in results if "release_time" in one]
    end = int(np.searchsorted(trace.time, found[-1] - _BEFORE)) if found and np.isfinite(found[-1]) else 0
    return slice(0, max(end, _QUIET))


def swing_at_rest(trace: Trace, rest: slice) -> tuple[float, float] | None:
    """Return frequency [Hz] and amplitude [m] with which a body swings that should be at rest; None where it does not.

    Of white noise the best of n/2 lines leaves so little by chance with n/2 (left/all)^((n - 4)/2).
    """
    known = np.flatnonzero(np.isfinite(trace.reading[rest]))
    if known.size < _QUIET or trace.travel == 0.0:
        return None
    t, x = trace.time[known] - trace.time[known[0]], trace.reading[known]
    span = float(t[-1])
    flat = np.stack([np.ones_like(t), t / span, (t / span) ** 2], axis=1)  # a drift, or a fall
    drift = x - flat @ np.linalg.lstsq(flat, x, rcond=None)[0]
    power = np.abs(np.fft.rfft(drift, 4 * t.size))
    power[: 4 * _TURNS] = 0.0  # fewer turns are a drift
    guess = int(np.argmax(power)) / (4 * span * t.size / (t.size - 1))
    best, amplitude, left = 0.0, 0.0, np.inf
    for f in np.linspace(guess - 0.5 / span, guess + 0.5 / span, 21):
        design = np.column_stack([flat, np.cos(2 * pi * f * t), np.sin(2 * pi * f * t)])
        fitted = np.linalg.lstsq(design, x, rcond=None)[0]
        if (sum_of_squares := float(np.sum((x - design @ fitted) ** 2))) < left:
            best, amplitude, left = float(f), float(np.hypot(*fitted[3:])), sum_of_squares
    is_sure = left < float(drift @ drift) * (_CHANCE / t.size) ** (2 / (t.size - 4))
    is_seen = 2 * amplitude > _LIMITS[0] * trace.travel and amplitude > trace.resolution
    return (best, amplitude) if is_sure and is_seen else None


def speed_of_swing(trace: Trace, *found_in: xr.Dataset | None) -> float:
    """Return the speed [m/s] that a swing before the release adds and takes while it lasts; 0 without one."""
    found = swing_at_rest(trace, _rest_of(trace, [one for one in found_in if one is not None]))
    return 0.0 if found is None else 2 * pi * found[0] * found[1]


def swing(trace: Trace, rest: slice) -> Check:
    """Look for one frequency in a body that should be at rest."""
    title, law = SWING, "before its release the body is at rest"
    if trace.reading[rest].size < _QUIET:
        return not_made(title, law, f"{_QUIET} readings")
    if (found := swing_at_rest(trace, rest)) is None:
        return stated(title, law, f"{trace.name}: no vibration before the release", None, file=trace.name)
    f, amplitude = found
    text = f"{trace.name}: before the release the readings swing at {f:.3g} Hz by ± {quantity(amplitude, 'm')}"
    cause = (
        f"the sensor, its clamp or the bench shakes at {f:.3g} Hz: fasten it; or another sensor, a lamp or a supply "
        "disturbs it at that frequency"
    )
    level: Level = "doubtful" if 2 * amplitude > _LIMITS[1] * trace.travel else "note"
    return stated(title, law, text, level, file=trace.name, cause=cause)


def smoothed(trace: Trace, rest: slice) -> Check:
    """Look whether neighbouring readings share their noise, as means over several readings do.

    The mean square of x(t + k) - x(t) is the same for all k in white noise; a moving average of n
    readings lets it grow in proportion to k up to n, a motion with k squared.
    """
    title, law = "noise of neighbouring readings", "readings that are not averaged have each a noise of its own"
    x = trace.reading[rest]
    x = x[np.isfinite(x)]
    if x.size < _QUIET:
        return not_made(title, law, f"{_QUIET} readings at rest")
    lags = 2 ** np.arange(int(np.log2(x.size / 3)) + 1)
    apart = np.array([float(np.mean((x[k:] - x[:-k]) ** 2)) for k in lags])
    grows = np.diff(np.log2(np.maximum(apart, 1e-300)))
    text = f"{trace.name}: readings two apart differ {2 ** (grows[0] / 2):.2g} times as much as neighbours"
    is_mean = (np.abs(grows[:2] - 1.0) < _IN_PROPORTION).all() and apart[0] > trace.resolution**2
    if not is_mean:
        return stated(title, law, text, None, file=trace.name)
    count = round(float(np.median(apart[-2:]) / apart[0]))
    interval = float(np.median(np.diff(trace.time)))
    cause = (
        f"the controller averages over about {count} readings ({quantity(count * interval, 's')}), or a filter of it "
        "was left on: what is shorter, such as an impact, is smeared; set the average to 1"
    )
    return stated(title, law, text, "doubtful", file=trace.name, cause=cause)


def unread(trace: Trace) -> Check:
    """Look for readings that the sensor gave as invalid."""
    title, law = "readings out of range", "a sensor sees the body all the time"
    lost = ~np.isfinite(trace.reading)
    longest, start = _longest_run(lost)
    if not longest:
        return stated(title, law, f"{trace.name}: every reading is valid", None, file=trace.name)
    text = (
        f"{trace.name}: {int(lost.sum())} readings are out of range or invalid, {longest} of them in a row "
        f"from {trace.at(start)}: what the body does there is not measured"
    )
    level: Level = "doubtful" if longest >= FLAT else "note"
    return stated(title, law, text, level, file=trace.name, cause=OUT_OF_RANGE)


def of_record(displacement: xr.Dataset | None, record: str) -> list[Check]:
    """Check what a calibration record states of the sensor that gave a displacement."""
    return [sight(displacement, record), scale_known(displacement, record), day_known(displacement, record)]


def sight(displacement: xr.Dataset | None, record: str) -> Check:
    """Hold the inclination that a calibration record states against what a sensor can see.

    Where nothing falls freely no acceleration tells the cosine, and lengths alone would carry it.
    """
    name, law = "line of sight", "a triangulation sensor looks along the motion it measures, not from aside"
    if displacement is None or "inclination" not in displacement:
        return not_made(name, law, "a displacement")
    angle, u = float(displacement["inclination"]), float(displacement["u_inclination"])
    text = f"{record}: inclination ({np.rad2deg(angle):.3g} ± {np.rad2deg(u):.2g})°, lengths are divided by its cosine"
    level: Level | None = "doubtful" if angle > _OBLIQUE or u > _VAGUE else None
    cause = (
        f"u of the inclination in {record} is probably not {np.rad2deg(u):.2g}°: a lost decimal, or another unit"
        if u > _VAGUE
        else f"inclination in {record} is probably not {np.rad2deg(angle):.3g}°: a lost decimal point, or the angle to "
        "the plate in place of that to the motion"
    )
    return stated(name, law, text, level, cause=cause if level else "", file=record, setting="values.inclination")


def scale_known(displacement: xr.Dataset | None, record: str) -> Check:
    """Hold the uncertainty of a calibrated length against what a calibration is for."""
    name, law = "uncertainty of the scale", "a calibration tells lengths far better than the eye does"
    if displacement is None or not (relative := float(displacement.attrs.get("u_systematic_relative", 0.0))):
        return not_made(name, law, "a displacement, and the uncertainty of its scale")
    text = f"{record}: lengths are known by {100 * relative:.2g} %"
    level: Level | None = "doubtful" if relative > _UNKNOWN else None
    cause = f"u of the scale, or of the inclination, in {record} was typed in another unit or with a lost decimal"
    return stated(name, law, text, level, cause=cause if level else "", file=record, setting="values.scale")


def timing(trace: Trace) -> Check:
    """Hold the noise of readings in motion against that at rest: uneven times make positions scatter with speed."""
    name, law = ("times of the readings", "noise is one at rest and in motion where readings come at their times")
    x = trace.reading
    scatter = np.abs(np.diff(x, 4)) / np.sqrt(70.0)
    moves = np.abs(x[4:] - x[:-4]) / 4  # from reading to reading
    moving = moves > 0.5 * float(np.nanquantile(moves, 0.9))
    if moving.sum() < _QUIET or not np.isfinite(scatter[:_QUIET]).any():
        return not_made(name, law, f"{_QUIET} readings at rest and in motion")
    rest, fast = (1.4826 * float(np.nanmedian(part)) for part in (scatter[:_QUIET], scatter[moving]))
    late = fast / float(np.median(moves[moving]))
    interval = float(np.median(np.diff(trace.time)))
    text = f"{trace.name}: readings scatter by {quantity(rest, 'm')} at rest and by {quantity(fast, 'm')} in motion"
    is_late = fast > _LOUDER * max(rest, 0.3 * trace.resolution) and late > _LATE
    cause = (
        f"the times of the readings jitter by about {quantity(late * interval, 's')}: they were polled by a program, "
        "or the clock of the sampling is not that of the sensor"
    )
    level: Level | None = "doubtful" if is_late else None
    return stated(name, law, text, level, cause=cause if is_late else "", file=trace.name)


def held_readings(trace: Trace) -> Check:
    """Look for a body that stands still on one reading while it should move."""
    title, law = "clipped or held readings", "a moving body gives no equal readings in a row"
    x, step = trace.reading, trace.resolution
    moves = np.abs(np.diff(x))
    usual = float(np.nanquantile(moves, 0.98))
    longest, start = _longest_run(np.nan_to_num(moves, nan=np.inf) <= 0.5 * step)
    around = np.abs(x[max(start - _BESIDE, 0) : start + longest + 1 + _BESIDE] - x[start])
    away = float(np.nanmax(around)) if np.isfinite(around).any() else 0.0
    is_moving = usual > 3 * step and away > max(_BESIDE * _SLOW * usual, 3 * step + _IN_NOISE * trace.noise)
    if longest < FLAT or not (is_moving or longest >= x.size - 2):
        return stated(title, law, f"{trace.name}: no clipped or held readings", None, file=trace.name)
    is_tail = start + longest >= x.size - 2
    until = "until the end" if is_tail else "in the middle of motion"
    text = f"{trace.name}: {longest + 1} equal readings in a row from {trace.at(start)}, {until} (clipped or held)"
    cause = _HELD
    if longest >= x.size - 2:
        cause = WRONG_CHANNEL
    elif is_tail and x[start] == 0.0:
        cause = "the end of the file is filled with zeros: the recording or its copy broke off there"
    return stated(title, law, text, "impossible", file=trace.name, cause=cause)


def repeated_rows(trace: Trace) -> Check:
    """Look for a stretch of readings that comes twice, digit by digit."""
    title, law = "rows that come twice", "noise does not repeat itself"
    if trace.reading.size < 3 * _BLOCK or trace.resolution == 0.0:
        return not_made(title, law, f"{3 * _BLOCK} readings that differ")
    keys, places = _stretches(trace, trace.resolution)
    _, first, inverse = np.unique(keys[places], return_index=True, return_inverse=True)
    again = places[first[inverse]]
    twice = np.flatnonzero((again != places) & (np.abs(places - again) >= _BLOCK))
    if not twice.size:
        return stated(title, law, f"{trace.name}: no stretch of readings comes twice", None, file=trace.name)
    second, original = int(places[twice[0]]), int(again[twice[0]])
    rows = int(twice.size) + _BLOCK - 1
    text = (
        f"{trace.name}: {rows} readings from {trace.at(second)} come twice, digit by digit those from "
        f"{trace.at(original)}"
    )
    return stated(
        title,
        law,
        text,
        "impossible",
        file=trace.name,
        cause="rows were doubled, or two copies pasted together, when the file was made or edited",
    )


def _stretches(trace: Trace, step: float, *, from_any_zero: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return a digest of every stretch of readings, and where those are whose readings differ.

    The digest is a polynomial in a random odd number modulo 2^64, put together from those of
    stretches of half the length; from any zero it is one of the steps between readings, which
    another zero does not change.
    """
    count = np.round(np.nan_to_num(trace.reading) / step).astype(np.int64)
    count = np.diff(count) if from_any_zero else count
    keys, length, factor = count.astype(np.uint64), 1, _MIXING
    for times in (2, 2, 2, 2, 3):
        whole = keys[: keys.size - (times - 1) * length]
        for part in range(1, times):
            whole = whole * factor + keys[part * length :][: whole.size]
        keys, length, factor = whole, times * length, factor**times
    changes = np.concatenate([[0], np.cumsum(np.diff(count) != 0)])
    is_lively = changes[_BLOCK - 1 :] - changes[: keys.size] >= _LIVELY
    return keys, np.flatnonzero(is_lively)


def shared_rows(traces: Sequence[Trace]) -> Check:
    """Look for a stretch of readings that two records share, digit by digit.

    Files with the same bytes are left to the check of the session.
    """
    title, law = "readings of another record", "no two records have the same noise"
    steps = [t.resolution for t in traces if t.reading.size >= 3 * _BLOCK and t.resolution > 0.0]
    if len(steps) < 2:
        return not_made(title, law, "two records with readings that differ")
    known = [t for t in traces if t.reading.size >= 3 * _BLOCK and t.resolution > 0.0]
    found = [_stretches(t, min(steps), from_any_zero=True) for t in known]
    alive = [keys[places] for keys, places in found]
    for (i, first), (j, later) in combinations(enumerate(known), 2):
        if _is_same_file(first, later):
            continue
        longest, start = _longest_run(np.isin(alive[j], alive[i]))
        if longest < _LONG:
            continue
        at = int(found[j][1][start])
        original = int(found[i][1][int(np.argmax(alive[i] == alive[j][start]))])
        rows, begin = longest + _BLOCK, later.at(at)
        text = f"{later.name}: {rows} readings in a row from {begin} are those of {first.name}, digit by digit"
        if abs(float(later.reading[at] - first.reading[original])) > 0.5 * min(steps):
            text += " but for their zero"
        own = rows / min(first.reading.size, later.reading.size)
        is_copy = own > _WHOLE
        if not is_copy and (converted := _copied([first, later])) and converted[2] > own + _MORE:
            return _of_copy(title, law, converted)
        cause = "a copy was taken for a repeat" if is_copy else "two recordings were pasted together"
        return stated(title, law, text, "doubtful" if is_copy else "impossible", file=later.name, cause=cause)
    if (copy := _copied(known)) is not None:
        return _of_copy(title, law, copy)
    return stated(title, law, f"{len(known)} records share no stretch of readings", None)


def _of_copy(title: str, law: str, copy: tuple[Trace, Trace, float]) -> Check:
    """Say which record is a copy of another that was written in another way."""
    first, later, share = copy
    text = (
        f"{later.name}: its noise is that of {first.name} by {share:.0%}, reading by reading, with other digits, "
        "another zero or another scale"
    )
    cause = "a copy was taken for a repeat, rounded or converted by another program"
    return stated(title, law, text, "doubtful", file=later.name, cause=cause)


def _is_same_file(first: Trace, later: Trace) -> bool:
    return first.header == later.header and np.array_equal(first.reading, later.reading, equal_nan=True)


def _copied(traces: Sequence[Trace]) -> tuple[Trace, Trace, float] | None:
    """Find two records with one noise: rounded, with another zero or scale, beginning earlier or later."""
    # Where the display is coarser than the noise, its steps follow the motion, which repeats share.
    fine = [t for t in traces if t.noise > 0.5 * t.resolution]
    size = 2 ** (max((t.reading.size for t in fine), default=1) * 2 - 1).bit_length()
    waves = [np.fft.rfft(_noise_of(trace), size) for trace in fine]
    for (i, first), (j, later) in combinations(enumerate(fine), 2):
        if _is_same_file(first, later):
            continue
        share = float(np.fft.irfft(waves[i] * waves[j].conj(), size).max())
        if share > _SAME_NOISE:
            return first, later, share
    return None


def _noise_of(trace: Trace) -> np.ndarray:
    """Return fourth differences of norm 1: noise, for what moves is smooth, with contacts and spikes cut."""
    bend = np.nan_to_num(np.diff(trace.reading, 4))
    limit = _BEYOND * max(float(np.median(np.abs(bend))) / 0.6745, 1e-300)
    bend = np.clip(bend, -limit, limit)
    return np.asarray(bend / max(float(np.linalg.norm(bend)), 1e-300))


def jumps(trace: Trace) -> Check:
    """Look for steps between two readings that no speed of the body explains."""
    title, law = "jumps and spikes", "a body has inertia: it moves no further than its speed allows"
    known = np.flatnonzero(np.isfinite(trace.reading))
    x = trace.reading[known]
    steps = np.diff(x)
    # of three steps in a row the middle one: a spike makes two of them, against each other
    low, high = np.minimum(steps[:-2], steps[1:-1]), np.maximum(steps[:-2], steps[1:-1])
    usual = float(np.quantile(np.abs(np.maximum(low, np.minimum(high, steps[2:]))), 0.995))
    limit = max(_FASTER * usual, _LEAST_JUMP * trace.travel) + _IN_NOISE * trace.noise + 2 * trace.resolution
    large = np.flatnonzero((np.abs(steps) > limit) & (np.diff(known) == 1))
    spikes, levels = _spikes_and_levels(x, large, limit)
    if levels:
        worst = max(levels, key=lambda i: abs(float(steps[i])))
        text = (
            f"{trace.name}: the readings jump by {quantity(float(steps[worst]), 'm')} at "
            f"{trace.at(int(known[worst + 1]))}, {quantity(usual, 'm')} between two readings is usual"
        )
        cause = (
            "readings were lost there and the rest numbered anew, two recordings were pasted together, or the "
            "sensor was moved"
        )
        return stated(title, law, text, "impossible", file=trace.name, cause=cause)
    if spikes:
        worst = max(spikes, key=lambda i: abs(float(steps[i])))
        more = f"{len(spikes)} spikes, the largest" if len(spikes) > 1 else "one spike"
        text = (
            f"{trace.name}: {more} of {quantity(abs(float(steps[worst])), 'm')} at "
            f"{trace.at(int(known[worst + 1]))}, left out"
        )
        many = len(spikes) > _MANY_SPIKES * x.size
        cause = "a disturbance of the sensor, such as a flash of light or a speck of dust"
        gaps = np.diff(trace.time[known[spikes]])
        period = float(np.median(gaps)) if gaps.size > 2 else np.inf
        if (np.abs(gaps / period - np.round(gaps / period)) < _REGULAR).all() and np.isfinite(period):
            text += f"; they come each {quantity(period, 's')}"
            cause = "what is switched so often, such as a dimmer or a converter at the mains, disturbs the sensor"
        return stated(title, law, text, "doubtful" if many else "note", file=trace.name, cause=cause)
    return stated(title, law, f"{trace.name}: no jump and no spike", None, file=trace.name)


def _spikes_and_levels(x: np.ndarray, large: np.ndarray, limit: float) -> tuple[list[int], list[int]]:
    """Part large steps into those that are taken back within a few readings, and those that stay."""
    spikes, levels, place = [], [], 0
    while place < large.size:
        i = int(large[place])
        back = [int(j) for j in large[place + 1 :] if j <= i + _RETURN]
        end = back[-1] + 1 if back else i + 1
        if back and abs(float(x[min(end, x.size - 1)] - x[i])) < limit:
            spikes.append(i)
            place += len(back) + 1
        elif i == 0 or i >= x.size - 2:
            spikes.append(i)
            place += 1
        else:
            levels.append(i)
            place += 1
    return spikes, levels


def wave(trace: Trace) -> Check:
    """Look whether all that is seen is one sine."""
    title, law = "shape of the record", "a drop is no sine"
    known = np.isfinite(trace.reading)
    t, x = trace.time[known], trace.reading[known]
    spread = float(np.var(x))
    power = np.abs(np.fft.rfft(x - x.mean()))
    if spread == 0.0 or power.size < 3:
        return not_made(title, law, "readings that differ")
    strongest = 1 + int(np.argmax(power[1:]))
    lines = power[1:] ** 2
    is_line = lines[max(strongest - 2, 0) : strongest + 1].sum() > _LINE * lines.sum()
    peak = strongest / (x.size * float(np.median(np.diff(t))))
    best, at = 0.0, peak
    for f in np.linspace(0.6 * peak, 1.4 * peak, 33) if is_line else ():
        basis = np.stack([np.ones_like(t), np.cos(2 * pi * f * t), np.sin(2 * pi * f * t)], axis=1)
        fit = basis @ np.linalg.lstsq(basis, x, rcond=None)[0]
        explained = 1 - float(np.var(x - fit)) / spread
        if explained > best:
            best, at = explained, float(f)
    n_periods = at * float(t[-1] - t[0])
    if best > _SINE and n_periods > 1.5:
        text = f"{trace.name}: {best:.0%} of what is seen is a sine of {at:.3g} Hz, no fall and no bounces"
        return stated(title, law, text, "impossible", file=trace.name, cause=WRONG_CHANNEL)
    return stated(title, law, f"{trace.name}: not a sine", None, file=trace.name)


def beginning(trace: Trace, gravity: float) -> Check:
    """Hold the first readings against a body at rest."""
    title, law = "beginning of the record", "before its release the body is at rest"
    known = np.flatnonzero(np.isfinite(trace.reading))[:_QUIET]
    if known.size < _QUIET:
        return not_made(title, law, f"{_QUIET} readings")
    t = trace.time[known] - trace.time[known[0]]
    x = trace.reading[known]
    keep = np.abs(x - np.median(x)) <= max(0.25 * trace.travel, 20 * trace.noise)
    t, x = t[keep], x[keep]
    span = float(t[-1])
    noise = max(trace.noise, 0.3 * trace.resolution, 1e-12)
    if t.size < _QUIET // 2 or span == 0.0:
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
    if not is_sure or part < _LIMITS[0] or drift < 10 * noise:
        return stated(title, law, f"{trace.name}: at rest in the beginning", None, file=trace.name)
    text = (
        f"{trace.name}: the readings drift by {quantity(slope, 'm/s')} before the release, "
        f"{quantity(drift, 'm')} over the record"
    )
    level: Level = "impossible" if part > _LIMITS[2] else "doubtful" if part > _LIMITS[1] else "note"
    cause = "drift of the sensor or of what holds it: let it warm up, or fasten it"
    return stated(title, law, text, level, file=trace.name, cause=cause)


def resolution(trace: Trace) -> Check:
    """Hold the display's step against the travel."""
    title, law = "resolution of the readings", "a record resolves what is measured in it"
    step, travel = trace.resolution, trace.travel
    if step == 0.0 or travel == 0.0:
        return not_made(title, law, "readings that differ")
    text = f"{trace.name}: a resolution of {quantity(step, 'm')} for a travel of {quantity(travel, 'm')}"
    level: Level | None = "doubtful" if step > _TOO_COARSE * travel else "note" if step > _COARSE * travel else None
    cause = "the display shows too few digits: set more decimals in the controller"
    return stated(title, law, text, level, file=trace.name, cause=cause if level else "")


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
    level: Level = "note" if left < _HUM * trace.travel else "doubtful"
    cause = "mains hum: ground the sensor, or average over one period"
    return stated(title, law, text, level, file=trace.name, cause=cause)


def _longest_run(flags: np.ndarray) -> tuple[int, int]:
    """Return length and start of the longest run of true values."""
    if not flags.any():
        return 0, 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    starts, ends = edges[::2], edges[1::2]
    best = int(np.argmax(ends - starts))
    return int(ends[best] - starts[best]), int(starts[best])

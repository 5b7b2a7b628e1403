"""Properties of a record of displacement: continuity, range, noise, identity of its file, and its calibration.

A body has inertia: between two readings it moves no further than its speed allows, it does not stand still in
mid-flight, and noise never repeats itself. A reading that breaks this comes from the sensor, the cable or the file.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import inf, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy import special

from labpipe.arrays import Flags, Floats
from labpipe.errors import IN_MOTION, MARKER
from labpipe.judging import DOUBTFUL, IMPOSSIBLE, LIKELY, Check, Level, doubtful_among, not_made
from labpipe.report import quantity
from labpipe.signals import Hum, deviation, estimate_noise, quantisation_step
from labpipe.workflow.context import Context
from pipelines.experiments.shared.exclusions import EXCLUDED
from pipelines.experiments.shared.judgements import Title, Titles, day_known, failed_steps

FLAT = 6
"""Equal readings in a row that a moving body does not give."""
MANY = 0.01
"""Part of the readings, left out as outliers, that is more than an occasional disturbance."""
_WINDOW = 24  # readings that do not repeat by chance, and in which a lost or doubled one is looked for

SINGLE_ROWS, BEGINNING = "lost or doubled rows", "beginning of the record"
_WRONG_CHANNEL = "the wrong channel or file was recorded, or the sensor did not see the body"
_HELD = (
    "the sensor was out of its range (clipped) or held its last value: the impact is not measured there; "
    "move the sensor or choose a larger range"
)
_OUT_OF_RANGE = (
    "the sensor was out of its range, and the controller wrote that in place of a reading: the impact "
    "is not measured there; move the sensor or choose a larger range"
)
CAUSES = {
    MARKER: _OUT_OF_RANGE,
    IN_MOTION: "the readings do not begin at rest: the record begins in mid-motion, its rows are in reverse order, the "
    "sensor drifts or hums, or the wrong channel was recorded",
}
"""Probable mistake by the reason of the error that a step ends in."""

OF_LASER: Titles = {
    "continuity of the readings": Title(
        "A recording holds every reading once, in order and within the range of the sensor.",
        (
            "readings out of range", "clipped or held readings", "jumps and spikes", "rows that come twice",
            BEGINNING, "end of the record", "readings", SINGLE_ROWS,
        ),
    ),
    "noise": Title(
        "Noise is white, constant, without mains frequency, and not coarser than the display's resolution.",
        ("mains hum", "resolution of the readings", "change of the noise"),
    ),
    "files": Title("No two recordings contain the same noise.", ("readings of another record",)),
}  # fmt: skip
"""Checks of the readings of a displacement sensor."""


@dataclass(frozen=True)
class Trace:
    """The readings of one record.

    ``name`` is its file, for messages; ``time`` [s] and ``reading`` [m] (time,) are NaN where there is no valid
    reading; ``outliers`` holds first and last index and the largest deviation [m] of each run of readings that was left
    out.
    """

    name: str
    time: Floats
    reading: Floats
    outliers: tuple[tuple[int, int, float], ...] = ()
    is_excluded: Flags | bool = False

    @classmethod
    def of(cls, name: str, readings: xr.Dataset, output: str) -> "Trace | None":
        """Take one output; None where it is not there, is no length, or holds fewer than sixty readings."""
        if output not in readings or readings[output].attrs.get("units") != "m":
            return None
        x = np.array(readings[output].values, float)
        state = output.replace("out", "status")
        is_excluded = EXCLUDED in readings and readings[EXCLUDED].values.astype(bool)
        if state in readings:
            x[readings[state].values != 0] = np.nan
        if np.isfinite(x).sum() < 10 * FLAT:
            return None
        left_out = json.loads(readings.attrs.get("outliers", "{}")).get(output, [])
        runs = tuple((int(first), int(last), float(by)) for first, last, by in left_out)
        return cls(name, readings["time"].values, x, runs, is_excluded)

    @cached_property
    def travel(self) -> float:
        """Range of the readings without their extremes [m]."""
        low, high = np.nanquantile(self.reading, [0.005, 0.995])
        return float(high - low)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a reading, at least that of rounding [m]."""
        return estimate_noise(self.reading[np.isfinite(self.reading)]).sigma

    @cached_property
    def resolution(self) -> float:
        """Smallest difference between two readings [m]."""
        return quantisation_step(self.reading[np.isfinite(self.reading)])

    @property
    def limit(self) -> float:
        """Deviation [m] that noise reaches in one record of thousands."""
        return doubtful_among(self.reading.size) * self.noise

    def at(self, index: int) -> str:
        """Write the time of a reading."""
        return quantity(float(self.time[index]), "s")

    def seen(self, name: str, text: str, level: Level | None = None, cause: str = "") -> Check:
        """Return a check of this record."""
        return Check(name, f"{self.name}: {text}", level, file=self.name, cause=cause)


def of_recordings(
    read: Mapping[str, xr.Dataset | None],
    moved: Mapping[str, xr.Dataset | None],
    bounced: Mapping[str, xr.Dataset | None],
    settings: Any,
    context: Context,
    failed: Mapping[str, str],
) -> tuple[list[Check], list[Check]]:
    """Evaluate the recordings of a laser: their readings, and in a second list the failed steps and the record.

    ``read``, ``moved`` and ``bounced`` are readings, displacement and bounces by recording; ``failed`` are the causes
    of failed steps.
    """
    record, traces, found = settings.calibration, list[Trace](), list[Check]()
    for name, one in read.items():
        if one is None:
            continue
        if (trace := Trace.of(name, one, settings.sensor.output)) is None:
            found.append(not_made("readings", "sixty valid readings of a length"))
        else:
            traces.append(trace)
            results = [result for result in (moved.get(name), bounced.get(name)) if result is not None]
            line = Hum.of_text(results[-1].attrs.get("hum")) if results else None
            found += of_readings(trace, settings.model.gravity.value, line)
    others = [placed(check, record, check.file) for check in failed_steps(context, failed)]
    return [*found, shared_rows(traces)], [*others, *of_record(moved, record)]


def of_readings(
    trace: Trace, gravity: float, hum: Hum | None = None, *, quiet: int = 200, drift: tuple[float, float] = (0.02, 0.2)
) -> list[Check]:
    """Evaluate continuity and noise of a record; ``hum`` of the mains was subtracted from it.

    The first ``quiet`` readings should be at rest; their ``drift``, as parts of the travel over the whole record, is
    doubtful, impossible. The noise of five parts of a record is compared.
    """
    held = held_readings(trace)
    found = [unread(trace), held, repeated_rows(trace), resolution(trace)]
    name, parts = "change of the noise", [x[np.isfinite(x)] for x in np.array_split(trace.reading, 5)]
    if min(part.size for part in parts) < quiet:
        found.append(not_made(name, f"{5 * quiet} readings"))
    else:
        sizes = np.maximum([estimate_noise(part).sigma for part in parts], trace.resolution / sqrt(12.0)).tolist()
        least, most = min(sizes), max(sizes)
        low, high = (f"{quantity(size, 'm')} in part {sizes.index(size) + 1}" for size in (least, most))
        cause = "light, surface, gain or averaging of the sensor changed while it recorded"
        level: Level | None = "doubtful" if most > 10.0 * least else "note" if most > 3.0 * least else None
        found.append(trace.seen(name, f"noise of {low} of 5, {high}", level, cause))
    if held.level is None:
        found += [_jumps(trace), _single_rows(trace)]
    if hum is None:
        return [*found, _beginning(trace, gravity, quiet, drift)]
    left = float(np.sqrt(np.mean(np.sum(hum.modes(trace.time) ** 2, axis=1))))
    text = f"hum of {quantity(hum.amplitude, 'm')} at {hum.frequency:.4g} Hz, subtracted to "
    text += f"± {quantity(left, 'm')}, which is in the uncertainties"
    level = "note" if left < 0.01 * trace.travel else "doubtful"
    cause = "mains hum: ground the sensor, or average over one period"
    return [*found, trace.seen("mains hum", text, level, cause)]


def unread(trace: Trace) -> Check:
    """Look for readings that the sensor gave as invalid."""
    lost = ~np.isfinite(trace.reading)
    for first, last, _ in trace.outliers:
        lost[first : last + 1] = False
    lost &= ~np.asarray(trace.is_excluded)
    longest, start = longest_run(lost)
    name = "readings out of range"
    if not longest:
        return trace.seen(name, "every reading is valid")
    text = f"{int(lost.sum())} readings are out of range or invalid, {longest} of them in a row from {trace.at(start)}"
    return trace.seen(name, text, "doubtful" if longest >= FLAT else "note", _OUT_OF_RANGE)


def held_readings(trace: Trace) -> Check:
    """Look for a body that stays on one reading while it should move."""
    name, x, (longest, start, is_inside) = "clipped or held readings", trace.reading, _held(trace)
    if not longest:
        return trace.seen(name, "no clipped or held readings")
    is_constant, is_tail = longest >= x.size - 2, start + longest >= x.size - 2
    until = "until the end" if is_tail else "in the middle of motion"
    text = f"{longest + 1} equal readings in a row from {trace.at(start)}, {until} (clipped or held)"
    if not is_tail and is_inside:
        cause = "the sensor, its cable or the controller held its last value there; what passed meanwhile is not known"
        return trace.seen(name, f"{text}; left out", "doubtful", cause)
    cause = _WRONG_CHANNEL if is_constant else _HELD
    if is_tail and not is_constant and x[start] == 0.0:
        cause = "the end of the file is filled with zeros: the recording or its copy broke off there"
    return trace.seen(name, text, "impossible", cause)


def _held(trace: Trace) -> tuple[int, int, bool]:
    """Return length less one and start of the longest run of equal readings within a motion, 0 for none.

    Return too whether it is far from both ends of the range, where a sensor clips or an impact turns the body.
    """
    x, step = trace.reading, trace.resolution
    moves = np.abs(np.diff(x))
    usual = float(np.nanquantile(moves, 0.98))
    longest, start = longest_run(np.nan_to_num(moves, nan=np.inf) <= 0.5 * step)
    around = np.abs(x[max(start - 4, 0) : start + longest + 5] - x[start])
    away = float(np.nanmax(around)) if np.isfinite(around).any() else 0.0
    is_moving = usual > 3 * step and away > max(0.2 * usual, 3 * step + trace.limit)
    if longest < FLAT or not (is_moving or longest >= x.size - 2):
        return 0, 0, False
    share = (x[start] - np.nanmin(x)) / (np.nanmax(x) - np.nanmin(x) or 1.0)
    return longest, start, bool(0.1 < share < 0.9)


def without_held(readings: xr.Dataset, output: str) -> xr.Dataset:
    """Leave out readings that were held in mid-motion, where the rest of a record can be evaluated without them."""
    trace = Trace.of("", readings, output)
    longest, start, is_inside = (0, 0, False) if trace is None else _held(trace)
    if trace is None or start + longest >= trace.reading.size - 2 or not is_inside:
        return readings
    is_held = np.zeros(trace.reading.size, bool)
    is_held[start + 1 : start + longest + 1] = True  # the first was read
    return readings.assign({output: readings[output].where(~is_held)})


def longest_run(flags: np.ndarray) -> tuple[int, int]:
    """Return length and start of the longest run of true values."""
    if not flags.any():
        return 0, 0
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    starts, ends = edges[::2], edges[1::2]
    best = int(np.argmax(ends - starts))
    return int(ends[best] - starts[best]), int(starts[best])


def break_in(values: Floats, noise: float) -> tuple[int, float] | None:
    """Find the largest interruption of a motion that is read at even intervals.

    An impact bends a motion: its steps lie between those before and after. Where readings were lost, or sensor or
    camera were moved, one step exceeds both. Returned are the index of the reading after it and by how much it does;
    None where that is within the noise, of standard deviation ``noise``, and what is usual in this record.
    """
    steps = np.diff(values)
    if np.isfinite(steps).sum() < 3:
        return None
    before, after = steps[1:-1] - steps[:-2], steps[1:-1] - steps[2:]
    beyond = np.nan_to_num(np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0))
    at = int(np.argmax(beyond))
    usual = max(3.0 * float(np.quantile(beyond, 0.98)), 0.5 * float(np.nanquantile(np.abs(steps), 0.98)))
    is_break = beyond[at] > usual + doubtful_among(beyond.size) * sqrt(6.0) * noise  # of a second difference
    return (at + 2, float(np.copysign(beyond[at], before[at]))) if is_break else None


def step_in(values: Floats, since: int = 0) -> tuple[int, float, float] | None:
    """Find the largest step of a quantity that else changes smoothly, and is read at even intervals.

    A parabola with a step in its middle is fitted to windows of 16 readings and more; behind ``since``, where the
    quantity began to settle, a window spans half of the time that has passed at most. Returned are the index of the
    reading after it, the step, and its ratio to the noise or to the scatter of all steps of such windows, the larger of
    both; None where the record is too short.
    """
    found, noise, half = list[tuple[int, float, float]](), estimate_noise(values).sigma, 8
    while values.size - since >= 12 * half:
        place = np.arange(2 * half) - half + 0.5
        design = np.stack([np.ones_like(place), place, place**2, np.sign(place) / 2.0])
        weights = np.linalg.pinv(design)[:, 3]
        first = max(since + 4 * half, half)
        steps = np.convolve(values, weights[::-1], "valid")[first - half :]
        at = int(np.argmax(np.abs(steps)))
        u = max(deviation(steps - np.median(steps)), noise * float(np.linalg.norm(weights)))
        found.append((first + at, float(steps[at]), abs(float(steps[at])) / (u or inf)))
        half *= 2
    return max(found, key=lambda one: one[2], default=None)


def _jumps(trace: Trace) -> Check:
    """Look for steps between two readings that no speed of the body explains."""
    name, broken = "jumps and spikes", break_in(trace.reading, trace.noise)
    if broken is not None:
        text = f"the readings jump by {quantity(broken[1], 'm')} at {trace.at(broken[0])}"
        cause = "readings were lost there and the rest numbered anew, two recordings were pasted together, or the "
        cause += "sensor was moved or disturbed"
        return trace.seen(name, text, "impossible", cause)
    if not trace.outliers:
        return trace.seen(name, "no jump and no spike")
    first, _, size = max(trace.outliers, key=lambda run: run[2])
    numbers = ", ".join(f"{a + 1}" if a == b else f"{a + 1}-{b + 1}" for a, b, _ in trace.outliers[:5])
    text = (
        f"{len(trace.outliers)} spikes left out (readings {numbers}{', …' * (len(trace.outliers) > 5)}), the largest "
        f"of {quantity(size, 'm')} at {trace.at(first)}"
    )
    count = sum(end - begin + 1 for begin, end, _ in trace.outliers)
    level: Level = "doubtful" if count > MANY * trace.reading.size else "note"
    return trace.seen(name, text, level, "a disturbance of the sensor, such as a flash of light or a speck of dust")


def _single_rows(trace: Trace) -> Check:
    """Look for single lost or doubled rows: the motion goes on as if it were one reading later or earlier."""
    # a parabola with a jump in the middle of a window: one step up of a lost row, down of a doubled one
    if trace.reading.size < 2 * _WINDOW:
        return not_made(SINGLE_ROWS, f"{2 * _WINDOW} readings")
    place = np.arange(_WINDOW) - 0.5 * (_WINDOW - 1)
    design = np.stack([np.ones_like(place), place, place**2, np.sign(place) / 2.0])
    inverse = np.linalg.pinv(design)
    windows = np.lib.stride_tricks.sliding_window_view(trace.reading, _WINDOW)
    fitted = windows @ inverse
    left, freedom = np.sum((windows - fitted @ design) ** 2, axis=1), _WINDOW - len(design)
    is_smooth = left < special.chdtri(freedom, LIKELY) * trace.noise**2
    step, jump = fitted[:, 1], fitted[:, 3]
    # a small bounce turns within a window too, but at steps that hardly exceed the noise
    is_large = np.minimum(np.abs(jump), np.abs(step)) > 2 * DOUBTFUL * trace.noise * np.linalg.norm(inverse[:, 3])
    seen = np.flatnonzero(is_smooth & is_large & (np.abs(np.abs(jump / step) - 1.0) < 0.5))
    runs = np.split(seen, np.flatnonzero(np.diff(seen) > _WINDOW) + 1) if seen.size else []
    # of neighbouring windows the one with the largest jump
    found = [int(run[np.argmax(np.abs(jump[run]))]) for run in runs]
    if not found:
        return trace.seen(SINGLE_ROWS, "no single row is lost or doubled")
    lost = sum(bool(jump[i] * step[i] > 0.0) for i in found)
    text = f"single rows: {lost} lost, {len(found) - lost} doubled, the first at {trace.at(found[0] + _WINDOW // 2)}"
    cause = "rows were lost or doubled when the file was written or copied, and the others numbered anew"
    return trace.seen(SINGLE_ROWS, text, "doubtful", cause)


def repeated_rows(trace: Trace) -> Check:
    """Look for a stretch of readings that comes twice, digit by digit."""
    name, block = "rows that come twice", _WINDOW if trace.noise > trace.resolution else 2 * _WINDOW
    if trace.reading.size < 3 * block or trace.resolution == 0.0:
        return not_made(name, f"{3 * block} readings that differ")
    count = np.round(np.nan_to_num(trace.reading) / trace.resolution).astype(np.int64)
    windows = np.lib.stride_tricks.sliding_window_view(count, block)
    places = np.flatnonzero(np.convolve(np.diff(count) != 0, np.ones(block - 1), "valid") >= block / 2)
    digests = (windows @ np.random.default_rng(0).integers(1, 2**62, block))[places]
    _, first, inverse = np.unique(digests, return_index=True, return_inverse=True)
    original = places[first[inverse]]
    twice = np.flatnonzero(places - original >= block)
    if not twice.size:
        return trace.seen(name, "no stretch of readings comes twice")
    second, begin = trace.at(int(places[twice[0]])), trace.at(int(original[twice[0]]))
    text = f"{twice.size + block - 1} readings from {second} come twice, digit by digit those from {begin}"
    cause = "rows were doubled, or two copies pasted together, when the file was made or edited"
    return trace.seen(name, text, "impossible", cause)


def shared_rows(traces: Sequence[Trace]) -> Check:
    """Look for two records of equal readings, digit by digit but for their zero and the end of the longer one."""
    name = "readings of another record"
    known = [t for t in traces if t.reading.size >= 3 * _WINDOW and t.resolution > 0.0]
    if len(known) < 2:
        return not_made(name, "two records with readings that differ")
    for first, later in combinations(known, 2):
        n, half = min(first.reading.size, later.reading.size), 0.5 * max(first.resolution, later.resolution)
        apart = np.abs(np.diff(first.reading[:n]) - np.diff(later.reading[:n]))
        if (apart[np.isfinite(apart)] < half).all():
            text = f"{n} readings in a row are those of {first.name}, digit by digit"
            return later.seen(name, text, "doubtful", "a copy was taken for a repeat")
    return Check(name, f"{'the two' if len(known) == 2 else f'all {len(known)}'} recordings are different", None)


def resolution(trace: Trace) -> Check:
    """Compare the display's step with the travel."""
    name, step, travel = "resolution of the readings", trace.resolution, trace.travel
    if step == 0.0 or travel == 0.0:
        return not_made(name, "readings that differ")
    text = f"a resolution of {quantity(step, 'm')} for a travel of {quantity(travel, 'm')}"
    level: Level | None = "doubtful" if step > 0.03 * travel else "note" if step > 5e-3 * travel else None
    cause = "the display shows too few digits: set more decimals in the controller"
    if travel < 2.0 * trace.limit:
        cause = f"nothing moves in this record: it ends before the impact or begins after it, or {_WRONG_CHANNEL}"
    return trace.seen(name, text, level, cause)


def _beginning(trace: Trace, gravity: float, quiet: int, parts: tuple[float, float]) -> Check:
    """Compare the first readings with a body at rest: neither in free fall nor drifting."""
    name, known = BEGINNING, np.flatnonzero(np.isfinite(trace.reading))[:quiet]
    t, x = trace.time[known] - trace.time[known[0]], trace.reading[known]
    keep = np.abs(x - np.median(x)) <= max(0.25 * trace.travel, 20 * trace.noise)
    if keep.sum() < quiet // 2:
        return not_made(name, f"{quiet} quiet readings")
    t, x = t[keep], x[keep]
    span = float(t[-1])
    bend, slope = 2 * float(np.polyfit(t, x, 2)[0]), float(np.polyfit(t, x, 1)[0])
    u_bend, u_slope = (trace.noise * sqrt(of / t.size) / span**k for of, k in ((720.0, 2), (12.0, 1)))
    if 0.4 * gravity < abs(bend) < 2.5 * gravity and abs(bend) > IMPOSSIBLE * u_bend:
        text = f"the first {quantity(span, 's')} are curved by {quantity(abs(bend), 'm/s2')}: a fall"
        cause = "the record begins in mid-fall: the body was released before the trigger; record from earlier on. Its "
        return trace.seen(name, text, "impossible", f"{cause}release and height are not measured")
    drift = abs(slope) * float(trace.time[-1] - trace.time[0])
    if not (abs(slope) > max(DOUBTFUL * u_slope, abs(bend) * span) and drift > trace.limit):
        return trace.seen(name, "at rest in the beginning")
    text = f"the readings drift by {quantity(slope, 'm/s')} before the release, {quantity(drift, 'm')} over the record"
    few, many = (drift > part * trace.travel for part in parts)
    level: Level = "impossible" if many else "doubtful" if few else "note"
    return trace.seen(name, text, level, "drift of the sensor or of its holder: let it warm up, or fasten it")


def of_record(displacements: Mapping[str, xr.Dataset | None], record: str) -> list[Check]:
    """Evaluate the calibration record of the sensor that gave the displacements of some recordings."""
    known = {name: each for name, each in displacements.items() if each is not None}
    days = [day_known(each, record, name) for name, each in known.items()] or [day_known(None, record)]
    found, first = [min(days, key=lambda check: ("doubtful", "note", None).index(check.level))], [*known.values()][:1]
    if not first or "inclination" not in first[0]:
        return [*found, not_made("line of sight", "a displacement")]
    angle, u = (float(np.rad2deg(first[0][name])) for name in ("inclination", "u_inclination"))
    text = f"{record}: inclination ({angle:.3g} ± {u:.2g})°, lengths are divided by its cosine"
    cause = f"inclination in {record} is probably not {angle:.3g}°: a lost decimal point, or the angle to the plate"
    if u > 3.0:  # even an angle estimated by eye is known better
        cause = f"u of the inclination in {record} is probably not {u:.2g}°: a lost decimal, or another unit"
    place: Level | None = "doubtful" if angle > 45.0 or u > 3.0 else None
    found.append(Check("line of sight", text, place, cause=cause, file=record, setting="values.inclination"))
    return found


def placed(failed: Check, *files: str | None) -> Check:
    """Give a step that failed the file and line that its message names, where it is one of ``files``."""
    for file in filter(None, files):
        name = re.escape(Path(file).name)  # of a record the line of a value before any other
        found = re.search(rf"{name}:(\d+): values", failed.message) or re.search(rf"{name}:(\d+)\b", failed.message)
        if found is not None and failed.is_made:
            return replace(failed, file=file, line=int(found[1]))
    return failed

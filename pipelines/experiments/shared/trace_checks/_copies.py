"""Checks of rows that come twice, in one record or in two: noise never repeats itself."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from labpipe.judging import Check, not_made, stated
from pipelines.experiments.shared.trace_checks._trace import Trace, longest_run

_BLOCK = 48  # = 2 · 2 · 2 · 2 · 3, readings that do not repeat by chance
_LIVELY = 24  # of which at least so many differ from the one before
_MIXING = np.uint64(0x9E3779B97F4A7C15)
_LONG = 200  # stretches in a row that two records share by copying alone, also where noise is below the display's step
_WHOLE = 0.8  # of the shorter record
_SAME_NOISE = 0.5  # correlation of the noise of two records, from which on one is a copy of the other
_MORE = 0.2  # of a record, by which noise is shared beyond the readings that are the same
_BEYOND = 4.0  # times its usual size, to which what is no noise is cut


def repeated_rows(trace: Trace) -> Check:
    """Look for a stretch of readings that comes twice, digit by digit."""
    title, law = "rows that come twice", "noise does not repeat itself"
    if trace.reading.size < 3 * _BLOCK or trace.resolution == 0.0:
        return not_made(title, law, f"{3 * _BLOCK} readings that differ")
    none = stated(title, law, f"{trace.name}: no stretch of readings comes twice", None, file=trace.name)
    keys, places = _stretches(trace, trace.resolution)
    if not _has_twins(keys[places]):
        return none
    _, first, inverse = np.unique(keys[places], return_index=True, return_inverse=True)
    again = places[first[inverse]]
    twice = np.flatnonzero((again != places) & (np.abs(places - again) >= _BLOCK))
    if not twice.size:
        return none
    second, original = int(places[twice[0]]), int(again[twice[0]])
    rows = int(twice.size) + _BLOCK - 1
    text = (
        f"{trace.name}: {rows} readings from {trace.at(second)} come twice, digit by digit those from "
        f"{trace.at(original)}"
    )
    cause = "rows were doubled, or two copies pasted together, when the file was made or edited"
    return stated(title, law, text, "impossible", file=trace.name, cause=cause)


def _has_twins(keys: np.ndarray) -> bool:
    in_order = np.sort(keys)
    return bool((in_order[1:] == in_order[:-1]).any())


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
    pairs = combinations(enumerate(known), 2) if _has_twins(np.concatenate(alive)) else ()
    for (i, first), (j, later) in pairs:
        if _is_same_file(first, later):
            continue
        longest, start = longest_run(np.isin(alive[j], alive[i]))
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
        f"{later.name}: its noise is that of {first.name} by {100 * share:.0f} %, reading by reading, with other "
        "digits, another zero or another scale"
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

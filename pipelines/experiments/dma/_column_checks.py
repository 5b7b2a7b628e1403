"""Checks of an export's columns: loss factor, frequencies, stress over strain, size and signs of the moduli."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import log10, pi

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Check, Level, bounded, compared, in_words, not_made, stated
from labpipe.materials import modulus_factor
from labpipe.report import quantity
from pipelines.experiments.dma._checked_sweeps import POLYMERS, Export, Sweep, factor_in_words
from pipelines.experiments.dma.settings import Dma

_ROUNDED = 2e-3
"""Relative difference of the loss factor from the ratio of moduli, from exported digits."""
_STRESS = 0.25
"""How far stress over strain may be from the modulus: instruments correct for clamps and inertia."""
_OUT = 0.5  # decades beyond its neighbours at which a reading stands alone
_MISTYPED = 1.6  # decades from which a single value is a slip, not noise
_ABOUT = 0.2  # decades within which neighbours tell by what power of ten a value is wrong
_FEW_LASTS = 5  # readings of an interval that tell how long one takes
_SAME_COUNT = 0.5  # range of the logarithm of a number of periods that is the same for all readings
_PATIENT = 30.0  # periods; instruments wait for one to twenty
_FAST, _FASTEST = 200.0, 1e3  # Hz, that few and that no instruments reach
_NAMES = {"storage_modulus": "storage modulus", "loss_modulus": "loss modulus"}


def loss_factor(export: Export) -> Check:
    name = "loss factor"
    if "loss_factor" not in export.data:
        return not_made(name, "a column of the loss factor")
    storage, loss = export.values("storage_modulus"), export.values("loss_modulus")
    # what is not positive is told by another check
    ratio = np.divide(loss, storage, out=np.zeros_like(loss), where=storage > 0)
    told = export.values("loss_factor")
    known = np.isfinite(told) & (told > 0) & (ratio > 0)
    if not known.any():
        return not_made(name, "loss factors")
    apart = np.log(told[known] / ratio[known])
    middle, file = float(np.median(apart)), export.name
    ours, theirs = float(np.median(ratio[known])), float(np.median(told[known]))
    message = f"{file}: the column says {theirs:.3g}, the moduli give {ours:.3g} (medians)"
    found = compared(name, message, theirs, _ROUNDED * theirs, theirs / np.exp(middle).item(), 0.0, file=file)
    if found.level is None or abs(middle) < 0.05:
        wrong = np.flatnonzero(np.abs(apart) > 0.1)
        if not wrong.size:
            return replace(found, level=None)
        worst = int(wrong[np.argmax(np.abs(apart[wrong]))])
        row = int(np.flatnonzero(export.good)[np.flatnonzero(known)[worst]])
        times = float(np.exp(abs(apart[worst])))
        text = f"{export.place(row)}: the loss factor and the moduli differ by a factor {factor_in_words(times)}"
        more = f"; {wrong.size} rows in all" if wrong.size > 1 else ""
        cause = f"a value of this row is wrong by a factor {factor_in_words(times)}"
        return stated(name, text + more, "impossible" if times > 2.0 else "doubtful", cause=cause, file=file)
    cause = f"one modulus, or the loss factor, has the wrong unit: a factor {factor_in_words(np.exp(middle).item())}"
    if float(np.median(np.abs(np.log(told[known] * ratio[known])))) < 0.02:
        cause = "the columns of storage and loss modulus are exchanged"
    return replace(found, cause=cause)


def whole_file(export: Export) -> Check:
    """Repeat what the reader noticed about rows and cells that are not there."""
    name = "whole file"
    missing = json.loads(str(export.data.attrs.get("cut", "[]")))
    if not missing:
        return stated(name, f"{export.name}: nothing is missing", None, file=export.name)
    more = f"; {len(missing)} such intervals" if len(missing) > 1 else ""
    line, text = missing[0]
    return stated(
        name,
        f"{export.name}: {text}{more}",
        "doubtful",
        cause="the test was stopped, or the file was cut: copy it again from the rheometer",
        file=export.name,
        line=line,
    )


def frequencies(export: Export) -> Check:
    """Hold frequencies against the other column, and against the time a reading takes."""
    name = "frequency"
    file, data = export.name, export.data
    if (lowest := float(export.values("frequency").min())) <= 0.0:
        text = f"{file}: a frequency of {lowest:.4g} Hz"
        cause = "another column stands under the name of the frequency, such as the temperature"
        return stated(name, text, "impossible", cause=cause, file=file)
    if data.attrs.get("derived", "-") == "" and "angular_frequency" in data:
        omega, hertz = export.values("angular_frequency"), export.values("frequency")
        known = (omega > 0) & (hertz > 0)
        if known.any():
            ratio = float(np.median(omega[known] / hertz[known]))
            message = f"{file}: angular frequency over frequency is {ratio:.4g}, expected 2π"
            found = compared(name, message, ratio, 0.01, 2 * pi, 0.0, file=file)
            return replace(found, cause="one column of frequency has the unit of the other (Hz, rad/s)")
    levels = np.unique(np.round(export.values("frequency"), 6))
    if data.attrs.get("derived") != "frequency" and (turned := _turned(levels)):
        message = f"{file}: frequencies of {levels[-1]:.5g} to {levels[0]:.5g} Hz are {turned[0]} times round ones"
        return stated(name, message, "doubtful", cause=turned[1], file=file)
    if levels[-1] > _FASTEST:
        message = f"{file}: frequencies go up to {levels[-1]:.5g} Hz, where no rheometer or DMA can swing a specimen"
        cause = "the column of frequency is in another unit than its heading says, such as turns per minute or mHz"
        return stated(name, message, "doubtful", cause=cause, file=file)
    if "time" not in data:
        return not_made(name, "a column of time, or both frequencies")
    if (most := max(_periods_waited(data), default=(0.0, 0)))[0] > _PATIENT:
        place = export.place(most[1]).rpartition(", point")[0] or file
        message = f"{place}: each reading takes {most[0]:.3g} periods, whatever its frequency"
        cause = "frequencies are too high for their times: turns per minute (60), mHz or rad/s (6.28) under Hz"
        return stated(name, message, "doubtful", cause=cause, file=file)
    # each table by itself: the readings of a temperature sweep wait many periods for the heat
    shortest = min(_periods(data), default=None)
    if shortest is None:
        return not_made(name, f"times of {_FEW_LASTS} readings of an interval")
    periods, place = shortest[0], export.place(shortest[1]).rpartition(", point")[0] or file
    message = f"{place}: readings take {periods:.2g} periods at most"
    cause = "frequencies are too low for their times: Hz under rad/s (a factor 6.28), or times in another unit"
    return stated(name, message, "doubtful" if periods < 0.7 else None, cause=cause, file=file)


def _periods(data: xr.Dataset) -> Iterator[tuple[float, int]]:
    """Yield how many periods nearly every reading of an interval takes at most, and its first row."""
    for _, lasts, first in _durations(data):
        yield float(np.quantile(lasts, 0.9)), first


def _periods_waited(data: xr.Dataset) -> Iterator[tuple[float, int]]:
    """Yield how many periods are waited for each reading of an interval at its lowest frequencies, and its first row.

    Nothing is yielded where a least time is waited for, whatever the frequency.
    """
    for hertz, lasts, first in _durations(data):
        slow = hertz <= 10.0 * hertz.min()
        own = lasts[slow]
        if own.size >= _FEW_LASTS and np.ptp(np.log(hertz[slow])) > 1.0 and np.ptp(np.log(own)) < _SAME_COUNT:
            yield float(np.median(own)), first


def _durations(data: xr.Dataset) -> Iterator[tuple[Floats, Floats, int]]:
    """Yield the frequencies of an interval [Hz], the periods that its readings take, and its first row."""
    keys = [key for key in ("interval", "test", "result") if key in data.variables]
    hertz = data["frequency"].values
    label = np.zeros(hertz.size, np.int64)
    for key in keys:
        label[1:] += np.cumsum(data[key].values[1:] != data[key].values[:-1])
    if not label.any():  # a table knows no intervals: a sweep ends where the frequency turns back
        way = np.sign(np.diff(hertz))
        label[1:] += np.cumsum(way * np.median(way) < 0.0)
    # a reading that begins a table has no beginning of its own
    lasts = np.diff(data["time"].values) * hertz[1:]
    is_known = (np.diff(label) == 0) & np.isfinite(lasts) & (lasts > 0)
    for interval in np.unique(label):
        own = is_known & (label[1:] == interval)
        if own.sum() >= _FEW_LASTS:
            yield hertz[1:][own], lasts[own], int(np.argmax(label == interval))


def _turned(levels: Floats) -> tuple[str, str] | None:
    """Tell by which factor both end frequencies are a round one, not being round themselves, and what that says.

    Sixty times round ones may be meant; beyond what usual instruments reach they are not.
    """
    if levels.size >= 2 and _is_turned(levels, 2 * pi):
        return "2π", "the column of frequency holds rad/s under Hz: a factor 6.28"
    if levels.size >= 2 and levels[-1] > _FAST and _is_turned(levels, 60.0):
        return "60", "the column of frequency holds turns per minute under Hz: a factor 60"
    return None


def _is_turned(levels: Floats, factor: float) -> bool:

    def is_round(value: float) -> bool:
        mantissa = value / 10.0 ** np.floor(log10(value))
        return min(abs(mantissa / k - 1) for k in (1.0, 2.0, 5.0, 10.0)) < 5e-4

    ends = (float(levels[0]), float(levels[-1]))
    return all(is_round(f / factor) and not is_round(f) for f in ends)


def stress_over_strain(export: Export) -> Check:
    name = "stress over strain"
    if "strain" not in export.data or "stress" not in export.data:
        return not_made(name, "columns of stress and strain")
    size = np.hypot(export.values("storage_modulus"), export.values("loss_modulus"))
    strain, stress = export.values("strain"), export.values("stress")
    known = (strain > 0) & (stress > 0) & (size > 0)
    if not known.any():
        return not_made(name, "stresses and strains")
    apart = np.log(size[known] * strain[known] / stress[known])
    ratio = float(np.exp(np.median(apart)))
    expected = float(np.median(stress[known] / strain[known]))
    file = export.name
    message = f"{file}: moduli are {factor_in_words(ratio)} times stress over strain ({quantity(expected, 'Pa')})"
    found = compared(name, message, ratio, 0.02 * ratio, 1.0, 0.02, allowance=_STRESS, file=file)
    if found.level is None:
        return found
    power = round(log10(ratio))
    thousands = {-3: "kPa stand as Pa, or GPa as MPa", 3: "Pa stand as kPa, or MPa as GPa"}
    unit = {-6: "MPa stand as Pa", 6: "Pa stand as MPa", **thousands}.get(power)
    if unit is not None and abs(log10(ratio) - power) < 0.1:
        return replace(found, cause=f"the unit of the moduli is wrong by a factor {in_words(10.0**power)}: {unit}")
    cause = f"the unit of the moduli, of stress or of strain is wrong: a factor {factor_in_words(ratio)}"
    return replace(found, cause=cause)


def size_of_modulus(export: Export, settings: Dma) -> Check:
    name = "modulus of a polymer"
    size = np.hypot(export.values("storage_modulus"), export.values("loss_modulus"))
    if not (size > 0).any():
        return not_made(name, "moduli")
    stiffest = float(np.quantile(size[size > 0], 0.95)) * modulus_factor(settings.mode, settings.nu.value)
    message = f"{export.name}: the stiffest readings are {quantity(stiffest, 'Pa')} in tension"
    low, high = map(log10, POLYMERS)
    found = bounded(name, message, log10(stiffest), 0.02, at_least=low, at_most=high, is_law=False, file=export.name)
    cause = "moduli in MPa stand as Pa" if stiffest < POLYMERS[0] else "moduli in Pa stand as kPa, MPa or GPa"
    return replace(found, cause=f"the unit of the moduli is wrong: {cause}")


def signs_of_moduli(export: Export) -> Check:
    name = "signs of the moduli"
    share = float(np.mean((export.values("storage_modulus") <= 0) | (export.values("loss_modulus") <= 0)))
    message = f"{export.name}: {in_words(100 * share, 2)} % of the readings are not positive"
    level: Level | None = "impossible" if share > 0.5 else "doubtful" if share > 0.2 else "note" if share else None
    cause = "the instrument's phase is wrong, or another column stands under the modulus"
    return stated(name, message, level, cause=cause, file=export.name)


def single_values(export: Export, isotherms: Sequence[Sweep]) -> Check:
    """Look for a value that lies decades beyond both of its neighbours in frequency."""
    name = "single values"
    if not isotherms:
        return not_made(name, "isothermal sweeps")
    worst: tuple[float, str] | None = None
    for sweep in isotherms:
        for column, title in _NAMES.items():
            values = sweep.values(column)
            if values.size < 4 or not (values > 0).all():
                continue
            gap = _alone(np.log10(values))
            at = int(np.argmax(np.abs(gap)))
            if abs(gap[at]) > _OUT and (worst is None or abs(gap[at]) > abs(log10(worst[0]))):
                worst = 10.0 ** float(gap[at]), f"{export.place(int(sweep.rows[at]))}: the {title}"
    if worst is None:
        return stated(name, f"{export.name}: no value beyond its neighbours", None, file=export.name)
    factor, where = worst
    text = f"{where} is a factor {factor_in_words(factor)} from its neighbours in frequency"
    level: Level = "impossible" if abs(log10(factor)) > _MISTYPED else "doubtful"
    cause = f"{where} is wrong by a factor {factor_in_words(factor, _ABOUT)}"
    return stated(name, text, level, cause=cause, file=export.name)


def _alone(y: Floats) -> Floats:
    """Return by how much every value lies beyond the range of its four nearest (two at ends)."""
    padded = np.pad(y, 2, constant_values=np.nan)
    # what is not there comes last
    near = np.sort(np.stack([padded[at : at + y.size] for at in (0, 1, 3, 4)], axis=1), axis=1)
    count, row = np.isfinite(near).sum(axis=1), np.arange(y.size)
    middle = 0.5 * (near[row, (count - 1) // 2] + near[row, count // 2])
    # a steep end of a sweep goes on as it comes
    reach = 2.0 * float(np.median(np.abs(np.diff(y)))) * (5 - count)
    return np.asarray(np.where(np.abs(y - middle) > reach, y - middle, 0.0))

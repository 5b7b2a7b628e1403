"""Checks of rheometer sweeps: redundant columns, causality, order with temperature, one specimen."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from math import inf, log, log10, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL, Check, Level, bounded, doubtful_among, in_words, not_made
from labpipe.materials import isothermal_runs, loading_of, modulus_factor, trusted_rows
from labpipe.report import quantity
from labpipe.signals import deviation
from labpipe.workflow.context import Context
from pipelines.experiments.dma.measured import ramps_of
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared import judgements
from pipelines.experiments.shared.judgements import Scene, Title

_POLYMERS = (3e4, 5e10)  # Pa in tension: the stiffest reading of a polymer, from a gel to a fibre composite
_DRIFT = 0.005  # decades of modulus that drift, drying and clamping add to noise
_FEWEST = 3  # sweeps of a part of them, or to either side of one
_LABEL, _CLAMP = "temperature by the shifts", "sweeps of one specimen"
_PLACE = (("temperature", "degC"), ("frequency", "Hz"))
_EXCHANGED = "the columns of storage and loss modulus are exchanged"
_FAILED = {
    "sweeps": "the exports hold no sweeps at several temperatures, or a column has the wrong unit",
    "master_curve": "the exports hold too few readings, or T_ref, their temperatures or their moduli are wrong",
}

TITLES = {
    "whole file": Title("An export holds all declared points.", ("whole file",)),
    "columns": Title(
        "Loss factor, stress over strain and frequency are consistent with the moduli.",
        ("loss factor", "stress over strain", "frequency", "signs of the moduli"),
    ),
    "single values": Title("Moduli change steadily with frequency.", ("single values",)),
    "size of the moduli": Title(
        "Moduli lie in the range of polymers for the stated mode of loading.",
        ("modulus of a polymer", "mode of loading"),
    ),
    "causality": Title(
        "Storage and loss of a linear solid determine each other (Kramers and Kronig).",
        ("storage and loss belong together",),
    ),
    "temperature": Title(
        "Temperatures are measured, in °C, and moduli fall as they rise.",
        ("temperatures", "temperature is measured", "order with temperature", _LABEL),
    ),
    "one specimen": Title("All files and all sweeps of a file are of one specimen.", ("files of one specimen", _CLAMP)),
    "superposition": Title("One master curve describes all temperatures.", ("superposition",)),
    "Poisson's ratio": Title("Polymers have Poisson's ratios of 0.2 to 0.5.", ("Poisson's ratio",)),
}


class Export(NamedTuple):
    """One export: its trusted rows, the isothermal sweeps that have enough of them, and sweeps of temperature.

    Sweeps are in ascending order of frequency, with the attributes ``file``, ``temperature`` (the mean, degC) and
    ``place``: file, temperature, and interval there.
    """

    name: str
    data: xr.Dataset
    sweeps: list[xr.Dataset]
    settings: Dma
    ramps: list[xr.Dataset]

    @classmethod
    def of(cls, name: str, data: xr.Dataset, settings: Dma) -> "Export":
        """Take the readings of a file."""
        good, options, sweeps = np.concatenate([[], *trusted_rows(data)]).astype(int), settings.sweeps, []
        for run in isothermal_runs(data, options.tolerance, options.fewest):
            one = data.isel(sample=np.intersect1d(run, good))
            if one.sizes["sample"] >= options.fewest:
                T = float(one["temperature"].mean())
                place = f"{name}, sweep at {T:.1f} °C"
                place += f", interval {int(one['interval'][0])}" if "interval" in one else ""
                one = one.isel(sample=np.argsort(one["frequency"].values, kind="stable"))
                sweeps.append(one.assign_attrs(file=name, temperature=T, place=place))
        return cls(name, data.isel(sample=np.sort(good)), sweeps, settings, ramps_of(data))

    def values(self, name: str) -> Floats:
        """Return one column; zeros where there is none."""
        return np.asarray(self.data[name].values if name in self.data else np.zeros(self.data.sizes["sample"]), float)

    def seen(self, name: str, text: str, level: Level | None = None, cause: str = "") -> Check:
        """Return a check of this file."""
        return Check(name, text, level, cause=cause, file=self.name)


@judgements.judging("readings", "sweeps", "master_curve", titles=TITLES)
def judgement(
    settings: Dma, context: Context, readings: Sequence[xr.Dataset | None] = (), master_curve: xr.Dataset | None = None
) -> Scene:
    """Judge the exports of one specimen; a step without a result is judged by its error."""
    needed = {"storage_modulus", "loss_modulus", "temperature", "frequency"}
    named = zip(settings.rheometer, readings, strict=False)
    exports = [Export.of(name, data, settings) for name, data in named if data is not None and needed <= set(data)]
    exports = [export for export in exports if export.data.sizes["sample"]]
    checks, nu, cause = judgements.failed_steps(context, _FAILED), settings.nu, ""
    if 0.25 <= 10 * nu.value <= 0.5:
        cause = f"nu is probably {10 * nu.value:g}, not {nu.value:g}: its decimal point slipped"
    text, place = f"nu = {nu.value:g}, polymers have 0.2 to 0.5", dict[str, Any](setting="nu", cause=cause)
    checks.append(bounded("Poisson's ratio", text, nu.value, max(nu.u, 1e-3), at_least=0.2, is_law=False, **place))
    checks += [check for export in exports for of in (_moduli, _temperatures) for check in of(export)]
    checks += [of(export) for export in exports for of in (_frequencies, _single_values, _causality, _clamped)]
    every = sorted((sweep for export in exports for sweep in export.sweeps), key=lambda one: one.attrs["temperature"])
    checks += [_softening(every), *_one_specimen(exports), _by_shifts(master_curve, every, settings.sweeps.tolerance)]
    if master_curve is None:
        return Scene([*checks, not_made("superposition", "a master curve of several temperatures")])
    # where superposition fails the predictions do as well
    verdict, noise = (json.loads(master_curve.attrs[name]) for name in ("superposition", "noise"))
    level: Level | None = {"pass": None, "doubtful": "note", "fail": "doubtful"}[verdict["level"]]
    storage, loss = (in_words(100 * noise[part], 2) for part in ("storage", "loss"))
    text = next(iter(verdict["reasons"]), f"the master curve misses E′ by {storage} % and E″ by {loss} %")
    cause = "the material has two processes, or the specimen, its clamping or its temperature changed between sweeps"
    return Scene([*checks, Check("superposition", text, level, cause=cause)])


def _power_of_ten(ratio: float, decades: float = 0.05) -> str:
    """Write a factor, as a power of ten where it is that within some decades."""
    power = log10(ratio)
    is_power = abs(power) > 0.5 and abs(power - round(power)) < decades
    return in_words(10.0 ** round(power) if is_power else ratio)


def _redundant(export: Export, name: str, seen: Floats, expected: Floats, cause: str, rounding: float = 0.1) -> Check:
    """Compare a column with what others say: the median shows a wrong unit, one reading a value that is mistyped.

    ``rounding`` is the relative difference that is none, of two digits by default; infinite between columns that the
    instrument corrected for clamps and inertia.
    """
    known = (seen > 0.0) & (expected > 0.0)
    if not known.any():
        return not_made(name, "both columns, and values above 0")
    seen, expected = seen[known], expected[known]
    gap = np.log(seen / expected)
    middle, at = float(np.median(gap)), int(np.argmax(np.abs(gap)))

    def said(one: float, other: float) -> str:
        return f"{name} of {in_words(one)}, by the other columns {in_words(other)}"

    if abs(middle) > 0.5 * log(2.0):  # nearer to a factor of two than to one
        times = f"{cause}: a factor {_power_of_ten(float(np.exp(middle)))}"
        is_inverse = float(np.median(np.abs(np.log(seen * expected)))) < 0.02
        text = f"{export.name}: {said(float(np.median(seen)), float(np.median(expected)))} (medians)"
        return export.seen(name, text, "impossible", _EXCHANGED if is_inverse else times)
    if abs(gap[at]) > rounding:
        row = [quantity(float(export.values(of)[known][at]), si) for of, si in _PLACE]
        text = f"{export.name}, {' and '.join(row)}: {said(seen[at], expected[at])}"
        return export.seen(name, text, "doubtful", f"a value of this row is mistyped: {name}, or one of the others")
    return export.seen(name, f"{export.name}: {said(float(np.median(seen)), float(np.median(expected)))} (medians)")


def _moduli(export: Export) -> Iterator[Check]:
    """Repeat what a reader misses; compare moduli with zero, polymers, other columns, and the stated mode."""
    missing = json.loads(str(export.data.attrs.get("cut", "[]")))
    whole = export.seen("whole file", f"{export.name}: nothing is missing")
    if missing:
        line, text = missing[0]
        text += f"; {len(missing)} such intervals" * (len(missing) > 1)
        cause = "the test was stopped, or the file was cut: copy it again from the rheometer"
        whole = replace(export.seen("whole file", f"{export.name}: {text}", "doubtful", cause), line=line)
    yield whole
    file, storage, loss = export.name, export.values("storage_modulus"), export.values("loss_modulus")
    share, size = float(np.mean((storage <= 0) | (loss <= 0))), np.hypot(storage, loss)
    message = f"{in_words(100 * share, 2)} % of the readings are not positive" if share else "all moduli are positive"
    level: Level | None = "impossible" if share > 0.5 else "doubtful" if share > 0.2 else "note" if share else None
    cause = "the instrument's phase is wrong, or another column has the name of the modulus"
    yield export.seen("signs of the moduli", f"{file}: {message}", level, cause)

    name = "modulus of a polymer"
    if (size > 0).any():
        factor = modulus_factor(export.settings.mode, export.settings.nu.value)
        stiffest = factor * float(np.quantile(size[size > 0], 0.95))
        message = f"{file}: the stiffest readings are {quantity(stiffest, 'Pa')} in tension"
        low, high = map(log10, _POLYMERS)
        cause = "moduli in MPa stand as Pa" if stiffest < _POLYMERS[0] else "moduli in Pa stand as kPa, MPa or GPa"
        place: dict[str, Any] = {"file": file, "cause": f"the unit of the moduli is wrong: {cause}", "is_law": False}
        yield bounded(name, message, log10(stiffest), 0.02, at_least=low, at_most=high, **place)
    else:
        yield not_made(name, "moduli")
    cause = "one modulus, or the loss factor, has the wrong unit"
    ratio = np.divide(loss, storage, out=np.zeros_like(loss), where=storage != 0.0)
    yield _redundant(export, "loss factor", export.values("loss_factor"), ratio, cause)
    cause, strain = "the unit of the moduli, of stress or of strain is wrong", export.values("strain")
    expected = np.divide(export.values("stress"), strain, out=np.zeros_like(strain), where=strain != 0.0)
    yield _redundant(export, "stress over strain", expected, size, cause, inf)

    name, (seen, heading), settings = "mode of loading", loading_of(export.data), export.settings
    if not seen:
        yield not_made(name, "a heading that says shear or extensional strain, or whether a modulus is G or E")
        return
    message = f'{file} has a column "{heading}", session.toml says mode = "{settings.mode}"'
    should, factor = "torsion or shear" if seen == "shear" else "tension or bending", 2 * (1 + settings.nu.value)
    cause = f"mode is probably {should}, not {settings.mode}: moduli are a factor {in_words(factor)} off"
    level = "doubtful" if (seen == "shear") != settings.is_shear else None
    yield Check(name, message, level, cause=cause, setting="mode")


def _frequencies(export: Export) -> Check:
    """Compare frequencies with the other column, with round ones, and with the duration of a reading."""
    name, file, data, hertz = "frequency", export.name, export.data, export.values("frequency")
    if hertz.min() <= 0.0:
        cause = "another column has the name of the frequency, such as the temperature"
        return export.seen(name, f"{file}: a frequency of {hertz.min():.4g} Hz", "impossible", cause)
    if data.attrs.get("derived", "-") == "" and "angular_frequency" in data:
        cause = "one column of frequency has the unit of the other (Hz, rad/s)"
        return _redundant(export, name, export.values("angular_frequency"), 2 * pi * hertz, cause)
    # whether the lowest and the highest are 1, 2 or 5 times a power of ten, as hertz and as rad/s
    ends = np.array([hertz.min(), hertz.max()])[:, None] / [1.0, 2 * pi]
    mantissa = (ends / 10.0 ** np.floor(np.log10(ends)))[..., None]
    as_hertz, as_radians = (np.abs(mantissa / [1.0, 2.0, 5.0, 10.0] - 1.0).min(axis=2) < 5e-4).all(axis=0)
    if data.attrs.get("derived") != "frequency" and np.ptp(hertz) > 1e-6 and as_radians and not as_hertz:
        text = f"{file}: frequencies of {hertz.max():.5g} to {hertz.min():.5g} Hz are 2π times round ones"
        return export.seen(name, text, "doubtful", "the column of frequency holds rad/s under Hz: a factor 6.28")
    # nine in ten readings of a sweep take so many periods at most
    lasts = []
    for sweep in export.sweeps if "time" in data else ():
        in_time = sweep.sortby("time")
        periods = np.diff(in_time["time"].values) * in_time["frequency"].values[1:]
        if (known := periods[periods > 0.0]).size > 4:
            lasts.append((float(np.quantile(known, 0.9)), sweep.attrs["place"]))
    if not lasts:
        return not_made(name, "times of five readings of a sweep, or both frequencies")
    shortest, place = min(lasts)
    message = f"{place}: readings take {shortest:.2g} periods at most"
    cause = "frequencies are too low for their times: Hz under rad/s (a factor 6.28), or times in another unit"
    return export.seen(name, message, "doubtful" if shortest < 0.7 else None, cause)


def _single_values(export: Export) -> Check:
    """Look for a value decades beyond its four neighbours in frequency."""
    name, worst, where = "single values", 0.0, ""
    for sweep, column in product(export.sweeps, ("storage_modulus", "loss_modulus")):
        values = sweep[column].values
        if values.size < 4 or not (values > 0).all():
            continue
        y = np.log10(values)
        # median_filter of SciPy 1.15.0 writes beyond short arrays (https://github.com/scipy/scipy/issues/22250)
        gap = y - np.median(np.lib.stride_tricks.sliding_window_view(np.pad(y, 2, mode="reflect"), 5), axis=1)
        at = int(np.argmax(np.abs(gap)))
        # nearer to a lost decimal point than to its neighbours; a steep end of a sweep is no outlier
        if abs(gap[at]) > max(0.5, abs(worst), 2.0 * float(np.median(np.abs(np.diff(y))))):
            frequency = quantity(float(sweep["frequency"].values[at]), "Hz")
            worst, where = float(gap[at]), f"{sweep.attrs['place']}, {frequency}: the {column.replace('_', ' ')}"
    if not export.sweeps:
        return not_made(name, "isothermal sweeps")
    levels = [np.log10(np.maximum(sweep["storage_modulus"].values, 1.0)) for sweep in export.sweeps]
    falls = [y.size >= 4 and bool((np.diff(y) < 0.0).all()) and y[0] - y[-1] > 4 * _DRIFT for y in levels]
    if sum(falls) == 1:  # in several of them it is another column
        text = f"{export.sweeps[falls.index(True)].attrs['place']}: the storage modulus falls as the frequency rises"
        return export.seen(name, text, "impossible", "frequencies or moduli of this sweep are in reverse order")
    if not where:
        return export.seen(name, f"{export.name}: no value beyond its neighbours")
    text = f"{where} is a factor {_power_of_ten(10.0**worst)} from its neighbours in frequency"
    cause = f"{where} is wrong by a factor {_power_of_ten(10.0**worst, 0.2)}"
    # noise does not reach a factor of 8
    return export.seen(name, text, "impossible" if abs(worst) > 0.9 else "doubtful", cause)


def _causality(export: Export) -> Check:
    """Compare the loss factor with the rise of the storage modulus with frequency."""
    # E* ~ (i omega)^b has tan delta = tan(pi b / 2): Booij & Thoone, Rheol. Acta 21 (1982) 15, doi:10.1007/BF01520701
    name, pairs = "storage and loss belong together", []
    for sweep in export.sweeps:
        x = np.log(sweep["frequency"].values)
        storage, loss = sweep["storage_modulus"].values, sweep["loss_modulus"].values
        if x.size >= 4 and np.ptp(x) >= log(10.0) and ((storage > 0) & (loss > 0)).all():
            slopes = [np.polyfit(x, np.log(y), 1)[0] for y in (storage, loss)]
            # the loss factor, from the rise of the storage modulus, and from that of the loss if both are exchanged
            local = np.log(np.tan(0.5 * pi * np.clip(slopes, 2e-3, 0.98)))
            pairs.append([float(np.median(np.log(loss / storage))), *local])
    if not pairs:
        return not_made(name, "sweeps of four frequencies over a decade")
    loss, rise, swapped = np.array(pairs).T
    ours, theirs = float(np.median(np.abs(loss - rise))), float(np.median(np.abs(loss + swapped)))
    middle, expected = np.exp(np.median(loss)), np.exp(np.median(rise))
    message = f"{export.name}: tan δ is {middle:.3g}, the rise with frequency says {expected:.3g} (medians)"
    if ours > log(3.0) and theirs < 0.5 * ours and middle > 1.0:
        return export.seen(name, message, "impossible", _EXCHANGED)
    level: Level | None = "doubtful" if ours > log(10.0) else "note" if ours > log(5.0) else None
    return export.seen(name, message, level, "one of the moduli has another unit than the other, or the phase is wrong")


def _temperatures(export: Export) -> Iterator[Check]:
    """Check the unit of temperature, by its range, T_ref and multiples of 5 K, and that it is measured."""
    name, file, T, reference = "temperatures", export.name, export.values("temperature"), export.settings.T_ref
    low, high, sweeps = float(T.min()), float(T.max()), np.array([one.attrs["temperature"] for one in export.sweeps])
    message, cause = f"{file}: temperatures from {low:.1f} to {high:.1f} °C", "temperatures have another unit (K, °F)"
    message += "" if reference is None else f", T_ref is {reference.value:.4g} °C"
    is_far = reference is not None and not low - 30 <= reference.value <= high + 30
    as_stated, as_celsius = (np.abs((x + 2.5) % 5.0 - 2.5) for x in (sweeps, (sweeps - 32) / 1.8))
    level: Level | None = "doubtful" if is_far or low < -200.0 or high > 400.0 else None
    setting = ""
    if low > 180.0 and (reference is None or is_far):
        cause = f"temperatures are in K under °C: {low - 273.15:.1f} to {high - 273.15:.1f} °C are meant"
        level = "impossible" if is_far else "doubtful"
    elif sweeps.size >= 4 and np.mean(as_stated > 0.6) > 0.4 and (as_celsius < 0.6).all():
        cause = f"temperatures are in °F under °C: {(low - 32) / 1.8:.1f} to {(high - 32) / 1.8:.1f} °C are meant"
        message, level = f"{message}; in °F the isotherms are multiples of 5 °C", "doubtful"
    elif is_far:
        cause, setting, file = f"T_ref is wrong, or {cause}", "T_ref", ""
    yield Check(name, message, level, cause=cause, file=file, setting=setting)

    name = "temperature is measured"
    frequency = np.round(np.log10(np.maximum(export.values("frequency"), 1e-9)), 2)
    found, counts = np.unique(frequency, return_counts=True)
    same = export.values("storage_modulus")[frequency == found[np.argmax(counts)]]
    if high - low > 1.0 or same.size < 3 or not (same > 0).all():
        yield Check(name, f"{export.name}: temperatures span {high - low:.1f} K", None)
        return
    times = float(same.max() / same.min())
    text = f"{export.name}: all temperatures are {T.mean():.1f} °C, while the storage modulus differs by a factor "
    text += f"{in_words(times)} between {same.size} readings at one frequency"
    cause = "the column of temperature is constant: it holds the setting, or the sensor was not read"
    yield export.seen(name, text, "impossible" if times > 1.5 else "doubtful" if times > 1.2 else None, cause)


def _common_levels(sweeps: Sequence[xr.Dataset]) -> Floats | None:
    """Return log10 of the storage moduli (sweep, frequency) at seven frequencies that all reach; None without any."""
    frequencies, moduli = ([s[name].values for s in sweeps] for name in ("frequency", "storage_modulus"))
    low, high = max((float(f[0]) for f in frequencies), default=0.0), min((f[-1] for f in frequencies), default=0.0)
    if not 0 < low < high or any((modulus <= 0).any() for modulus in moduli):
        return None
    x = np.linspace(log(low), log(high), 7)
    return np.array([np.interp(x, np.log(f), np.log10(m)) for f, m in zip(frequencies, moduli, strict=True)])


def _softening(sweeps: Sequence[xr.Dataset]) -> Check:
    """Look for the isotherm that breaks the fall of the modulus with temperature."""
    name = "order with temperature"
    moduli = _common_levels(sweeps) if len(sweeps) > 2 else None
    if moduli is None:
        return not_made(name, "three isotherms over common frequencies")
    T, levels = np.array([s.attrs["temperature"] for s in sweeps]), np.median(moduli, axis=1)

    def rising(T: Floats, levels: Floats) -> float:
        """Return the decades by which moduli rise from isotherm to isotherm beyond entropic elasticity."""
        entropic = np.log10((T[1:] + 273.15) / (T[:-1] + 273.15))
        rise = np.diff(levels) - np.where(levels[1:] < 8.0, 1.5 * entropic, 0.0) - _DRIFT
        return float(np.sum(np.maximum(rise, 0.0)))

    def rough(T: Floats, levels: Floats) -> float:
        degree = max(min(2, np.unique(T).size - 2), 0)
        return float(np.sum((levels - np.polynomial.Polynomial.fit(T, levels, degree)(T)) ** 2))

    rise = rising(T, levels)
    if rise == 0.0:
        return Check(name, f"{T.size} isotherms in order", None)
    without = [(np.delete(T, i), np.delete(levels, i)) for i in range(T.size)]
    # of two neighbours in wrong order the wrong one is that without which the rest is smooth
    i = min(range(T.size), key=lambda i: (rising(*without[i]) > 0.2 * rise, rough(*without[i])))
    others, falling = without[i]
    if T.size > 3 and rising(others, falling) <= 0.2 * rise:
        level: Level | None = "impossible" if rise > 10 * _DRIFT else "doubtful" if rise > 4 * _DRIFT else None
        ascending = np.argsort(falling)
        belongs = float(np.interp(levels[i], falling[ascending], others[ascending]))
        cause = f"the temperature of {sweeps[i].attrs['place']} is probably {abs(T[i] - belongs):.0f} K too "
        cause += f"{'high' if T[i] > belongs else 'low'}: its modulus is that of {belongs:.0f} °C"
        text = f"{sweeps[i].attrs['place']} breaks the fall of the modulus with temperature"
        return Check(name, text, level, cause=cause, file=sweeps[i].attrs["file"])
    at = int(np.argmax(np.diff(levels)))
    times = in_words(10.0 ** float(np.diff(levels)[at]))
    text = f"the modulus rises by a factor {times} from {T[at]:.1f} to {T[at + 1]:.1f} °C"
    cause = "a specimen that crystallised or dried, one of another material, or temperatures in wrong order"
    level = "doubtful" if rise > 0.15 else "note" if rise > 4 * _DRIFT else None
    return Check(name, text, level, cause=cause, file=sweeps[at + 1].attrs["file"])


def _one_specimen(exports: Sequence[Export]) -> Iterator[Check]:
    """Compare sweeps of two exports at one temperature; each may stray by the tolerance."""
    name, is_known = "files of one specimen", False
    for first, second in combinations(exports, 2):
        tolerance = 2 * first.settings.sweeps.tolerance
        pairs = product(first.sweeps, second.sweeps)
        near = (pair for pair in pairs if abs(pair[0].attrs["temperature"] - pair[1].attrs["temperature"]) < tolerance)
        gaps = [float(np.median(both[0] - both[1])) for both in map(_common_levels, near) if both is not None]
        if gaps:
            is_known, middle, size = True, float(np.median(gaps)), float(np.max(np.abs(gaps)))
            text = f"{first.name} over {second.name}: moduli differ by a factor {in_words(10.0**middle)}, up to "
            text += in_words(10.0**size)
            is_other = abs(middle) * log(10.0) > DOUBTFUL * judgements.MEASURED
            level: Level | None = "impossible" if size > 1.0 else "doubtful" if is_other else None
            yield second.seen(name, text, level, f"{second.name} is of another material, or has another unit")
    if not is_known:
        yield not_made(name, "isotherms that two files share")


def _clamped(export: Export) -> Check:
    """Compare the frequency sweeps with the temperature sweeps of one file, at equal temperature and frequency.

    Clamped anew, or slipped, a specimen has other moduli from one interval on. Temperatures may stray by the tolerance.
    """
    pairs, strays = list[tuple[float, float, str]](), export.settings.sweeps.tolerance
    for ramp, sweep in product(export.ramps, export.sweeps):
        ascending = ramp.isel(sample=np.unique(ramp["temperature"].values, return_index=True)[1])
        T, x, at = ascending["temperature"].values, sweep["frequency"].values, float(ascending["frequency"].median())
        here = float(sweep.attrs["temperature"])
        if not (x[0] < 1.01 * at and at < 1.01 * x[-1] and T[0] < here < T[-1]):
            continue
        of_ramp, of_sweep = (
            np.log(np.hypot(one["storage_modulus"].values, one["loss_modulus"].values)) for one in (ascending, sweep)
        )
        expected = float(PchipInterpolator(T, of_ramp)(here))
        low, middle, high = np.interp(here + np.array([-strays, 0.0, strays]), T, of_ramp)
        u = np.hypot(max(abs(low - middle), abs(high - middle)), middle - expected)
        apart = float(np.interp(log(at), np.log(x), of_sweep)) - expected
        pairs.append((apart, float(u), str(sweep.attrs["place"])))
    if len(pairs) < 2 * _FEWEST:
        return not_made(_CLAMP, f"{2 * _FEWEST} sweeps within a temperature sweep of the same file")
    d, u = np.array([pair[:2] for pair in pairs]).T
    noise = deviation(np.diff(d)) / sqrt(2.0)
    weight = 1.0 / (u**2 + max(noise, 0.1 * _DRIFT) ** 2)

    def mean(part: slice) -> tuple[float, float]:
        return float(np.average(d[part], weights=weight[part])), float(weight[part].sum() ** -0.5)

    splits = range(_FEWEST, d.size - _FEWEST + 1)
    steps = {k: (mean(slice(k, None)), mean(slice(k))) for k in splits}
    k = max(steps, key=lambda k: abs(steps[k][0][0] - steps[k][1][0]) / np.hypot(steps[k][0][1], steps[k][1][1]))
    (after, u_after), (before, u_before) = steps[k]
    margin = (after - before) / float(np.hypot(u_after, u_before))
    if abs(margin) > doubtful_among(len(splits)) and abs(after - before) > 4 * _DRIFT * log(10.0):
        text = f"{pairs[k][2]}: from here on moduli are {in_words(np.exp(after))} times those of the temperature sweep "
        text += f"at equal temperature and frequency, before it {in_words(np.exp(before))} times"
        cause = f"the specimen slipped or was clamped anew before {pairs[k][2]}: moduli differ by a factor "
        cause += f"{in_words(np.exp(after - before))} from there on"
        return export.seen(_CLAMP, text, "doubtful", cause)
    offset, u_offset = mean(slice(None))
    text = f"{export.name}: moduli of frequency sweeps are {in_words(np.exp(offset))} times those of the temperature "
    text += "sweep"
    is_off = abs(offset) > max(DOUBTFUL * u_offset, 4 * _DRIFT * log(10.0))
    cause = "specimen, clamping or strain changed between temperature sweep and frequency sweeps"
    return export.seen(_CLAMP, text, "doubtful" if is_off else None, cause)


def _by_shifts(curve: xr.Dataset | None, sweeps: Sequence[xr.Dataset], strays: float) -> Check:
    """Compare the temperature of each sweep, which strays [K] a little, with that of its shift on the course of others.

    Their own scatter about one course says how well it is known; the uncertainties of a fit with a wrong label do not.
    """
    for one, other in combinations(sweeps, 2):
        if all(np.array_equal(one[name], other[name]) for name in ("storage_modulus", "loss_modulus")):
            text = f"{one.attrs['place']} and {other.attrs['place']} hold the same moduli"
            cause = "the values of one of these two sweeps were copied over those of the other: export them again"
            return Check(_LABEL, text, "doubtful", cause=cause, file=one.attrs["file"])
    if curve is None or curve.sizes.get("temperature", 0) < 2 * _FEWEST or not sweeps:
        return not_made(_LABEL, f"shifts of {2 * _FEWEST} temperatures")

    def implied(shifts: Floats) -> tuple[Floats, Floats]:
        """Return by how much the temperature that the others imply exceeds each, and how much more that scatters there.

        Shifts are in ascending order. Midway between two others the gain of the scatter is one, beyond an end two.
        """
        found = []
        for i in range(shifts.shape[1]):
            T, log_aT = np.delete(shifts, i, axis=1)
            end = int(np.clip(np.searchsorted(log_aT, shifts[1, i]), 1, T.size - 1))  # an end is extrapolated
            part = (shifts[1, i] - log_aT[end - 1]) / max(log_aT[end] - log_aT[end - 1], 1e-3)
            off = T[end - 1] + part * (T[end] - T[end - 1]) - shifts[0, i]
            found.append((off, np.sqrt((1.0 + part**2 + (1.0 - part) ** 2) / 1.5)))
        off, gain = np.array(found).T
        return off, gain

    known = np.array([curve["temperature"].values, curve["log10_aT"].values])
    known = known[:, np.argsort(known[1])]
    found = []
    for i, (off, gain) in enumerate(zip(*implied(known), strict=True)):
        # without the sweep whose temperature is wrong the others lie on a smooth course, its neighbours as well
        rest = np.abs(np.divide(*implied(np.delete(known, i, axis=1))))
        near = np.sqrt(np.mean(rest[max(i - 2, 0) : i + 2] ** 2))
        found.append((abs(off) / (gain * DOUBTFUL * max(deviation(rest), float(near)) + strays), off, i))
    worst, off, i = max(found)
    T = float(known[0, i])
    if worst <= 1.0:
        return Check(_LABEL, f"shifts of {len(found)} sweeps follow one course, the farthest off by {abs(off):.1f} K")
    sweep = min(sweeps, key=lambda one: abs(float(one.attrs["temperature"]) - T))
    place, same = str(sweep.attrs["place"]), np.abs(np.delete(known[0], i) - T) <= strays
    text = f"{place}: its shift lies on the course of the others at {T + off:.0f} °C"
    text += ", and another sweep is stated at the same temperature" * bool(same.any())
    cause = f"the temperature of {place} is probably {T + off:.0f} °C, not {T:.1f} °C"
    return Check(_LABEL, text, "doubtful", cause=cause, file=sweep.attrs["file"])

"""Checks of temperatures: their unit, readings that stray, sweeps that drift, the order of the moduli with them."""

from collections.abc import Iterator, Sequence

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import Check, Level, in_words, not_made, stated
from pipelines.experiments.dma._checked_sweeps import (
    FEW_ROWS,
    MOST,
    OWN,
    Export,
    Sweep,
    median_levels,
    rows_of_intervals,
)
from pipelines.experiments.dma.settings import Dma

_STEP = 5.0  # K, of which set temperatures are multiples
_NEAR = 0.6  # K from a set temperature
_FEW = 20  # readings; more of them with one and the same temperature were not read from a sensor
_CONSTANT = 1.0  # K within which all temperatures are one


def strayed_readings(export: Export, settings: Dma) -> Check:
    """Look for single readings whose temperature is not that of their interval."""
    name = "temperature within an interval"
    T = np.asarray(export.data["temperature"].values, float)
    worst, at = 0.0, -1
    for own in rows_of_intervals(export):
        apart = np.abs(T[own] - np.median(T[own]))
        if own.size >= FEW_ROWS and (apart <= settings.sweeps.tolerance).mean() >= MOST and apart.max() > worst:
            worst, at = float(apart.max()), int(own[np.argmax(apart)])
    if at < 0:
        return not_made(name, "a column of intervals, one of them at one temperature")
    text = f"{export.place(at)}: {T[at]:.1f} °C, {worst:.1f} K beside the others of its interval"
    if worst <= 3 * settings.sweeps.tolerance:
        return stated(name, text, None, file=export.name)
    cause = "the temperature of this reading is mistyped, or the sensor had a fault: the reading is left out"
    return stated(name, text, "doubtful", cause=cause, file=export.name)


def temperatures_of(exports: Sequence[Export], isotherms: Sequence[Sweep], settings: Dma) -> Iterator[Check]:
    for export in exports:
        yield _range(export, [s.temperature for s in isotherms if s.export is export], settings)
    name = "temperature is measured"
    for export in exports:
        T, repeated = export.values("temperature"), _repeated(export)
        if np.ptp(T) > _CONSTANT or repeated is None:
            yield stated(name, f"{export.name}: temperatures span {np.ptp(T):.1f} K", None)
            continue
        times, count = repeated
        text = (
            f"{export.name}: all temperatures are {T.mean():.1f} °C, while the storage modulus differs "
            f"by a factor {in_words(times)} between {count} readings at one frequency"
        )
        is_read = np.ptp(T) > 0.0 or T.size < _FEW
        level: Level | None = "doubtful" if times > 1.2 else None
        if times > (2.0 if is_read else 1.2):
            level = "impossible"
        cause = "the column of temperature is constant: it holds the setting, or the sensor was not read"
        yield stated(name, text, level, cause=cause, file=export.name)


def _repeated(export: Export) -> tuple[float, int] | None:
    """Return by how much the storage modulus differs at the commonest frequency, and of how many readings."""
    level = np.round(np.log10(np.maximum(export.values("frequency"), 1e-9)), 2)
    found, counts = np.unique(level, return_counts=True)
    same = export.values("storage_modulus")[level == found[np.argmax(counts)]]
    if same.size < 3 or not (same > 0).all():
        return None
    return float(same.max() / same.min()), int(same.size)


def _range(export: Export, isotherms: Sequence[float], settings: Dma) -> Check:
    name = "temperatures"
    T = export.values("temperature")
    low, high, file = float(T.min()), float(T.max()), export.name
    message = f"{file}: temperatures from {low:.1f} to {high:.1f} °C"
    wanted = None if settings.T_ref is None else settings.T_ref.value
    if wanted is not None:
        message += f", T_ref is {wanted:g} °C"
    if low < -273.15:
        return stated(name, message, "impossible", cause="the unit of temperature is wrong", file=file)
    is_far = wanted is not None and not low - 30 <= wanted <= high + 30
    kelvin = low > 180.0 and (wanted is None or is_far or high > 350.0)
    if kelvin and (wanted is None or low - 303.15 <= wanted <= high - 243.15):
        cause = f"temperatures are in K under °C: {low - 273.15:.1f} to {high - 273.15:.1f} °C are meant"
        return stated(name, message, "impossible" if is_far else "doubtful", cause=cause, file=file)
    if _is_fahrenheit(np.asarray(isotherms)):
        celsius = (low - 32) / 1.8, (high - 32) / 1.8
        message += f"; in °F the isotherms are multiples of {_STEP:g} °C"
        cause = f"temperatures are in °F under °C: {celsius[0]:.1f} to {celsius[1]:.1f} °C are meant"
        return stated(name, message, "doubtful", cause=cause, file=file)
    if is_far:
        cause = "T_ref is wrong, or temperatures have another unit (K, °F) than °C"
        return stated(name, message, "doubtful", cause=cause, setting="T_ref")
    if low < -200.0 or high > 400.0:
        cause = "temperatures have another unit (K, °F) than °C"
        return stated(name, message, "doubtful", cause=cause, file=file)
    return stated(name, message, None, file=file)


def _is_fahrenheit(T: Floats) -> bool:
    """Tell whether isotherms are multiples of 5 K as °F, and not as °C."""
    if T.size < 4:
        return False

    def apart(values: Floats) -> Floats:
        return np.asarray(np.abs((values + 0.5 * _STEP) % _STEP - 0.5 * _STEP))

    is_far = bool(np.mean(apart(T) > _NEAR) > 0.4)
    return is_far and bool((apart((T - 32) / 1.8) < _NEAR).all())


def softening(isotherms: Sequence[Sweep]) -> Check:
    """Look for the isotherm that breaks the fall of the modulus with temperature."""
    name = "order with temperature"
    levels = median_levels(isotherms)
    if levels is None:
        return not_made(name, "three isotherms over common frequencies")
    T, level = np.array([s.temperature for s in isotherms]), levels
    rise = _broken(T, level)
    if rise == 0.0:
        return stated(name, f"{T.size} isotherms in order", None)
    others = np.array([_broken(np.delete(T, i), np.delete(level, i)) for i in range(T.size)])
    # two neighbours in wrong order: the wrong one is that without which the rest is smooth
    rough = [_roughness(np.delete(T, i), np.delete(level, i)) for i in range(T.size)]
    able = [int(i) for i in np.argsort(rough) if others[i] <= 0.2 * rise]
    if able and T.size > 3:
        where, told = zip(*(_misplaced(isotherms, level, i) for i in able[:2]), strict=True)
        text, file = where[0], isotherms[able[0]].export.name
        cause = "the temperature of " + ", or that of ".join(told)
    else:
        at = int(np.argmax(np.diff(level)))
        times = 10.0 ** float(np.diff(level)[at])
        text = f"the modulus rises by a factor {in_words(times)} from {T[at]:.1f} to {T[at + 1]:.1f} °C"
        file = isotherms[at + 1].export.name
        cause = "a specimen that crystallised or dried, one of another material, or temperatures in wrong order"
        return stated(
            name, text, "doubtful" if rise > 0.15 else "note" if rise > 4 * OWN else None, cause=cause, file=file
        )
    found: Level | None = "impossible" if rise > 10 * OWN else "doubtful" if rise > 4 * OWN else None
    return stated(name, text, found, cause=cause, file=file)


def _misplaced(isotherms: Sequence[Sweep], level: Floats, at: int) -> tuple[str, str]:
    """Say to which temperature an isotherm belongs by its modulus, and what is wrong with it."""
    T = np.array([s.temperature for s in isotherms])
    rest = np.delete(level, at)
    order = np.argsort(rest)
    belongs = float(np.interp(level[at], rest[order], np.delete(T, at)[order]))
    away, place = T[at] - belongs, isotherms[at].place
    word = "high" if away > 0 else "low"
    return (
        f"{place}: at {T[at]:.1f} °C the modulus is that of {belongs:.0f} °C",
        f"{place} is probably {abs(away):.0f} K too {word}",
    )


def _roughness(T: Floats, level: Floats) -> float:
    """Return the residual of a parabola through levels over temperature."""
    degree = min(2, np.unique(T).size - 2)
    if degree < 0:
        return float(np.sum((level - level.mean()) ** 2))
    return float(np.sum((level - np.polynomial.Polynomial.fit(T, level, degree)(T)) ** 2))


def _broken(T: Floats, level: Floats) -> float:
    """Return the decades by which moduli rise from isotherm to isotherm beyond entropic elasticity."""
    entropic = np.log10((T[1:] + 273.15) / (T[:-1] + 273.15))
    rise = np.diff(level) - np.where(level[1:] < 8.0, 1.5 * entropic, 0.0) - OWN
    return float(np.sum(np.maximum(rise, 0.0)))

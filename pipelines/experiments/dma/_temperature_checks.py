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
_IN_A_ROW, _SAME = 6, 1e-3  # readings, and relative differences of what is set alike for them
_AGES, _IN_NOISE = 0.05, 8.0  # relative change, and standard deviations, of a modulus that should keep its value
_LAG = 5.0  # K by which a specimen may follow the air while that is heated steadily
_OF_SWEEPS = 0.05  # decades, by which a heated specimen's modulus may differ from that of the isotherms besides


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


def steady_temperature(export: Export, settings: Dma) -> Check:
    """Look for the sweep over frequencies during which the temperature moves most."""
    name = "temperature during a sweep"
    drifts = []
    for rows in rows_of_intervals(export):
        frequency, T = (np.asarray(export.data[n].values[rows], float) for n in ("frequency", "temperature"))
        # a ramp repeats its frequencies at other temperatures, a sweep has each of them once
        if rows.size >= FEW_ROWS and np.unique(np.round(np.log10(np.maximum(frequency, 1e-9)), 3)).size == rows.size:
            at = np.arange(rows.size) - 0.5 * (rows.size - 1)
            # between medians of its parts: a single reading that strays is another check
            half = rows.size // 3
            moved = float(np.median(T[-half:]) - np.median(T[:half])) * (rows.size - 1) / float(at[-1] * 2 - half + 1)
            drifts.append((abs(moved), moved, int(rows[0])))
    if not drifts:
        return not_made(name, "an interval over several frequencies")
    size, moved, row = max(drifts)
    place = export.place(row).rpartition(", point")[0] or export.name
    text = f"{place}: the temperature moves by {moved:+.1f} K from its first reading to its last"
    level: Level | None = "doubtful" if size > 2 * settings.sweeps.tolerance else None
    cause = "the specimen was still warming or cooling: its readings belong to several temperatures; wait longer"
    return stated(name, text, level, cause=cause, file=export.name)


def one_condition(export: Export) -> Check:
    """Look for a modulus that changes steadily over readings of one temperature, frequency and strain."""
    name = "readings of one condition"
    found = []
    for rows in rows_of_intervals(export):
        T, f, storage = (export.data[n].values[rows] for n in ("temperature", "frequency", "storage_modulus"))
        strain = export.data["strain"].values[rows] if "strain" in export.data else np.ones(rows.size)
        is_one = rows.size >= _IN_A_ROW and np.ptp(T) < _CONSTANT and (storage > 0).all()
        if is_one and np.ptp(f) <= _SAME * f.max() and np.ptp(strain) <= _AGES * np.max(strain):
            y, third = np.log(storage), rows.size // 3
            noise = 1.4826 * float(np.median(np.abs(np.diff(y, 2)))) / np.sqrt(6.0)
            moved = float(np.mean(y[-third:]) - np.mean(y[:third]))
            found.append((abs(moved) > max(_AGES, _IN_NOISE * noise), moved, int(rows[0])))
    if not found:
        return not_made(name, "readings of one temperature, frequency and strain in a row")
    moved, row = max(((m, r) for _, m, r in found), key=lambda one: abs(one[0]))
    place = export.place(row).rpartition(", point")[0] or export.name
    text = f"{place}: the storage modulus changes by {100 * moved:+.1f} % over readings of one condition"
    is_off = sum(off for off, _, _ in found) > len(found) / 2
    cause = (
        "the column of the frequency holds one value for readings at several; or the specimen changes at one "
        "temperature: it dries, cures, or had not settled"
    )
    return stated(name, text, "doubtful" if is_off else None, cause=cause, file=export.name)


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
    if (part := _part_in_kelvin(np.asarray(isotherms))) is not None:
        message += f"; without 273.15 K those from {part:.1f} °C on go on from the others"
        cause = f"temperatures from {part:.1f} on are in K under °C: {part - 273.15:.1f} °C and more are meant"
        return stated(name, message, "doubtful", cause=cause, file=file)
    if is_far:
        cause = "T_ref is wrong, or temperatures have another unit (K, °F) than °C"
        return stated(name, message, "doubtful", cause=cause, setting="T_ref")
    if low < -200.0 or high > 400.0:
        cause = "temperatures have another unit (K, °F) than °C"
        return stated(name, message, "doubtful", cause=cause, file=file)
    return stated(name, message, None, file=file)


def _part_in_kelvin(T: Floats) -> float | None:
    """Return the isotherm from which on temperatures are in kelvin, where the steps of the others say so."""
    T = np.unique(T)
    if T.size < 4:
        return None
    gaps = np.diff(T)
    at, usual = int(np.argmax(gaps)), float(np.median(gaps))
    goes_on = float(gaps[at]) - 273.15
    return float(T[at + 1]) if -0.5 * usual < goes_on < 2.5 * usual else None


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


def temperature_sweep(export: Export, isotherms: Sequence[Sweep]) -> Check:
    """Hold the readings between the isotherms, such as of a temperature sweep, against the isotherms."""
    name = "temperature sweep"
    taken = {int(row) for sweep in isotherms for row in sweep.rows}
    rest = np.array([row for row in np.flatnonzero(export.good) if row not in taken], int)
    sound = [s for s in isotherms if (s.values("storage_modulus") > 0).all() and (s.values("frequency") > 0).all()]
    T, f, G = (np.asarray(export.data[n].values[rest], float) for n in ("temperature", "frequency", "storage_modulus"))
    if rest.size < FEW_ROWS or len(sound) < 3 or not ((G > 0).all() and (f > 0).all()):
        return not_made(name, "a temperature sweep beside isotherms")
    sound.sort(key=lambda sweep: sweep.temperature)
    at = np.array([s.temperature for s in sound])
    logs = [(np.log(s.values("frequency")), np.log10(s.values("storage_modulus"))) for s in sound]
    seen = np.array([max(x[0] for x, _ in logs), min(x[-1] for x, _ in logs)])

    def apart(temperature: Floats) -> float:
        """Return by how much, of what is allowed, the median reading leaves the isotherms."""
        inside = (
            (temperature > at[0]) & (temperature < at[-1]) & (np.log(f) > seen[0] - 0.01) & (np.log(f) < seen[1] + 0.01)
        )
        if inside.sum() < FEW_ROWS:
            return np.inf
        gaps = []
        for t, x, y in zip(temperature[inside], np.log(f[inside]), np.log10(G[inside]), strict=True):
            levels = [np.interp(x, *log_) for log_ in logs]
            slopes = np.abs(np.diff(levels) / np.diff(at))
            place = min(max(int(np.searchsorted(at, t)) - 1, 0), slopes.size - 1)
            steepest = float(slopes[max(place - 1, 0) : place + 2].max())
            gaps.append(abs(y - np.interp(t, at, levels)) / (_OF_SWEEPS + _LAG * steepest))
        return float(np.median(gaps))

    own = apart(T)
    units = {"°F under °C": (T - 32.0) / 1.8, "K under °C": T - 273.15}
    meant = next((unit for unit, value in units.items() if apart(value) < 1.0), "")
    text = f"{export.place(int(rest[0]))}: {rest.size} readings of a temperature sweep"
    if own == np.inf and not meant:
        return not_made(name, "a temperature sweep over the temperatures of the isotherms")
    if own <= 1.0:
        return stated(name, f"{text} agree with the isotherms", None, file=export.name)
    cause = (
        f"the temperatures of the sweep are in {meant}"
        if meant
        else "the temperatures of the sweep are wrong, it was heated too fast, or the specimen was clamped anew"
    )
    return stated(name, f"{text} are not those of the isotherms", "doubtful", cause=cause, file=export.name)

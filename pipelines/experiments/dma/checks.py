"""Whether sweeps of a rheometer can be believed: redundant columns, causality, order with temperature."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from math import hypot, log, log10, pi, sqrt

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL, Check, Level, bounded, compared, not_made, stated
from labpipe.materials import isothermal_runs, modulus_factor, trusted_tables
from labpipe.report import quantity, value_with_uncertainty
from labpipe.workflow.context import Context
from pipelines.experiments.dma.measured import strain_of
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared import judgements
from pipelines.experiments.shared.judgements import Scene

_ROUNDED = 2e-3
"""Relative difference of the loss factor from the ratio of moduli, from exported digits."""
_STRESS = 0.25
"""How far stress over strain may be from the modulus: instruments correct for clamps and inertia."""
_POLYMERS = (3e4, 5e10)
"""Pa in tension: the stiffest reading of a polymer, from a gel to a fibre composite."""
_GLASS = 4e8  # Pa in tension, above which a polymer does not flow
_NU = 0.2  # lowest Poisson's ratio of a polymer that is no foam
_BULK = 1e10  # Pa, above the bulk modulus of any polymer
_LEAST_BULK = 1e8  # Pa, below that of any polymer without pores
_NU_OF_RUBBER = 5e-3  # u of a rubber's Poisson's ratio, at least
_OFF_SCALE = 2.0  # factor by which no specimen's dimensions are in doubt
_SPECIMENS = 3.0
"""Factor between moduli of two specimens of one polymer, of clamping and size at the worst."""
_SAME_PLACE = 2.0  # K, ln(frequency) 0.05: readings of one condition
_OUT = 0.5  # decades beyond its neighbours at which a reading stands alone
_MISTYPED = 1.6  # decades from which a single value is a slip, not noise
_ABOUT = 0.2  # decades within which neighbours tell by what power of ten a value is wrong
_RISE = 0.3  # decades of shift that hysteresis and ageing explain
_OWN = 0.005  # decades of modulus that drift, drying and clamping add to noise
_AGED = 0.02  # decades by which a specimen that was heated, or dried, between two sweeps may differ
_TRANSITION = 0.1  # decades of modulus per kelvin of the steepest glass transition
_STEP = 5.0  # K, of which set temperatures are multiples
_NEAR = 0.6  # K from a set temperature
_FEW = 20  # readings; more of them with one and the same temperature were not read from a sensor
_CONSTANT = 1.0  # K within which all temperatures are one
_FEW_LASTS = 5  # readings of an interval that tell how long one takes
_LAG = 5.0  # K by which a specimen may follow the air while that is heated steadily
_OF_SWEEPS = 0.05  # decades, by which a heated specimen's modulus may differ from that of the isotherms besides
_FEW_ROWS, _MOST = 4, 0.6  # readings, and share of them at one temperature, that make an isothermal interval
_SHARED, _SHARED_RANGE = 3, 0.05
"""Readings of each of two sweeps, and decades of loss factor, that both have where one modulus is told from another."""
_SLIPPED, _SLIPS_APART = 0.06, 6.0
"""Decades of modulus of a slip that is told, and times the scatter of the steps between other sweeps."""
_FOREIGN, _TORN = 0.25, 1.5
"""Share of the span of the shifts by which a table may differ, and times that residuals may grow:
batches and laboratories differ by less than that share, polymers by more; where readings hardly
tell the shifts, as of broad relaxations, a wrong table tears them little."""
_APART = "the material has two processes, or the specimen, its clamping or its temperature changed between sweeps"
_NAMES = {"storage_modulus": "storage modulus", "loss_modulus": "loss modulus"}
_FAILED = {
    "readings": "the file is not what the session says, or was not copied whole",
    "sweeps": "the exports hold no sweeps at several temperatures, or a column has the wrong unit",
    "master_curve": "T_ref, the temperatures or the moduli of the exports are wrong",
}


@dataclass(frozen=True, slots=True)
class _Export:
    """One export of a rheometer, with its trusted rows."""

    name: str
    data: xr.Dataset
    good: np.ndarray

    def values(self, name: str) -> Floats:
        """Return one column at trusted rows."""
        return np.asarray(self.data[name].values[self.good], float)

    def place(self, row: int) -> str:
        """Say where a row of the table stands."""
        parts = [
            f"{word} {int(self.data[key].values[row])}"
            for key, word in (("interval", "interval"), ("point", "point"))
            if key in self.data.variables
        ]
        return f"{self.name}, {', '.join(parts) if parts else f'row {row + 1}'}"


@dataclass(frozen=True, slots=True)
class _Sweep:
    """One isothermal sweep, in ascending order of frequency."""

    export: _Export
    rows: np.ndarray
    temperature: float

    @property
    def place(self) -> str:
        """Say where it stands in its file."""
        return self.export.place(int(self.rows[0])).rpartition(", point")[0] or self.export.name

    def values(self, name: str) -> Floats:
        """Return one of its columns."""
        return np.asarray(self.export.data[name].values[self.rows], float)


def judgement(
    readings: list[xr.Dataset | None] | None,
    sweeps: xr.Dataset | None,
    master_curve: xr.Dataset | None,
    published: xr.Dataset | None = None,
    *,
    settings: Dma,
    context: Context,
) -> xr.Dataset:
    """Judge the exports of one specimen; what gave no result is judged by that."""
    del sweeps
    exports = [
        _Export(name, data, _good(data))
        for name, data in zip(settings.rheometer, readings or (), strict=False)
        if data is not None and {"storage_modulus", "loss_modulus", "temperature", "frequency"} <= set(data)
    ]
    exports = [e for e in exports if e.good.any()]
    found = [list(_isotherms(e, settings)) for e in exports]
    checks = judgements.failed_steps(context, _FAILED)
    checks += [_poisson(settings), _bulk(exports, settings), _scale(settings)]
    for export, own in zip(exports, found, strict=True):
        checks += [
            _whole(export),
            _loss_factor(export),
            _frequencies(export),
            _stress(export),
            _modulus(export, settings),
            _signs(export),
            _mode(export, settings),
            _singles(export, own),
            _strayed(export, settings),
            _steady(export, settings),
            _slipped(export, own),
            _causal(export, own),
            _rising(export, own),
            _pasted(export, own),
            _heated(export, own),
        ]
    isotherms = sorted((s for own in found for s in own), key=lambda s: s.temperature)
    checks += [
        *_temperatures(exports, isotherms, settings),
        _softening(isotherms),
        _one_place(isotherms),
        *_files_alike(exports, found),
        _shifts(master_curve),
        _superposition(master_curve),
        _foreign(published, master_curve),
    ]
    return judgements.judgement(Scene(checks))


def _good(data: xr.Dataset) -> np.ndarray:
    good = np.zeros(data.sizes["sample"], bool)
    for table in trusted_tables(data):
        good[table.rows] = True
    return good


def _isotherms(export: _Export, settings: Dma) -> Iterator[_Sweep]:
    options = settings.sweeps
    for run in isothermal_runs(export.data, options.tolerance, options.fewest):
        rows = run.rows[export.good[run.rows]]
        if rows.size >= options.fewest:
            rows = rows[np.argsort(export.data["frequency"].values[rows], kind="stable")]
            yield _Sweep(export, rows, float(export.data["temperature"].values[rows].mean()))


def _factor(ratio: float, decades: float = 0.05) -> str:
    """Write a factor, as a power of ten where it is that within some decades."""
    power = log10(ratio)
    is_power = abs(power) > 0.5 and abs(power - round(power)) < decades
    return f"{10.0 ** round(power):g}" if is_power else f"{ratio:.3g}"


def _poisson(settings: Dma) -> Check:
    nu = settings.nu
    message = f"nu = {nu.value:g}, polymers have {_NU} to 0.5"
    name, law = "Poisson's ratio", "a polymer that is no foam hardly changes its volume"
    found = bounded(name, law, message, nu.value, max(nu.u, 1e-3), at_least=_NU, is_law=False, setting="nu")
    if found.level and 0.25 <= 10 * nu.value <= 0.5:
        return replace(found, cause=f"nu is probably {10 * nu.value:g}, not {nu.value:g}: its decimal point slipped")
    return found


def _bulk(exports: Sequence[_Export], settings: Dma) -> Check:
    """Hold Poisson's ratio against the modulus: a glass as incompressible as a rubber would be stiffer than metal."""
    name, law = "bulk modulus", "K = E/(3 (1 − 2ν)) of a polymer is a few GPa"
    sizes = [float(np.median(e.values("storage_modulus"))) for e in exports]
    if not sizes or not min(sizes) > 0:
        return not_made(name, law, "moduli")
    nu = settings.nu
    E, stiffest = (f(sizes) * modulus_factor(settings.mode, nu.value) * settings.scale.value for f in (min, max))
    most = 0.5 - E / (6 * _BULK)
    message = f"nu = {nu.value:g} at a modulus of {quantity(E, 'Pa')}, where polymers have {max(most, _NU):.3g} at most"
    found = bounded(name, law, message, nu.value, max(nu.u, 1e-3), at_most=max(most, _NU), is_law=False, setting="nu")
    if found.level:
        return replace(found, cause="nu is that of a rubber, or the unit of the moduli is wrong")
    least = 0.5 - stiffest / (6 * _LEAST_BULK)
    if (
        nu.value >= least or _POLYMERS[0] > stiffest
    ):  # softer than any polymer: the unit is wrong, as its own check says
        return found
    message = f"nu = {nu.value:g} at a modulus of {quantity(stiffest, 'Pa')}, where polymers have {least:.3g} at least"
    u = max(nu.u, _NU_OF_RUBBER)
    found = bounded(name, law, message, nu.value, u, at_least=least, is_law=False, setting="nu")
    return replace(found, cause="nu is that of a glass, or the unit of the moduli is wrong") if found.level else found


def _scale(settings: Dma) -> Check:
    name, law = "scale of the moduli", "a specimen's dimensions are known far better than to a factor 2"
    scale = settings.scale.value
    is_far = abs(log(scale)) > log(_OFF_SCALE)
    cause = ""
    if is_far and abs(log10(scale) - round(log10(scale))) > 0.02:
        cause = "scale is mistyped: it corrects the specimen's dimensions alone"
    elif is_far:
        cause = "scale is probably 1: its decimal point slipped, or it was taken for a unit"
    text = f"all moduli are multiplied by {scale:g}"
    return stated(name, law, text, "doubtful" if is_far else None, cause=cause, setting="scale")


def _loss_factor(export: _Export) -> Check:
    name, law = "loss factor", "the loss factor is the loss over the storage modulus"
    if "loss_factor" not in export.data:
        return not_made(name, law, "a column of the loss factor")
    storage, loss = export.values("storage_modulus"), export.values("loss_modulus")
    # what is not positive is told by another check
    ratio = np.divide(loss, storage, out=np.zeros_like(loss), where=storage > 0)
    told = export.values("loss_factor")
    known = np.isfinite(told) & (told > 0) & (ratio > 0)
    if not known.any():
        return not_made(name, law, "loss factors")
    apart = np.log(told[known] / ratio[known])
    middle, file = float(np.median(apart)), export.name
    ours, theirs = float(np.median(ratio[known])), float(np.median(told[known]))
    message = f"{file}: the column says {theirs:.3g}, the moduli give {ours:.3g} (medians)"
    found = compared(name, law, message, theirs, _ROUNDED * theirs, theirs / np.exp(middle).item(), 0.0, file=file)
    if found.level is None or abs(middle) < 0.05:
        wrong = np.flatnonzero(np.abs(apart) > 0.1)
        if not wrong.size:
            return replace(found, level=None)
        worst = int(wrong[np.argmax(np.abs(apart[wrong]))])
        row = int(np.flatnonzero(export.good)[np.flatnonzero(known)[worst]])
        times = float(np.exp(abs(apart[worst])))
        text = f"{export.place(row)}: the loss factor and the moduli differ by a factor {_factor(times)}"
        more = f"; {wrong.size} rows in all" if wrong.size > 1 else ""
        cause = f"a value of this row is wrong by a factor {_factor(times)}"
        level: Level = "impossible" if times > 2.0 else "doubtful"
        return stated(name, law, text + more, level, cause=cause, file=file)
    cause = f"one modulus, or the loss factor, has the wrong unit: a factor {_factor(np.exp(middle).item())}"
    if float(np.median(np.abs(np.log(told[known] * ratio[known])))) < 0.02:
        cause = "the columns of storage and loss modulus are exchanged"
    return replace(found, cause=cause)


def _whole(export: _Export) -> Check:
    """Repeat what the reader noticed about rows and cells that are not there."""
    name, law = "whole file", "an export holds the points that it declares"
    notes = json.loads(str(export.data.attrs.get("notes", "[]")))
    missing = [text for text in notes if "declares" in text and "holds" in text]
    if not missing:
        return stated(name, law, f"{export.name}: nothing is missing", None, file=export.name)
    more = f"; {len(missing)} such intervals" if len(missing) > 1 else ""
    line = re.search(r"line (\d+)", missing[0])
    return stated(
        name,
        law,
        f"{export.name}: {missing[0]}{more}",
        "doubtful",
        cause="the test was stopped, or the file was cut: copy it again from the rheometer",
        file=export.name,
        line=int(line[1]) if line else None,
    )


def _strayed(export: _Export, settings: Dma) -> Check:
    """Look for single readings whose temperature is not that of their interval."""
    name, law = "temperature within an interval", "a specimen warms through in minutes, not between two readings"
    T = np.asarray(export.data["temperature"].values, float)
    worst, at = 0.0, -1
    for own in _intervals(export):
        apart = np.abs(T[own] - np.median(T[own]))
        if own.size >= _FEW_ROWS and (apart <= settings.sweeps.tolerance).mean() >= _MOST and apart.max() > worst:
            worst, at = float(apart.max()), int(own[np.argmax(apart)])
    if at < 0:
        return not_made(name, law, "a column of intervals, one of them at one temperature")
    text = f"{export.place(at)}: {T[at]:.1f} °C, {worst:.1f} K beside the others of its interval"
    if worst <= 3 * settings.sweeps.tolerance:
        return stated(name, law, text, None, file=export.name)
    cause = "the temperature of this reading is mistyped, or the sensor had a fault: the reading is left out"
    return stated(name, law, text, "doubtful", cause=cause, file=export.name)


def _steady(export: _Export, settings: Dma) -> Check:
    """Look for the sweep over frequencies during which the temperature moves most."""
    name, law = "temperature during a sweep", "a specimen that was given its time has one temperature in a sweep"
    drifts = []
    for rows in _intervals(export):
        frequency, T = (np.asarray(export.data[n].values[rows], float) for n in ("frequency", "temperature"))
        # a ramp repeats its frequencies at other temperatures, a sweep has each of them once
        if rows.size >= _FEW_ROWS and np.unique(np.round(np.log10(np.maximum(frequency, 1e-9)), 3)).size == rows.size:
            at = np.arange(rows.size) - 0.5 * (rows.size - 1)
            # between medians of its parts: a single reading that strays is another check
            half = rows.size // 3
            moved = float(np.median(T[-half:]) - np.median(T[:half])) * (rows.size - 1) / float(at[-1] * 2 - half + 1)
            drifts.append((abs(moved), moved, int(rows[0])))
    if not drifts:
        return not_made(name, law, "an interval over several frequencies")
    size, moved, row = max(drifts)
    place = export.place(row).rpartition(", point")[0] or export.name
    text = f"{place}: the temperature moves by {moved:+.1f} K from its first reading to its last"
    level: Level | None = "doubtful" if size > 2 * settings.sweeps.tolerance else None
    cause = "the specimen was still warming or cooling: its readings belong to several temperatures; wait longer"
    return stated(name, law, text, level, cause=cause if level else "", file=export.name)


def _intervals(export: _Export) -> list[np.ndarray]:
    """Return the trusted rows of every interval; none where no column tells intervals."""
    keys = [key for key in ("test", "result", "interval") if key in export.data.variables]
    if not keys:
        return []
    labels = np.stack([np.asarray(export.data[key].values) for key in keys], axis=1)[export.good]
    rows = np.flatnonzero(export.good)
    return [rows[(labels == label).all(axis=1)] for label in np.unique(labels, axis=0)]


def _slipped(export: _Export, isotherms: Sequence[_Sweep]) -> Check:
    """Look for the interval from which on all moduli are smaller or larger by one factor.

    Over the modulus, the loss angle of all sweeps is one curve, wherever time and temperature put
    them (van Gurp & Palmen, Rheol. Bull. 67 (1998) 5): a factor shifts a part of it.
    """
    name, law = "one specimen throughout", "the loss factor over the modulus goes on from sweep to sweep"
    # in the order in which they were measured: a slip stays
    sweeps = sorted(isotherms, key=lambda sweep: int(sweep.rows[0]))
    found = [(gap, a, b) for a, b in pairwise(sweeps) if (gap := _offset(a, b)) is not None]
    if len(found) < _FEW_ROWS:
        return not_made(name, law, f"{_FEW_ROWS + 1} sweeps that overlap, on a slope of the loss factor")
    steps, u = np.array([gap for gap, _, _ in found]).T
    # a little is common to all of them: moduli of a rubber go with temperature, densities against it
    others = [np.delete(steps, i) for i in range(steps.size)]
    usual = np.array([np.median(rest) for rest in others])
    scatter = np.array([np.median(np.abs(rest - np.median(rest))) / 0.6745 for rest in others])
    total = np.hypot(np.hypot(u, _OWN), scatter)
    worst = int(np.argmax(np.abs(steps - usual) / total))
    step, (_, a, b) = float(steps[worst] - usual[worst]), found[worst]
    text = (
        f"from {a.place} to {b.place} the moduli change by a factor {10.0 ** float(steps[worst]):.3g} at one loss "
        f"factor, from sweep to sweep of the others by {10.0 ** float(usual[worst]):.3g}"
    )
    is_off = abs(step) > _SLIPPED and abs(step) > _SLIPS_APART * total[worst]
    cause = f"the specimen slipped in its clamp, cracked or was clamped anew before {b.place}"
    level: Level | None = "doubtful" if is_off else None
    return stated(name, law, text, level, cause=cause if is_off else "", file=export.name)


def _offset(a: _Sweep, b: _Sweep) -> tuple[float, float] | None:
    """Return by how many decades the modulus of a sweep lies from that of the one before at one loss factor, with u."""
    x, y, own = [], [], []
    for number, sweep in enumerate((a, b)):
        storage, loss = sweep.values("storage_modulus"), sweep.values("loss_modulus")
        if not ((storage > 0) & (loss > 0)).all():
            return None
        x.append(np.log10(np.hypot(storage, loss)))
        y.append(np.log10(loss / storage))
        own.append(np.full(storage.size, float(number)))
    # only where both have the loss factors of the other, and both change steadily
    low, high = max(part.min() for part in y), min(part.max() for part in y)
    shared = [(part >= low) & (part <= high) for part in y]
    if min(int(part.sum()) for part in shared) < _SHARED or high - low < _SHARED_RANGE:
        return None
    keep = np.concatenate(shared)
    X, Y, second = np.concatenate(x)[keep], np.concatenate(y)[keep], np.concatenate(own)[keep]
    _, gap, u = _apart_of(Y, X, second)
    slope, rise, _ = _apart_of(X, Y, second)
    # Where the loss factor hardly changes, or turns, its noise makes the two regressions disagree.
    other = -rise / slope if slope else np.inf
    return gap, hypot(u, gap - other)


def _apart_of(x: Floats, y: Floats, second: Floats) -> tuple[float, float, float]:
    """Return the slope of y over x, by how much y of the second sweep lies higher, and its u."""
    at = x - x.mean()
    design = np.stack([np.ones_like(at), at, at**2, second], axis=1)
    fit = np.linalg.lstsq(design, y, rcond=None)[0]
    left = y - design @ fit
    variance = float(left @ left) / max(left.size - 4, 1)
    u = float(np.sqrt(variance * np.linalg.pinv(design.T @ design)[3, 3]))
    return float(fit[1]), float(fit[3]), u


def _frequencies(export: _Export) -> Check:
    """Hold frequencies against the other column, and against the time a reading takes."""
    name, law = "frequency", "a reading of an oscillation takes about a period at least; ω = 2πf"
    file, data = export.name, export.data
    if (lowest := float(export.values("frequency").min())) <= 0.0:
        text = f"{file}: a frequency of {lowest:.4g} Hz"
        cause = "another column stands under the name of the frequency, such as the temperature"
        return stated(name, law, text, "impossible", cause=cause, file=file)
    if data.attrs.get("derived", "-") == "" and "angular_frequency" in data:
        omega, hertz = export.values("angular_frequency"), export.values("frequency")
        known = (omega > 0) & (hertz > 0)
        if known.any():
            ratio = float(np.median(omega[known] / hertz[known]))
            message = f"{file}: angular frequency over frequency is {ratio:.4g}, expected 2π"
            found = compared(name, law, message, ratio, 0.01, 2 * pi, 0.0, file=file)
            return replace(found, cause="one column of frequency has the unit of the other (Hz, rad/s)")
    hertz = export.values("frequency")
    levels = np.unique(np.round(hertz[hertz > 0], 6))
    if levels.size >= 2 and data.attrs.get("derived") != "frequency" and _is_turned(levels):
        message = f"{file}: frequencies of {levels[-1]:.5g} to {levels[0]:.5g} Hz are 2π times round ones"
        cause = "the column of frequency holds rad/s under Hz: a factor 6.28"
        return stated(name, law, message, "doubtful", cause=cause, file=file)
    if "time" not in data:
        return not_made(name, law, "a column of time, or both frequencies")
    # each table by itself: the readings of a temperature sweep wait many periods for the heat
    shortest = min(_periods(data), default=None)
    if shortest is None:
        return not_made(name, law, f"times of {_FEW_LASTS} readings of an interval")
    periods, place = shortest[0], export.place(shortest[1]).rpartition(", point")[0] or file
    message = f"{place}: readings take {periods:.2g} periods at most"
    level: Level | None = "doubtful" if periods < 0.7 else None
    cause = "frequencies are too low for their times: Hz under rad/s (a factor 6.28), or times in another unit"
    return stated(name, law, message, level, cause=cause, file=file)


def _periods(data: xr.Dataset) -> Iterator[tuple[float, int]]:
    """Yield how many periods nearly every reading of an interval takes at most, and its first row."""
    keys = [key for key in ("interval", "test", "result") if key in data.variables]
    label = np.zeros(data.sizes["sample"], np.int64)
    for key in keys:
        label[1:] += np.cumsum(data[key].values[1:] != data[key].values[:-1])
    # a reading that begins a table has no beginning of its own
    lasts = np.diff(data["time"].values) * data["frequency"].values[1:]
    is_known = (np.diff(label) == 0) & np.isfinite(lasts) & (lasts > 0)
    for interval in np.unique(label):
        own = lasts[is_known & (label[1:] == interval)]
        if own.size >= _FEW_LASTS:
            yield float(np.quantile(own, 0.9)), int(np.argmax(label == interval))


def _is_turned(levels: Floats) -> bool:
    """Tell whether both end frequencies are 2 pi times a round one, and not round themselves."""

    def is_round(value: float) -> bool:
        mantissa = value / 10.0 ** np.floor(log10(value))
        return min(abs(mantissa / k - 1) for k in (1.0, 2.0, 5.0, 10.0)) < 5e-4

    ends = (float(levels[0]), float(levels[-1]))
    return all(is_round(f / (2 * pi)) and not is_round(f) for f in ends)


def _stress(export: _Export) -> Check:
    name, law = "stress over strain", "the modulus is the amplitude of stress over that of strain"
    if "strain" not in export.data or "stress" not in export.data:
        return not_made(name, law, "columns of stress and strain")
    size = np.hypot(export.values("storage_modulus"), export.values("loss_modulus"))
    strain, stress = export.values("strain"), export.values("stress")
    known = (strain > 0) & (stress > 0) & (size > 0)
    if not known.any():
        return not_made(name, law, "stresses and strains")
    apart = np.log(size[known] * strain[known] / stress[known])
    ratio = float(np.exp(np.median(apart)))
    expected = float(np.median(stress[known] / strain[known]))
    file = export.name
    message = f"{file}: moduli are {_factor(ratio)} times stress over strain ({quantity(expected, 'Pa')})"
    found = compared(name, law, message, ratio, 0.02 * ratio, 1.0, 0.02, allowance=_STRESS, file=file)
    power = round(log10(ratio))
    thousands = {-3: "kPa stand as Pa, or GPa as MPa", 3: "Pa stand as kPa, or MPa as GPa"}
    unit = {-6: "MPa stand as Pa", 6: "Pa stand as MPa", **thousands}.get(power)
    if unit is not None and abs(log10(ratio) - power) < 0.1:
        return replace(found, cause=f"the unit of the moduli is wrong by a factor {10.0**power:g}: {unit}")
    cause = f"the unit of the moduli, of stress or of strain is wrong: a factor {_factor(ratio)}"
    return replace(found, cause=cause)


def _modulus(export: _Export, settings: Dma) -> Check:
    name, law = "modulus of a polymer", "the stiffest reading of a polymer is between those of a gel and a fibre"
    size = np.hypot(export.values("storage_modulus"), export.values("loss_modulus"))
    if not (size > 0).any():
        return not_made(name, law, "moduli")
    stiffest = float(np.quantile(size[size > 0], 0.95)) * modulus_factor(settings.mode, settings.nu.value)
    message = f"{export.name}: the stiffest readings are {quantity(stiffest, 'Pa')} in tension"
    low, high = map(log10, _POLYMERS)
    found = bounded(
        name, law, message, log10(stiffest), 0.02, at_least=low, at_most=high, is_law=False, file=export.name
    )
    cause = "moduli in MPa stand as Pa" if stiffest < _POLYMERS[0] else "moduli in Pa stand as kPa, MPa or GPa"
    return replace(found, cause=f"the unit of the moduli is wrong: {cause}")


def _signs(export: _Export) -> Check:
    name, law = "signs of the moduli", "a solid stores and dissipates: both moduli are positive"
    share = float(np.mean((export.values("storage_modulus") <= 0) | (export.values("loss_modulus") <= 0)))
    message = f"{export.name}: {share * 100:.2g} % of the readings are not positive"
    level: Level | None = "impossible" if share > 0.5 else "doubtful" if share > 0.2 else "note" if share else None
    cause = "the instrument's phase is wrong, or another column stands under the modulus"
    return stated(name, law, message, level, cause=cause, file=export.name)


def _mode(export: _Export, settings: Dma) -> Check:
    """Hold the mode against the heading of the strain, where the export has one that tells."""
    name, law = "mode of loading", "what was loaded in torsion has a shear strain"
    seen = strain_of(export.data)
    if not seen:
        return not_made(name, law, "a heading that says shear or extensional strain")
    is_shear = seen == "shear"
    expects_shear = settings.mode in ("shear", "torsion")
    message = f'{export.name} has a column "{seen} strain", session.toml says mode = "{settings.mode}"'
    should = "torsion or shear" if is_shear else "tension or bending"
    factor = 2 * (1 + settings.nu.value)
    cause = f"mode is probably {should}, not {settings.mode}: moduli are a factor {factor:.3g} off"
    level: Level | None = "doubtful" if is_shear != expects_shear else None
    return stated(name, law, message, level, cause=cause, setting="mode")


def _singles(export: _Export, isotherms: Sequence[_Sweep]) -> Check:
    """Look for a value that lies decades beyond both of its neighbours in frequency."""
    name, law = "single values", "a modulus changes steadily with frequency"
    if not isotherms:
        return not_made(name, law, "isothermal sweeps")
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
        return stated(name, law, f"{export.name}: no value beyond its neighbours", None, file=export.name)
    factor, where = worst
    text = f"{where} is a factor {_factor(factor)} from its neighbours in frequency"
    level: Level = "impossible" if abs(log10(factor)) > _MISTYPED else "doubtful"
    cause = f"{where} is wrong by a factor {_factor(factor, _ABOUT)}"
    return stated(name, law, text, level, cause=cause, file=export.name)


def _alone(y: Floats) -> Floats:
    """Return by how much every value lies beyond the range of its four nearest (two at ends)."""
    found = np.zeros(y.size)
    for i in range(y.size):
        near = [j for j in (i - 2, i - 1, i + 1, i + 2) if 0 <= j < y.size]
        around = y[near]
        middle = float(np.median(around))
        # a steep end of a sweep goes on as it comes
        reach = 2.0 * float(np.median(np.abs(np.diff(y)))) * (1 + abs(len(near) - 4))
        beyond = abs(y[i] - middle) - reach
        if beyond > 0:
            found[i] = np.copysign(abs(y[i] - middle), y[i] - middle)
    return found


def _causal(export: _Export, isotherms: Sequence[_Sweep]) -> Check:
    """Hold the loss against the rise of the storage modulus with frequency.

    E* ~ (i omega)^b has tan delta = tan(pi b / 2), the local form of Kramers and Kronig's relation
    (Booij & Thoone, Rheol. Acta 21 (1982) 15, doi:10.1007/BF01520701).
    """
    name, law = "storage and loss belong together", "Kramers and Kronig: tan δ ≈ tan(π/2 · d ln E′/d ln ω)"
    pairs = [p for p in map(_slopes, isotherms) if p is not None]
    if not pairs:
        return not_made(name, law, "sweeps of four frequencies over a decade")
    loss, rise, swapped = np.array(pairs).T
    ours = float(np.median(np.abs(np.log(loss / rise))))
    theirs = float(np.median(np.abs(np.log(1 / loss / swapped))))
    middle = float(np.median(loss))
    message = (
        f"{export.name}: tan δ is {middle:.3g}, the rise with frequency says {float(np.median(rise)):.3g} (medians)"
    )
    if ours > log(3.0) and theirs < 0.5 * ours and middle > 1.0:
        cause = "the columns of storage and loss modulus are exchanged"
        return stated(name, law, message, "impossible", cause=cause, file=export.name)
    level: Level | None = "doubtful" if ours > log(10.0) else "note" if ours > log(5.0) else None
    cause = "one of the moduli has another unit than the other, or the phase is wrong"
    return stated(name, law, message, level, cause=cause, file=export.name)


def _pasted(export: _Export, isotherms: Sequence[_Sweep]) -> Check:
    """Look for readings of one interval that are those of another, digit by digit."""
    name, law = "readings of another interval", "noise makes no two sweeps alike"
    if len(isotherms) < 2:
        return not_made(name, law, "two sweeps")
    for a, b in combinations(isotherms, 2):
        pairs = [np.column_stack([s.values("storage_modulus"), s.values("loss_modulus")]) for s in (a, b)]
        if pairs[0].shape != pairs[1].shape:
            continue
        same = int((pairs[0] == pairs[1]).all(axis=1).sum())
        if same >= max(_FEW_ROWS, _MOST * len(pairs[0])):
            text = f"{b.place}: {same} of {len(pairs[0])} readings are those of {a.place}, digit by digit"
            cause = "moduli of one interval were copied into another, or an interval was exported twice"
            return stated(name, law, text, "doubtful", cause=cause, file=export.name)
    return stated(name, law, f"{export.name}: no sweep equals another", None, file=export.name)


def _rising(export: _Export, isotherms: Sequence[_Sweep]) -> Check:
    """Look for a sweep whose storage modulus falls as the frequency rises: its rows stand in another order."""
    name, law = "rise with frequency", "a relaxation spectrum is positive: the storage modulus rises with frequency"
    worst: tuple[float, float, _Sweep] | None = None
    for sweep in isotherms:
        x, storage = np.log10(sweep.values("frequency")), sweep.values("storage_modulus")
        if x.size < 4 or np.ptp(x) < 0.5 or not (storage > 0).all():
            continue
        y = np.log10(storage)
        # the steps from reading to reading say how far they scatter about any curve
        slope, level = np.polyfit(x, y, 1)
        rest = y - level - slope * x
        u = hypot(float(np.sqrt(np.sum(rest**2) / (x.size - 2) / np.sum((x - x.mean()) ** 2))), _OWN / float(np.ptp(x)))
        if worst is None or slope / u < worst[0] / worst[1]:
            worst = float(slope), u, sweep
    if worst is None:
        return not_made(name, law, "sweeps of four frequencies over half a decade")
    slope, u, sweep = worst
    text = (
        f"{sweep.place}: at {sweep.temperature:.1f} °C the storage modulus changes by {slope:+.3f} decades per decade"
    )
    check = bounded(name, law, text, slope, u, at_least=0.0, is_law=False, file=export.name)
    cause = f"frequencies and moduli of {sweep.place} stand in opposite order, or the instrument resonates"
    return replace(check, cause=cause) if check.level else check


def _slopes(sweep: _Sweep) -> tuple[float, float, float] | None:
    """Return the loss factor, that from the rise of the storage, and that were both exchanged."""
    x = np.log(sweep.values("frequency"))
    storage, loss = sweep.values("storage_modulus"), sweep.values("loss_modulus")
    if x.size < 4 or np.ptp(x) < log(10.0) or not ((storage > 0) & (loss > 0)).all():
        return None
    found = []
    for y in (np.log(storage), np.log(loss)):
        slope = float(np.polyfit(x, y, 1)[0])
        found.append(float(np.tan(0.5 * pi * min(max(slope, 2e-3), 0.98))))
    return float(np.exp(np.median(np.log(loss / storage)))), found[0], found[1]


def _temperatures(exports: Sequence[_Export], isotherms: Sequence[_Sweep], settings: Dma) -> Iterator[Check]:
    for export in exports:
        yield _range(export, [s.temperature for s in isotherms if s.export is export], settings)
    name, law = "temperature is measured", "moduli change with temperature alone"
    for export in exports:
        T, repeated = export.values("temperature"), _repeated(export)
        if np.ptp(T) > _CONSTANT or repeated is None:
            yield stated(name, law, f"{export.name}: temperatures span {np.ptp(T):.1f} K", None)
            continue
        times, count = repeated
        text = (
            f"{export.name}: all temperatures are {T.mean():.1f} °C, while the storage modulus differs "
            f"by a factor {times:.3g} between {count} readings at one frequency"
        )
        is_read = np.ptp(T) > 0.0 or T.size < _FEW
        level: Level | None = "doubtful" if times > 1.2 else None
        if times > (2.0 if is_read else 1.2):
            level = "impossible"
        cause = "the column of temperature is constant: it holds the setting, or the sensor was not read"
        yield stated(name, law, text, level, cause=cause, file=export.name)


def _repeated(export: _Export) -> tuple[float, int] | None:
    """Return by how much the storage modulus differs at the commonest frequency, and of how many readings."""
    level = np.round(np.log10(np.maximum(export.values("frequency"), 1e-9)), 2)
    found, counts = np.unique(level, return_counts=True)
    same = export.values("storage_modulus")[level == found[np.argmax(counts)]]
    if same.size < 3 or not (same > 0).all():
        return None
    return float(same.max() / same.min()), int(same.size)


def _range(export: _Export, isotherms: Sequence[float], settings: Dma) -> Check:
    name, law = "temperatures", "polymers are tested between −200 and 400 °C, about the reference temperature"
    T = export.values("temperature")
    low, high, file = float(T.min()), float(T.max()), export.name
    message = f"{file}: temperatures from {low:.1f} to {high:.1f} °C"
    wanted = None if settings.T_ref is None else settings.T_ref.value
    if wanted is not None:
        message += f", T_ref is {wanted:g} °C"
    if low < -273.15:
        return stated(name, law, message, "impossible", cause="the unit of temperature is wrong", file=file)
    is_far = wanted is not None and not low - 30 <= wanted <= high + 30
    kelvin = low > 180.0 and (wanted is None or is_far or high > 350.0)
    if kelvin and (wanted is None or low - 303.15 <= wanted <= high - 243.15):
        cause = f"temperatures are in K under °C: {low - 273.15:.1f} to {high - 273.15:.1f} °C are meant"
        return stated(name, law, message, "impossible" if is_far else "doubtful", cause=cause, file=file)
    if _is_fahrenheit(np.asarray(isotherms)):
        celsius = (low - 32) / 1.8, (high - 32) / 1.8
        message += f"; in °F the isotherms are multiples of {_STEP:g} °C"
        cause = f"temperatures are in °F under °C: {celsius[0]:.1f} to {celsius[1]:.1f} °C are meant"
        return stated(name, law, message, "doubtful", cause=cause, file=file)
    if (part := _part_in_kelvin(np.asarray(isotherms))) is not None:
        message += f"; without 273.15 K those from {part:.1f} °C on go on from the others"
        cause = f"temperatures from {part:.1f} on are in K under °C: {part - 273.15:.1f} °C and more are meant"
        return stated(name, law, message, "doubtful", cause=cause, file=file)
    if is_far:
        cause = "T_ref is wrong, or temperatures have another unit (K, °F) than °C"
        return stated(name, law, message, "doubtful", cause=cause, setting="T_ref")
    if low < -200.0 or high > 400.0:
        cause = "temperatures have another unit (K, °F) than °C"
        return stated(name, law, message, "doubtful", cause=cause, file=file)
    return stated(name, law, message, None, file=file)


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


def _softening(isotherms: Sequence[_Sweep]) -> Check:
    """Look for the isotherm that breaks the fall of the modulus with temperature."""
    name, law = "order with temperature", "at one frequency a polymer softens as it is heated"
    levels = _levels(isotherms)
    if levels is None:
        return not_made(name, law, "three isotherms over common frequencies")
    T, level = np.array([s.temperature for s in isotherms]), levels
    rise = _broken(T, level)
    if rise == 0.0:
        return stated(name, law, f"{T.size} isotherms in order", None)
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
        text = f"the modulus rises by a factor {times:.3g} from {T[at]:.1f} to {T[at + 1]:.1f} °C"
        file = isotherms[at + 1].export.name
        cause = "a specimen that crystallised or dried, one of another material, or temperatures in wrong order"
        return stated(
            name, law, text, "doubtful" if rise > 0.15 else "note" if rise > 4 * _OWN else None, cause=cause, file=file
        )
    found: Level | None = "impossible" if rise > 10 * _OWN else "doubtful" if rise > 4 * _OWN else None
    return stated(name, law, text, found, cause=cause, file=file)


def _misplaced(isotherms: Sequence[_Sweep], level: Floats, at: int) -> tuple[str, str]:
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


def _levels(isotherms: Sequence[_Sweep]) -> Floats | None:
    """Return the mean log10 of every isotherm's modulus over the frequencies that all have."""
    if len(isotherms) < 3:
        return None
    low = max(float(s.values("frequency")[0]) for s in isotherms)
    high = min(float(s.values("frequency")[-1]) for s in isotherms)
    if not 0 < low < high:
        return None
    x = np.linspace(log(low), log(high), 7)
    found = []
    for s in isotherms:
        storage = s.values("storage_modulus")
        if not (storage > 0).all():
            return None
        found.append(float(np.median(np.interp(x, np.log(s.values("frequency")), np.log10(storage)))))
    return np.array(found)


def _roughness(T: Floats, level: Floats) -> float:
    """Return the residual of a parabola through levels over temperature."""
    degree = min(2, np.unique(T).size - 2)
    if degree < 0:
        return float(np.sum((level - level.mean()) ** 2))
    return float(np.sum((level - np.polynomial.Polynomial.fit(T, level, degree)(T)) ** 2))


def _broken(T: Floats, level: Floats) -> float:
    """Return the decades by which moduli rise from isotherm to isotherm beyond entropic elasticity."""
    entropic = np.log10((T[1:] + 273.15) / (T[:-1] + 273.15))
    rise = np.diff(level) - np.where(level[1:] < 8.0, 1.5 * entropic, 0.0) - _OWN
    return float(np.sum(np.maximum(rise, 0.0)))


def _one_place(isotherms: Sequence[_Sweep]) -> Check:
    """Hold sweeps that repeat a temperature against each other."""
    name, law = "repeated temperatures", "a repeated sweep gives the moduli of the first"
    slope = _steepest(isotherms)
    worst: tuple[float, float, _Sweep, _Sweep] | None = None
    for a, b in combinations(isotherms, 2):
        # between files it is another check
        if a.export is b.export and abs(a.temperature - b.temperature) <= _SAME_PLACE:
            apart = _apart(a, b)
            if apart is not None:
                gap, u = apart
                beyond = abs(gap) - slope * abs(a.temperature - b.temperature)
                u = hypot(u, sqrt(2.0) * _OWN)
                worst = max(worst or (beyond, u, a, b), (beyond, u, a, b), key=lambda w: w[0] / w[1])
    if worst is None:
        return not_made(name, law, "a temperature that is repeated")
    beyond, u, a, b = worst
    factor = 10.0 ** max(beyond, 0.0)
    text = (
        f"{a.place} and {b.place} at {a.temperature:.1f} °C differ by a factor "
        f"{value_with_uncertainty(factor, factor * (10.0**u - 1), '1')}"
    )
    is_apart = beyond > DOUBTFUL * u
    level: Level | None = None if not is_apart else "doubtful" if beyond > _AGED else "note"
    cause = f"the temperature of {a.place} or {b.place} is wrong, or the specimen changed between them"
    return stated(name, law, text, level, cause=cause, file=a.export.name)


def _heated(export: _Export, isotherms: Sequence[_Sweep]) -> Check:
    """Hold the readings between the isotherms, such as of a temperature sweep, against the isotherms."""
    name, law = "temperature sweep", "while it is heated a specimen has the moduli of its isotherms"
    taken = {int(row) for sweep in isotherms for row in sweep.rows}
    rest = np.array([row for row in np.flatnonzero(export.good) if row not in taken], int)
    sound = [s for s in isotherms if (s.values("storage_modulus") > 0).all() and (s.values("frequency") > 0).all()]
    T, f, G = (np.asarray(export.data[n].values[rest], float) for n in ("temperature", "frequency", "storage_modulus"))
    if rest.size < _FEW_ROWS or len(sound) < 3 or not ((G > 0).all() and (f > 0).all()):
        return not_made(name, law, "a temperature sweep beside isotherms")
    sound.sort(key=lambda sweep: sweep.temperature)
    at = np.array([s.temperature for s in sound])
    logs = [(np.log(s.values("frequency")), np.log10(s.values("storage_modulus"))) for s in sound]
    seen = np.array([max(x[0] for x, _ in logs), min(x[-1] for x, _ in logs)])

    def apart(temperature: Floats) -> float:
        """Return by how much, of what is allowed, the median reading leaves the isotherms."""
        inside = (
            (temperature > at[0]) & (temperature < at[-1]) & (np.log(f) > seen[0] - 0.01) & (np.log(f) < seen[1] + 0.01)
        )
        if inside.sum() < _FEW_ROWS:
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
        return not_made(name, law, "a temperature sweep over the temperatures of the isotherms")
    if own <= 1.0:
        return stated(name, law, f"{text} agree with the isotherms", None, file=export.name)
    cause = (
        f"the temperatures of the sweep are in {meant}"
        if meant
        else "the temperatures of the sweep are wrong, it was heated too fast, or the specimen was clamped anew"
    )
    return stated(name, law, f"{text} are not those of the isotherms", "doubtful", cause=cause, file=export.name)


def _steepest(isotherms: Sequence[_Sweep]) -> float:
    """Return the steepest change of the modulus over temperature [decades/K], at most that of a glass transition."""
    levels = _levels(isotherms)
    if levels is None:
        return _TRANSITION
    T = np.array([s.temperature for s in isotherms])
    far = np.diff(T) > _SAME_PLACE
    steps = np.abs(np.diff(levels)[far] / np.diff(T)[far])
    return min(float(steps.max()), _TRANSITION) if steps.size else _TRANSITION


def _apart(a: _Sweep, b: _Sweep) -> tuple[float, float] | None:
    """Return the median log10 ratio of the storage moduli of two sweeps over common frequencies, and its u."""
    fa, fb = a.values("frequency"), b.values("frequency")
    low, high = max(fa[0], fb[0]), min(fa[-1], fb[-1])
    ya, yb = a.values("storage_modulus"), b.values("storage_modulus")
    if not low < high or not ((ya > 0).all() and (yb > 0).all()):
        return None
    x = np.linspace(log(low), log(high), 7)
    gap = np.interp(x, np.log(fa), np.log10(ya)) - np.interp(x, np.log(fb), np.log10(yb))
    # median of noise: pi/2 of the mean's variance; the gap may turn steadily with frequency
    rest = gap - np.polynomial.Polynomial.fit(x, gap, 1)(x)
    return float(np.median(gap)), float(np.sqrt(0.5 * pi * np.mean(rest**2) / (x.size - 2)))


def _files_alike(exports: Sequence[_Export], found: Sequence[Sequence[_Sweep]]) -> Iterator[Check]:
    name, law = "files of one specimen", "one polymer has one modulus at one temperature and frequency"
    if len(exports) < 2:
        return
    for (a, own), (b, other) in combinations(list(zip(exports, found, strict=True)), 2):
        if _is_copy(a, b):
            text = f"{b.name} holds the same values as {a.name}"
            cause = "a copy was taken for a repeat"
            yield stated("same values twice", "repeats differ by noise", text, "doubtful", cause=cause, file=b.name)
            continue
        gaps = [
            apart[0]
            for s in own
            for t in other
            if abs(s.temperature - t.temperature) <= 2 * _SAME_PLACE and (apart := _apart(s, t)) is not None
        ]
        if not gaps:
            yield not_made(name, law, f"isotherms that {a.name} and {b.name} share")
            continue
        gap = float(np.median(gaps))
        size = float(np.max(np.abs(gaps)))
        text = f"{a.name} over {b.name}: moduli differ by a factor {10.0**gap:.3g}, up to {10.0**size:.3g}"
        level: Level | None = None
        if abs(gap) > log10(_SPECIMENS) or size > 1.0:
            level = "impossible" if size > 1.0 else "doubtful"
        cause = f"{b.name} is of another material, or has another unit"
        yield stated(name, law, text, level, cause=cause, file=b.name)


def _is_copy(a: _Export, b: _Export) -> bool:
    names = ("storage_modulus", "loss_modulus")
    return a.good.sum() == b.good.sum() and all(np.array_equal(a.values(n), b.values(n)) for n in names)


def _superposition(curve: xr.Dataset | None) -> Check:
    """Hand on the verdict of the master curve: a material may defy it, the predictions then do as well."""
    name, law = "superposition", "one spectrum and one shift for each temperature describe all sweeps"
    if curve is None:
        return not_made(name, law, "a master curve of several temperatures")
    verdict = json.loads(curve.attrs["superposition"])
    level: Level | None = {"pass": None, "doubtful": "note", "fail": "doubtful"}[verdict["level"]]
    noise = json.loads(curve.attrs["noise"])
    fit = f"the master curve misses E′ by {100 * noise['storage']:.2g} % and E″ by {100 * noise['loss']:.2g} %"
    return stated(name, law, verdict["reasons"][0] if verdict["reasons"] else fit, level, cause=_APART if level else "")


def _shifts(curve: xr.Dataset | None) -> Check:
    name, law = "order of the shifts", "heat shortens all relaxation times: a_T falls with temperature"
    if curve is None or curve.sizes["temperature"] < 2:
        return not_made(name, law, "a master curve of two temperatures")
    T, shift = curve["temperature"].values, curve["log10_aT"].values
    u = curve["u_log10_aT"].values
    rise, own = np.diff(shift), np.hypot(u[1:], u[:-1])
    known = np.isfinite(rise) & np.isfinite(own) & (own > 0)
    if not known.any():
        return not_made(name, law, "shifts with uncertainties")
    margin = np.where(known, rise / np.where(known, own, 1.0), -np.inf)
    at = int(np.argmax(np.where(rise > _RISE, margin, -np.inf))) if (rise > _RISE).any() else int(np.argmax(margin))
    text = f"log10 a_T changes by {rise[at]:+.2f} from {T[at]:.1f} to {T[at + 1]:.1f} °C"
    found = bounded(name, law, text, float(rise[at]), float(own[at]), at_most=0.0)
    if rise[at] < _RISE and found.level:
        return replace(found, level="doubtful" if rise[at] > 0.5 * _RISE else None)
    cause = f"the isotherm at {T[at]:.1f} or {T[at + 1]:.1f} °C has a wrong temperature or is of another specimen"
    return replace(found, cause=cause)


def _foreign(published: xr.Dataset | None, curve: xr.Dataset | None) -> Check:
    """Hold a published table against the readings: shifts of another material tear them apart."""
    name, law = "published shifts", "a table of the same material continues the readings nearly as the fitted shifts do"
    if published is None or curve is None or "difference" not in published:
        return not_made(name, law, "a published table of shifts")
    known = np.isfinite(published["difference"].values)
    fitted, other = published["fitted"].values[known], published["published"].values[known]
    span, theirs = float(np.ptp(fitted)), float(np.ptp(other))
    apart = float(np.sqrt(np.mean(published["difference"].values[known] ** 2)))
    own = float(np.sqrt(np.nanmean(curve["storage_residual"].values ** 2)))
    worse = float(published.attrs["residual_storage"]) / max(own, 1e-6)
    text = (
        f"the table shifts by {theirs:.1f} decades where the readings shift by {span:.1f}, {apart:.1f} apart (rms); "
        f"with its shifts the readings miss their curve {worse:.1f} times as far"
    )
    is_foreign = apart > _FOREIGN * span and worse > _TORN
    cause = "the table is of another material, or of another state of it" if is_foreign else ""
    level: Level | None = "doubtful" if is_foreign else None
    return stated(name, law, text, level, cause=cause, setting="published.shifts")

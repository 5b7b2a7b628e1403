"""Checks of the specimen: one throughout, still in its clamp, storing and dissipating as a solid may."""

from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise
from math import hypot, inf, log, log10, pi, sqrt

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL, Check, Level, bounded, in_words, not_made, stated, too_large
from labpipe.report import value_with_uncertainty
from pipelines.experiments.dma._checked_sweeps import (
    FEW_ROWS,
    MOST,
    OWN,
    SAME_PLACE,
    Export,
    Sweep,
    moduli_apart,
    steepest_slope,
)

_SPECIMENS = 3.0
"""Factor between moduli of two specimens of one polymer, of clamping and size at the worst."""
_AGED = 0.02  # decades by which a specimen that was heated, or dried, between two sweeps may differ
_SHARED, _SHARED_RANGE = 3, 0.05
"""Readings of each of two sweeps, and decades of loss factor, that both have where one modulus is told from another."""
_ONE_BRANCH = 0.8  # correlation of loss factor and modulus in each of two sweeps
_OTHER_LOSS, _LOSSES_APART = 1.5, 5.0
"""Factor of the loss of one sweep over that of its neighbours that a transition between them does not make, and u."""
_WARMER, _WARMTHS_APART = 3.0, 5.0
"""K by which thermometers of two files may differ, and times the uncertainty of that difference."""
_PLACES = 7  # frequencies at which two sweeps are laid against each other
_OVERLAP, _LEFT = 1.0, 0.1
"""Of the logarithm of frequency that two curves must share, and the part of a difference that a factor may leave."""
_SLIPPED, _SLIPS_APART = 0.06, 6.0
"""Decades of modulus of a slip that is told, and times the scatter of the steps between other sweeps."""


def slipped_specimen(export: Export, isotherms: Sequence[Sweep]) -> Check:
    """Look for the interval from which on all moduli are smaller or larger by one factor.

    Over the modulus, the loss angle of all sweeps is one curve, wherever time and temperature put
    them (van Gurp & Palmen, Rheol. Bull. 67 (1998) 5): a factor shifts a part of it.
    """
    name = "one specimen throughout"
    # in the order in which they were measured: a slip stays
    sweeps = sorted(isotherms, key=lambda sweep: int(sweep.rows[0]))
    found = [(gap, a, b) for a, b in pairwise(sweeps) if (gap := _offset(a, b)) is not None]
    if len(found) < FEW_ROWS:
        return not_made(name, f"{FEW_ROWS + 1} sweeps that overlap, on a slope of the loss factor")
    steps, u = np.array([gap for gap, _, _ in found]).T
    # a little is common to all of them: moduli of a rubber go with temperature, densities against it
    others = [np.delete(steps, i) for i in range(steps.size)]
    usual = np.array([np.median(rest) for rest in others])
    scatter = np.array([np.median(np.abs(rest - np.median(rest))) / 0.6745 for rest in others])
    total = np.hypot(np.hypot(u, OWN), scatter)
    worst = int(np.argmax(np.abs(steps - usual) / total))
    step, (_, a, b) = float(steps[worst] - usual[worst]), found[worst]
    text = (
        f"from {a.place} to {b.place} the moduli change by a factor {in_words(10.0 ** float(steps[worst]))} at one "
        f"loss factor, from sweep to sweep of the others by {in_words(10.0 ** float(usual[worst]))}"
    )
    is_off = abs(step) > _SLIPPED and abs(step) > _SLIPS_APART * total[worst]
    cause = f"the specimen slipped in its clamp, cracked or was clamped anew before {b.place}"
    return stated(name, text, "doubtful" if is_off else None, cause=cause, file=export.name)


def _offset(a: Sweep, b: Sweep) -> tuple[float, float] | None:
    """Return by how many decades the modulus of a sweep lies from that of the one before at one loss factor, with u."""
    x, y, own = [], [], []
    for number, sweep in enumerate((a, b)):
        storage, loss = sweep.values("storage_modulus"), sweep.values("loss_modulus")
        # A melt lies between plates; it has no clamp to slip in.
        if not ((storage > 0) & (loss > 0)).all() or np.median(loss / storage) > 1.0:
            return None
        x.append(np.log10(np.hypot(storage, loss)))
        y.append(np.log10(loss / storage))
        own.append(np.full(storage.size, float(number)))
    # only where both have the loss factors of the other, and both change steadily
    low, high = max(part.min() for part in y), min(part.max() for part in y)
    shared = [(part >= low) & (part <= high) for part in y]
    if min(int(part.sum()) for part in shared) < _SHARED or high - low < _SHARED_RANGE:
        return None
    # A loss factor has two branches about its maximum: both sweeps have to lie on one of them.
    turns = [float(np.corrcoef(m[at], part[at])[0, 1]) for m, part, at in zip(x, y, shared, strict=True)]
    if min(turns) < _ONE_BRANCH and max(turns) > -_ONE_BRANCH:
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


def causality(export: Export, isotherms: Sequence[Sweep]) -> Check:
    """Hold the loss against the rise of the storage modulus with frequency.

    E* ~ (i omega)^b has tan delta = tan(pi b / 2), the local form of Kramers and Kronig's relation
    (Booij & Thoone, Rheol. Acta 21 (1982) 15, doi:10.1007/BF01520701).
    """
    name = "storage and loss belong together"
    pairs = [p for p in map(_slopes, isotherms) if p is not None]
    if not pairs:
        return not_made(name, "sweeps of four frequencies over a decade")
    loss, rise, swapped = np.array(pairs).T
    ours = float(np.median(np.abs(np.log(loss / rise))))
    theirs = float(np.median(np.abs(np.log(1 / loss / swapped))))
    middle = float(np.median(loss))
    message = (
        f"{export.name}: tan δ is {middle:.3g}, the rise with frequency says {float(np.median(rise)):.3g} (medians)"
    )
    if ours > log(3.0) and theirs < 0.5 * ours and middle > 1.0:
        cause = "the columns of storage and loss modulus are exchanged"
        return stated(name, message, "impossible", cause=cause, file=export.name)
    level: Level | None = "doubtful" if ours > log(10.0) else "note" if ours > log(5.0) else None
    cause = "one of the moduli has another unit than the other, or the phase is wrong"
    return stated(name, message, level, cause=cause, file=export.name)


def loss_of_each_sweep(export: Export, isotherms: Sequence[Sweep]) -> Check:
    """Hold the loss of each sweep, over what the rise of its storage modulus says, against its neighbours.

    What the local form of Kramers and Kronig's relation leaves out goes steadily with temperature.
    """
    name = "loss of each sweep"
    sweeps = sorted(isotherms, key=lambda sweep: sweep.temperature)
    found = [(sweep, *known) for sweep in sweeps if (known := _excess(sweep)) is not None]
    T, excess, u = np.array([(s.temperature, e, own) for s, e, own in found]).reshape(-1, 3).T
    if len(found) < FEW_ROWS or (np.diff(T) < SAME_PLACE).any():
        return not_made(name, f"{FEW_ROWS} temperatures with sweeps of four frequencies over a decade")
    share = (T[1:-1] - T[:-2]) / (T[2:] - T[:-2])
    off = excess[1:-1] - (1.0 - share) * excess[:-2] - share * excess[2:]
    u_off = np.sqrt(u[1:-1] ** 2 + ((1.0 - share) * u[:-2]) ** 2 + (share * u[2:]) ** 2)
    worst = int(np.argmax(np.abs(off) / u_off))
    place = found[worst + 1][0].place
    text = (
        f"{place}: its loss is {np.exp(off[worst]):.2f} times what the rise of its storage modulus and the sweeps "
        "beside it in temperature say"
    )
    is_off = abs(off[worst]) > max(log(_OTHER_LOSS), _LOSSES_APART * u_off[worst])
    cause = (
        f"the loss modulus of {place} is wrong: another unit, a copy that was changed, or a specimen that slipped there"
    )
    return stated(name, text, "doubtful" if is_off else None, cause=cause, file=export.name)


def _excess(sweep: Sweep) -> tuple[float, float] | None:
    """Return the logarithm of the loss factor over that which the rise of the storage modulus says, and its u."""
    x = np.log(sweep.values("frequency"))
    storage, loss = sweep.values("storage_modulus"), sweep.values("loss_modulus")
    if x.size < _PLACES or np.ptp(x) < log(10.0) or not ((storage > 0) & (loss > 0)).all():
        return None
    (slope, _), covariance = np.polyfit(x, np.log(storage), 1, cov=True)
    if not 0.0 < slope < 1.0:
        return None
    expected = log(np.tan(0.5 * pi * min(slope, 0.98)))
    return float(np.median(np.log(loss / storage))) - expected, sqrt(covariance[0, 0]) / float(slope)


def pasted_readings(export: Export, isotherms: Sequence[Sweep]) -> Check:
    """Look for readings of one interval that are those of another, digit by digit."""
    name = "readings of another interval"
    if len(isotherms) < 2:
        return not_made(name, "two sweeps")
    for a, b in combinations(isotherms, 2):
        pairs = [np.column_stack([s.values("storage_modulus"), s.values("loss_modulus")]) for s in (a, b)]
        if pairs[0].shape != pairs[1].shape:
            continue
        same = int((pairs[0] == pairs[1]).all(axis=1).sum())
        if same >= max(FEW_ROWS, MOST * len(pairs[0])):
            text = f"{b.place}: {same} of {len(pairs[0])} readings are those of {a.place}, digit by digit"
            cause = "moduli of one interval were copied into another, or an interval was exported twice"
            return stated(name, text, "doubtful", cause=cause, file=export.name)
    return stated(name, f"{export.name}: no sweep equals another", None, file=export.name)


def rise_with_frequency(export: Export, isotherms: Sequence[Sweep]) -> Check:
    """Look for a sweep whose storage modulus falls as the frequency rises: its rows stand in another order."""
    name = "rise with frequency"
    worst: tuple[float, float, Sweep] | None = None
    for sweep in isotherms:
        x, storage = np.log10(sweep.values("frequency")), sweep.values("storage_modulus")
        if x.size < 4 or np.ptp(x) < 0.5 or not (storage > 0).all():
            continue
        y = np.log10(storage)
        # the steps from reading to reading say how far they scatter about any curve
        slope, level = np.polyfit(x, y, 1)
        rest = y - level - slope * x
        u = hypot(float(np.sqrt(np.sum(rest**2) / (x.size - 2) / np.sum((x - x.mean()) ** 2))), OWN / float(np.ptp(x)))
        if worst is None or slope / u < worst[0] / worst[1]:
            worst = float(slope), u, sweep
    if worst is None:
        return not_made(name, "sweeps of four frequencies over half a decade")
    slope, u, sweep = worst
    text = (
        f"{sweep.place}: at {sweep.temperature:.1f} °C the storage modulus changes by {slope:+.3f} decades per decade"
    )
    cause = f"frequencies and moduli of {sweep.place} stand in opposite order, or the instrument resonates"
    return bounded(name, text, slope, u, at_least=0.0, is_law=False, file=export.name, cause=cause)


def _slopes(sweep: Sweep) -> tuple[float, float, float] | None:
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


def repeated_temperatures(isotherms: Sequence[Sweep]) -> Check:
    """Hold sweeps that repeat a temperature against each other."""
    name = "repeated temperatures"
    slope = steepest_slope(isotherms)
    worst: tuple[float, float, Sweep, Sweep] | None = None
    for a, b in combinations(isotherms, 2):
        # between files it is another check
        if a.export is b.export and abs(a.temperature - b.temperature) <= SAME_PLACE:
            apart = moduli_apart(a, b)
            if apart is not None:
                gap, u = apart
                beyond = abs(gap) - slope * abs(a.temperature - b.temperature)
                u = hypot(u, sqrt(2.0) * OWN)
                worst = max(worst or (beyond, u, a, b), (beyond, u, a, b), key=lambda w: w[0] / w[1])
    if worst is None:
        return not_made(name, "a temperature that is repeated")
    beyond, u, a, b = worst
    factor = 10.0 ** max(beyond, 0.0)
    text = (
        f"{a.place} and {b.place} at {a.temperature:.1f} °C differ by a factor "
        f"{value_with_uncertainty(factor, factor * (10.0**u - 1), '1')}"
    )
    is_apart = beyond > DOUBTFUL * u
    level: Level | None = None if not is_apart else "doubtful" if beyond > _AGED else "note"
    cause = f"the temperature of {a.place} or {b.place} is wrong, or the specimen changed between them"
    return stated(name, text, level, cause=cause, file=a.export.name)


def files_of_one_specimen(exports: Sequence[Export], found: Sequence[Sequence[Sweep]]) -> Iterator[Check]:
    name = "files of one specimen"
    if len(exports) < 2:
        return
    for (a, own), (b, other) in combinations(list(zip(exports, found, strict=True)), 2):
        if _is_copy(a, b):
            text = f"{b.name} holds the same values as {a.name}"
            cause = "a copy was taken for a repeat"
            yield stated("same values twice", text, "doubtful", cause=cause, file=b.name)
            continue
        gaps = [
            apart[0]
            for s in own
            for t in other
            if abs(s.temperature - t.temperature) <= 2 * SAME_PLACE and (apart := moduli_apart(s, t)) is not None
        ]
        if not gaps:
            yield not_made(name, f"isotherms that {a.name} and {b.name} share")
            continue
        gap = float(np.median(gaps))
        size = float(np.max(np.abs(gaps)))
        text = f"{a.name} over {b.name}: moduli differ by a factor {in_words(10.0**gap)}, up to {in_words(10.0**size)}"
        level: Level | None = None
        if abs(gap) > log10(_SPECIMENS) or size > 1.0:
            level = "impossible" if size > 1.0 else "doubtful"
        cause = f"{b.name} is of another material, or has another unit"
        yield stated(name, text, level, cause=cause, file=b.name)


def _is_copy(a: Export, b: Export) -> bool:
    names = ("storage_modulus", "loss_modulus")
    return a.good.sum() == b.good.sum() and all(np.array_equal(a.values(n), b.values(n)) for n in names)


def temperatures_of_files(exports: Sequence[Export], found: Sequence[Sequence[Sweep]]) -> Iterator[Check]:
    """Look for the temperature by which the loss factors of two files lie apart; sizes of specimens cancel in them."""
    name = "temperatures of the files"
    for (a, own), (b, other) in combinations(list(zip(exports, found, strict=True)), 2):
        if _is_copy(a, b):
            continue
        gaps = [*_warmer(own, other), *((-gap, u) for gap, u in _warmer(other, own))]
        if len(gaps) < FEW_ROWS:
            yield not_made(name, f"sweeps of {a.name} and {b.name} at three temperatures each that overlap")
            continue
        gap, u = np.array(gaps).T
        weight = u**-2
        mean = float(gap @ weight / weight.sum())
        chi2 = float(((gap - mean) ** 2) @ weight) / (gap.size - 1)
        # both directions look at the same readings
        u_mean = sqrt(2.0 * max(chi2, 1.0) / float(weight.sum()))
        text = (
            f"{b.name}: its loss factors are those of {a.name} at temperatures {abs(mean):.1f} K "
            f"{'lower' if mean < 0 else 'higher'} than it says (u = {u_mean:.1f} K)"
        )
        is_off = abs(mean) > max(_WARMER, _WARMTHS_APART * u_mean)
        cause = (
            f"the temperature of one of the two files is off by {abs(mean):.0f} K (thermometer, its place, time to "
            "warm through), or one specimen was dried, aged or of another batch"
        )
        if is_off and (factor := _faster(own, other)) != 1.0:
            cause = (
                f"the frequencies of {b.name} are probably {too_large(factor)}, against those of {a.name}: Hz, rad/s "
                "and turns per minute were mixed up, or a decimal was lost; one of the two files is wrong"
            )
        yield stated(name, text, "doubtful" if is_off else None, cause=cause, file=b.name)


def _faster(own: Sequence[Sweep], other: Sequence[Sweep]) -> float:
    """Return the factor of a unit by which the frequencies of other sweeps are too large; 1 where none explains them.

    A factor moves the curves of all temperatures by one length on the axis of frequencies, a
    temperature each by another.
    """
    pairs = [(s, t) for s in own for t in other if abs(s.temperature - t.temperature) <= 2 * SAME_PLACE]
    pairs = [p for p in pairs if all((q.values(f"{n}_modulus") > 0).all() for q in p for n in ("storage", "loss"))]

    def apart(factor: float) -> float:
        """Mean square by which loss factors differ where the curves overlap."""
        found = []
        for s, t in pairs:
            x, z = np.log(s.values("frequency")), np.log(t.values("frequency")) - log(factor)
            grid = np.linspace(max(x[0], z[0]), min(x[-1], z[-1]), _PLACES)
            if grid[-1] - grid[0] > _OVERLAP:
                ours, theirs = (np.log(q.values("loss_modulus") / q.values("storage_modulus")) for q in (s, t))
                found.append(float(np.mean((np.interp(grid, x, ours) - np.interp(grid, z, theirs)) ** 2)))
        return float(np.mean(found)) if len(found) > len(pairs) // 2 and len(found) >= FEW_ROWS else inf

    factors = [f**sign for f in (2 * pi, 60.0, 60.0 / (2 * pi), 10.0, 100.0) for sign in (1, -1)]
    best = min(factors, key=apart)
    return best if apart(best) < _LEFT * apart(1.0) else 1.0


def _warmer(own: Sequence[Sweep], other: Sequence[Sweep]) -> list[tuple[float, float]]:
    """Return by how much warmer each sweep of a file is by the loss factors of another than it says, with u [K]."""
    low, high = (
        f([float(s.values("frequency")[i]) for s in (*own, *other)], default=0.0) for f, i in ((max, 0), (min, -1))
    )
    if not 0.0 < low < high:
        return []
    x = np.linspace(log(low), log(high), _PLACES)

    def table(sweeps: Sequence[Sweep]) -> tuple[Floats, Floats]:
        known = sorted(
            (s for s in sweeps if all((s.values(f"{n}_modulus") > 0).all() for n in ("storage", "loss"))),
            key=lambda s: s.temperature,
        )
        rows = [
            np.interp(x, np.log(s.values("frequency")), np.log(s.values("loss_modulus") / s.values("storage_modulus")))
            for s in known
        ]
        return np.array([s.temperature for s in known]), np.array(rows).reshape(-1, _PLACES)

    (T, y), (at, seen) = table(own), table(other)
    if T.size < 3 or (np.diff(T) < SAME_PLACE).any():
        return []
    slopes = np.gradient(y, T, axis=0)
    bends = np.gradient(slopes, T, axis=0)
    found = []
    for temperature, values in zip(at, seen, strict=True):
        if not T[0] <= temperature <= T[-1]:
            continue
        left = min(int(np.searchsorted(T, temperature, side="right")) - 1, T.size - 2)
        share = (temperature - T[left]) / (T[left + 1] - T[left])
        there, slope, bend = ((1 - share) * table[left] + share * table[left + 1] for table in (y, slopes, bends))
        steep = float(np.median(slope))
        missed = 0.5 * share * (1 - share) * (T[left + 1] - T[left]) ** 2 * float(np.median(np.abs(bend)))
        spread = hypot(float(np.std(values - there)) / sqrt(_PLACES), missed)
        if steep and spread:
            found.append((float(np.median(values - there)) / steep, spread / abs(steep)))
    return found

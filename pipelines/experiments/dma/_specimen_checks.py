"""Checks of the specimen: one throughout, still in its clamp, storing and dissipating as a solid may."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from math import hypot, log, log10, pi, sqrt

import numpy as np

from labpipe.judging import DOUBTFUL, Check, Level, in_words, not_made, stated
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

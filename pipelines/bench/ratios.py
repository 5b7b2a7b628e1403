"""Comparison with the thesis's methods and peers at equal error, in one table.

For every other method the most accurate of its settings is taken, and of ours the fastest that errs
no more; where none of ours is as accurate, our default, and the table shows who errs less. Times
are compared run by run, as the contenders of a suite ran in turn on the same data.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from labpipe.report import Column, Table
from pipelines.bench.measure import OURS, Point, Suite

LARGEST_SPREAD = 0.2
"""Of a ratio to either side, from run to run; one that varies more tells of the machine."""


@dataclass(frozen=True, slots=True)
class Ratio:
    """One other method: its error over ours, and its run time over ours with its spread.

    ``lowest`` and ``highest`` are NaN where runs were not taken in turn, and ``time`` is where the
    runs differ by more than :data:`LARGEST_SPREAD`.
    """

    suite: str
    what: str
    other: str
    ours: str
    error: float
    time: float
    lowest: float
    highest: float


def ratios_of(suite: Suite) -> list[Ratio]:
    """Return one ratio for every group of a suite that is not ours.

    Points without an error or a run time are left out, and so is a suite without a diagram.
    """
    if not suite.has_diagram:
        return []
    points = [p for p in suite.points if p.seconds > 0 and math.isfinite(p.error)]
    ours = [p for p in points if p.group == OURS]
    groups = dict.fromkeys(p.group for p in points if p.group != OURS)
    if not ours:
        return []
    return [
        _ratio(suite, min((p for p in points if p.group == group), key=lambda p: p.error), ours) for group in groups
    ]


def _ratio(suite: Suite, other: Point, ours: Sequence[Point]) -> Ratio:
    as_good = [p for p in ours if p.error <= other.error]
    defaults = [p for p in ours if p.is_default] or list(ours)
    mine = min(as_good, key=lambda p: p.seconds) if as_good else defaults[0]
    group = other.setting if other.group in other.setting else f"{other.group}: {other.setting}"
    error = other.error / mine.error if mine.error > 0 else math.inf
    if mine.samples and len(mine.samples) == len(other.samples):
        pairs = [b / a for a, b in zip(mine.samples, other.samples, strict=True)]
        # Rows of a suite may be of unequal work (per point and frame): times say by how much.
        per_run = (other.seconds / mine.seconds) / (median(other.samples) / median(mine.samples))
        time, lowest, highest = (per_run * f for f in (median(pairs), min(pairs), max(pairs)))
        time = time if highest - lowest <= 2.0 * LARGEST_SPREAD * time else math.nan
    else:
        time, lowest, highest = other.seconds / mine.seconds, math.nan, math.nan
    return Ratio(suite.name, suite.title, group, mine.setting, error, time, lowest, highest)


def table(suites: Iterable[Suite]) -> Table | None:
    """Return the ratios of all suites, or None when there are none."""
    rows = [ratio for suite in suites for ratio in ratios_of(suite)]
    if not rows:
        return None
    numbers = ("its error / ours", "its time / ours", "lowest", "highest")
    names = map(Column, ("part", "other method", "ours"))
    columns = (*names, *(Column(title, digits=3) for title in numbers))
    cells = [(r.suite, r.other, r.ours, *map(_known, (r.error, r.time, r.lowest, r.highest))) for r in rows]
    return Table(columns, cells)


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None

"""The benchmark's page and its JSON document: a diagram and a table for every suite, and one table of ratios."""

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import Any

import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from labpipe.report import (
    Block,
    Column,
    Document,
    KeyValues,
    Listed,
    Notice,
    Paragraph,
    Picture,
    Section,
    Table,
    figure_bytes,
    figure_style,
    listed,
    number,
)
from pipelines.bench.measure import OURS, THESIS, Point, Suite
from pipelines.bench.parts import PARTS, PartFailure, PartResult

LARGEST_SPREAD = 0.2
"""Of a ratio to either side, from run to run; a larger one measures the machine."""
_HOW = (
    "Every diagram shows error against run time of one part of labpipe, on data whose truth is known. Filled marker: "
    "the default setting. Numbers at the markers are those of the table below. Dashed lines are theoretical "
    "limits. The methods of one diagram ran alternately in one process; times are medians of the processor time of "
    "warm runs, the first run is the cold one. On a busy machine only ratios are meaningful."
)
_EQUAL = (
    "At equal error: the most accurate setting of every other method against our fastest setting that is at least as "
    "accurate (else the default). Above 1 ours is more accurate, or faster. Lowest and highest are of alternating runs "
    f"on the same data; where they lie further than {100 * LARGEST_SPREAD:g} % to either side, no ratio is given."
)
#: Okabe and Ito's colours; the markers distinguish the methods without them.
_LOOKS = {OURS: ("#0066a6", "o"), THESIS: ("#cc4e00", "s")}
_PEERS = (("#00795a", "^"), ("#8a3a6b", "D"), ("#8f6400", "v"), ("#2b2b2b", "P"), ("#7f97a8", "X"))


def as_document(
    results: Sequence[PartResult], failures: Sequence[PartFailure], machine: Mapping[str, Any]
) -> dict[str, Any]:
    """Return everything measured as plain values, and why parts failed; NaN becomes null."""
    found = {"machine": machine, "parts": results, "failures": failures}
    document: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(found, enc_hook=np.generic.item))
    return document


def render(results: Sequence[PartResult], failures: Sequence[PartFailure], machine: Mapping[str, Any]) -> str:
    """Return the page of a run; arguments as of :func:`as_document`."""
    sections = []
    for r in results:
        blocks: list[Block] = []
        for suite in r.suites:
            blocks.append(Paragraph(suite.title))
            if drawable(suite):
                blocks.append(Picture(draw(suite), f"{suite.title}: {suite.error_label} against {suite.time_label}"))
            blocks += [table(suite)] * bool(suite.points) + [Notice("info", note) for note in suite.notes]
        used = number(r.processor_seconds, 3)
        blocks.append(Paragraph(f"Measured in {number(r.seconds, 3)} s, {used} s of processor time."))
        sections.append(Section(PARTS[r.name][1].rstrip("."), tuple(blocks), r.name))
    if (compared := ratios([suite for r in results for suite in r.suites])) is not None:
        sections.insert(0, Section("Comparison with other methods", (Paragraph(_EQUAL), compared)))
    if failures:
        sections.insert(0, Section("Failed", [Notice("error", f"{f.name}: {f.message}") for f in failures]))
    memory = machine["memory_bytes"]
    libraries = ", ".join(f"{name} {version}" for name, version in machine["libraries"].items() if version)
    threads = ", ".join(f"{name}={count}" for name, count in machine["threads"].items())
    about = KeyValues(
        (
            ("processor", str(machine["processor"]), str(machine["architecture"])),
            ("cores", str(machine["cores"]), "usable by this process"),
            ("memory", number(memory / 2**30, 3) if memory else "unknown", "GiB"),
            ("system", str(machine["system"]), f"Python {machine['python']}"),
            ("libraries", libraries, ""),
            ("threads", threads or "as the libraries choose", ""),
        )
    )
    sections.append(Section("Method and machine", (Paragraph(_HOW), about)))
    return Document("Accuracy against run time", "labpipe bench", "", sections).render()


def drawable(suite: Suite) -> list[tuple[int, Point]]:
    """Return the points of a suite's diagram with their numbers in the table: those with an error and a run time."""
    return [(n, p) for n, p in enumerate(suite.points, 1) if p.seconds > 0 and math.isfinite(p.error)]


def draw(suite: Suite) -> bytes:
    """Draw the work–precision diagram of a suite as SVG.

    An error of exactly 0 has no place on a logarithmic axis; it is drawn a decade below the least.
    """
    shown = drawable(suite)
    floor = min((p.error for _, p in shown if p.error > 0), default=1e-16) / 10.0
    peers = iter(_PEERS * len(shown))
    looks: dict[str, tuple[str, str]] = {}
    with figure_style(columns=2, aspect=0.5):
        figure = Figure(layout="constrained")
        axes: Axes = figure.subplots()
        axes.set(xscale="log", yscale="log", xlabel=suite.time_label, ylabel=textwrap.fill(suite.error_label, 42))
        axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))  # more labels would cover each other
        labels: set[str] = set()
        for place, point in shown:
            base = THESIS if point.group.startswith(THESIS) else point.group
            if base not in looks:
                looks[base] = _LOOKS.get(base) or next(peers)
            colour, marker = looks[base]
            label = (point.group or "labpipe") + (", default" if point.is_default else "")
            where = (point.seconds, max(point.error, floor))
            axes.plot(
                *where,
                marker=marker,
                linestyle="none",
                color=colour,
                markerfacecolor=colour if point.is_default else "white",
                markersize=8.0 if point.is_default else 5.0,
                label=None if label in labels else label,
            )
            labels.add(label)
            axes.annotate(str(place), where, xytext=(5, 3), textcoords="offset points", fontsize=6.0)
        for bound, dashes in zip(suite.bounds, ("--", ":", "-."), strict=False):
            axes.axhline(bound.error, color="#404040", linewidth=0.9, linestyle=dashes, label=bound.label)
        axes.margins(0.12, 0.15)
        figure.legend(loc="outside right upper")
        return figure_bytes(figure, "svg")


def table(suite: Suite) -> Table:
    """Return the numbers of a suite: one row per point, columns that hold nothing left out.

    The time of every row is also given as a multiple of the default's.
    """
    points = suite.points
    base = next((p.seconds for p in points if p.is_default and p.seconds > 0), math.nan)
    named = [f"{p.group or 'labpipe'}: {p.setting}{' (default)' if p.is_default else ''}" for p in points]
    columns = [
        Listed("#", list(range(1, len(points) + 1))),
        Listed("method and setting", named),
        Listed(suite.error_label, [_known(p.error) for p in points], digits=3),
        Listed("run time", [_known(p.seconds) for p in points], "s", digits=3),
        Listed("× default", [_known(p.seconds / base) for p in points], digits=3),
        Listed("first run", [_known(p.cold_seconds) for p in points], "s", digits=3),
    ]
    extras = dict.fromkeys(name for point in points for name in point.extra)
    columns += [Listed(name, [_known(p.extra.get(name)) for p in points], digits=3) for name in extras]
    return listed(column for column in columns if any(cell is not None for cell in column.cells))


def ratios(suites: Iterable[Suite]) -> Table | None:
    """Compare every other method with ours at equal error; None without another method.

    Of the other method the most accurate setting is taken, of ours the fastest that errs no more, or the default where
    none is as accurate. Times are compared run by run.
    """
    rows: list[tuple[str | float | None, ...]] = []
    for suite in suites:
        points = [point for _, point in drawable(suite)]
        ours = [p for p in points if p.group == OURS]
        for group in dict.fromkeys(p.group for p in points if p.group != OURS and ours):
            other = min((p for p in points if p.group == group), key=lambda p: p.error)
            as_good = sorted((p for p in ours if p.error <= other.error), key=lambda p: p.seconds)
            mine = (as_good or [p for p in ours if p.is_default] or ours)[0]
            error = other.error / mine.error if mine.error > 0 else math.inf
            time, low, high = other.seconds / mine.seconds, math.nan, math.nan
            if mine.samples and len(mine.samples) == len(other.samples):
                # rows of a suite may be of unequal work (per point and frame): times know by how much
                share = time * median(mine.samples) / median(other.samples)
                pairs = [share * b / a for a, b in zip(mine.samples, other.samples, strict=True)]
                time, low, high = median(pairs), min(pairs), max(pairs)
                time = time if high - low <= 2.0 * LARGEST_SPREAD * time else math.nan
            name = other.setting if group in other.setting else f"{group}: {other.setting}"
            rows.append((suite.name, name, mine.setting, *map(_known, (error, time, low, high))))
    numbers = ("its error / ours", "its time / ours", "lowest", "highest")
    heads = (*map(Column, ("part", "other method", "ours")), *(Column(title, digits=3) for title in numbers))
    return Table(heads, rows) if rows else None


def _known(value: Any) -> Any:
    """Return a value as a cell of a table: NaN and infinity as None, numpy's scalars as Python's."""
    plain = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(plain, float) and not math.isfinite(plain) else plain

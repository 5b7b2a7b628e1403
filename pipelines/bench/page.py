"""The benchmark's page and its JSON document."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from labpipe.report import Block, Column, Document, KeyValues, Notice, Paragraph, Picture, Section, Table, number
from pipelines.bench.measure import Point, Suite
from pipelines.bench.parts import PARTS, PartFailure, PartResult
from pipelines.bench.ratios import LARGEST_SPREAD, table as table_of_ratios

JSON_NAME, PAGE_NAME = "bench.json", "bench.html"
_HOW = (
    "Every diagram shows error against run time of one part of labpipe, on data whose truth is known. Filled marker: "
    "the default setting. Numbers beside the markers are those of the table below. Dashed lines are theoretical "
    "limits. The methods of one diagram ran alternately in one process; times are medians of the processor time of "
    "warm runs (of the clock, for whole sessions), the first run is the cold one. On a busy machine only ratios are "
    "meaningful."
)
_EQUAL = (
    "At equal error: the most accurate setting of every other method against our fastest setting that is at least as "
    "accurate (else the default). Above 1 ours is more accurate, or faster. Lowest and highest are of alternating runs "
    f"on the same data; where they lie further than {100 * LARGEST_SPREAD:g} % to either side, no ratio is given."
)
_BINARY = 1024.0


def as_document(
    results: Sequence[PartResult], failures: Sequence[PartFailure], machine: Mapping[str, Any]
) -> dict[str, Any]:
    """Return everything measured as plain values, and why parts gave nothing; NaN becomes null."""
    found = {"machine": machine, "parts": results, "failures": failures}
    document: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(found, enc_hook=np.generic.item))
    return document


def as_json(document: Mapping[str, Any]) -> str:
    """Return the document as JSON text."""
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """Return a number of numpy as Python's, and NaN or infinity as None."""
    if value is None or isinstance(value, str | bool | int):
        return value
    # numpy's own truth values have no __float__ worth printing
    if type(value).__name__ == "bool":
        return bool(value)
    number_found = float(value)
    return number_found if math.isfinite(number_found) else None


def render(results: Sequence[PartResult], failures: Sequence[PartFailure], machine: Mapping[str, Any]) -> str:
    """Return the page of a run; arguments as of :func:`as_document`."""
    head = Section("Machine", (Paragraph(_HOW), _machine(machine)))
    ratios = table_of_ratios([suite for r in results for suite in r.suites])
    if ratios is not None:
        head = Section("Machine, and comparison with other methods", (*head.blocks, Paragraph(_EQUAL), ratios))
    failed = tuple(Notice("error", f"{f.name}: {f.message}") for f in failures)
    parts = [Section(PARTS[r.name][1].rstrip("."), _blocks(r), r.name) for r in results]
    sections = [head, *([Section("Failed", failed)] if failed else []), *parts]
    return Document("Accuracy against run time", "labpipe bench", "", sections).render()


def _machine(machine: Mapping[str, Any]) -> KeyValues:
    libraries = ", ".join(f"{k} {v}" for k, v in machine["libraries"].items() if v)
    threads = ", ".join(f"{k}={v}" for k, v in machine["threads"].items())
    memory = machine["memory_bytes"]
    return KeyValues(
        (
            ("processor", str(machine["processor"]), str(machine["architecture"])),
            ("cores", str(machine["cores"]), "usable by this process"),
            ("memory", number(memory / _BINARY**3, 3) if memory else "unknown", "GiB"),
            ("system", str(machine["system"]), f"Python {machine['python']}"),
            ("libraries", libraries, ""),
            ("threads", threads or "as the libraries choose", ""),
        )
    )


def _blocks(result: PartResult) -> tuple[Block, ...]:
    from pipelines.bench.diagram import draw, is_drawable

    blocks: list[Block] = []
    for suite in result.suites:
        blocks.append(Paragraph(suite.title))
        if is_drawable(suite):
            alt = f"{suite.title}: {suite.error_label} against {suite.time_label}"
            blocks.append(Picture(draw(suite), alt))
        if suite.points:
            blocks.append(table(suite))
        blocks.extend(Notice("info", note) for note in suite.notes)
        if (one := _traced_alone(suite)) is not None:
            blocks.append(Paragraph(f"Peak memory of {one.setting}: {number(_mebibytes(one.peak_bytes), 3)} MiB."))
    text = f"Measured in {number(result.seconds, 3)} s"
    if math.isfinite(result.processor_seconds):
        text += f", {number(result.processor_seconds, 3)} s of processor time"
    blocks.append(Paragraph(text + "."))
    return tuple(blocks)


def table(suite: Suite) -> Table:
    """Return the numbers of a suite: one row per point, columns that hold nothing left out.

    The time of every row is also given as a multiple of the default's.
    """
    points = suite.points
    base = next((p.seconds for p in points if p.is_default and p.seconds > 0), math.nan)
    extras = list(dict.fromkeys(name for point in points for name in point.extra))
    columns: list[tuple[Column, list[Any]]] = [
        (Column("#"), list(range(1, len(points) + 1))),
        (Column("method and setting"), [_named(p) for p in points]),
        (Column(suite.error_label, digits=3), [_plain(p.error) for p in points]),
        (Column("run time", "s", digits=3), [_plain(p.seconds) for p in points]),
        (Column("× default", digits=3), [_plain(p.seconds / base) for p in points]),
        (Column("first run", "s", digits=3), [_plain(p.cold_seconds) for p in points]),
    ]
    if not _traced_alone(suite):
        columns.append((Column("peak memory (MiB)", digits=3), [_plain(_mebibytes(p.peak_bytes)) for p in points]))
    for name in extras:
        if name == "lowest":
            columns.append((Column("lowest to highest"), [_range(p.extra) for p in points]))
        elif name != "highest":
            columns.append((Column(name, digits=3), [_plain(p.extra.get(name)) for p in points]))
    kept = [(c, cells) for c, cells in columns if any(cell is not None for cell in cells)]
    rows = list(zip(*(cells for _, cells in kept), strict=True))
    return Table(tuple(column for column, _ in kept), rows)


def _traced_alone(suite: Suite) -> Point | None:
    """Return the only point whose memory was watched: a sentence, not a column."""
    traced = [p for p in suite.points if p.peak_bytes is not None]
    return traced[0] if len(traced) == 1 else None


def _named(point: Point) -> str:
    return f"{point.group or 'labpipe'}: {point.setting}{' (default)' if point.is_default else ''}"


def _range(extra: Mapping[str, Any]) -> str | None:
    low, high = (_plain(extra.get(name)) for name in ("lowest", "highest"))
    return None if low is None or high is None else f"{number(low, 3)} to {number(high, 3)}"


def _mebibytes(size: int | None) -> float:
    return math.nan if size is None else size / _BINARY**2

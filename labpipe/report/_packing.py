"""A chart as data for the page: thinned arrays in base64, and a description of how to draw them."""

import math
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe.report._charts import LineChart, Series, np_float
from labpipe.report._style import LineLook, level_look, looks
from labpipe.report._thinning import kept_samples

if TYPE_CHECKING:
    from labpipe.arrays import Floats

# A float32 resolves 6e-8 of its size. Where the curve is a small ripple on a large offset, the
# offset is taken out first, so that the ripple keeps its digits.
_OFFSET_RATIO = 100.0
# The window is a little wider than the points, so that no marker sits on the frame.
_MARGIN = 0.02


@dataclass(frozen=True)
class Drawn:
    """The part of one series that is drawn: after thinning, with values that an axis cannot show as gaps.

    ``source``: where it comes from; ``x`` (m,): positions; ``curves`` (m,): ``(y,)``, ``(y, u)`` or ``(low, high)``;
    ``look``: colour, dashes, marker; ``is_marked``: draw markers along the line: other lines of the chart differ from
    it in colour only.
    """

    source: Series
    x: "Floats"
    curves: "tuple[Floats, ...]"
    look: LineLook
    is_marked: bool


@dataclass(frozen=True)
class ThinnedChart:
    """A chart ready to be packed or drawn.

    ``chart``: where it comes from; ``series``: bands first; ``x_range``: the whole window along x; ``notes``: remarks
    for the caption on samples that were thinned out or cannot be shown.
    """

    chart: LineChart
    series: tuple[Drawn, ...]
    x_range: tuple[float, float]
    notes: tuple[str, ...]


def wanted_bytes(chart: LineChart) -> int:
    """Return the bytes that a chart takes in the page when no sample is left out."""
    words = sum(np_float(s.x).size * len(s.curves) for s in chart.series)
    axes = [np_float(series.x) for series in chart.series]
    # Positions take two words; every common axis is stored once.
    words += sum(2 * axes[members[0]].size for members in _shared_axes(axes))
    return words * 16 // 3 + 1  # four bytes each, by a third more in base64


def thin(chart: LineChart, max_bytes: int) -> ThinnedChart:
    """Choose the samples of a chart that fit into the given bytes in the page, base64 included.

    Series that share their `x` keep the same samples, so that `x` is stored once.
    """
    ordered = sorted(chart.series, key=lambda s: s.style != "band")
    found = _looks(chart)
    samples = [_showable(chart, series) for series in ordered]
    fraction = min(1.0, max_bytes / wanted_bytes(chart))
    windows = [(a, b) for _, a, b in chart.views]
    drawn: dict[int, Drawn] = {}
    n_all = n_kept = 0
    for members in _shared_axes([x for x, *_ in samples]):
        x = samples[members[0]][0]
        curves = [curve for m in members for curve in samples[m][1]]
        # A loop has extremes in both directions; they are sought along its course.
        along = x if chart.is_ordered else np.arange(x.size, dtype=np.float64)
        sought = curves if chart.is_ordered else [*curves, x]
        kept = kept_samples(along, sought, max(int(x.size * fraction), 64), windows)
        n_all += x.size
        n_kept += kept.size
        for m in members:
            drawn[m] = Drawn(ordered[m], x[kept], tuple(curve[kept] for curve in samples[m][1]), *found[id(ordered[m])])
    notes = []
    if n_kept < n_all:
        where = "Outside the named windows the" if chart.views else "The"
        notes.append(
            f"{where} curves are drawn through the smallest and largest samples of short stretches "
            f"({n_kept} of {n_all} samples are in this page)."
        )
    if n_hidden := sum(hidden for *_, hidden in samples):
        are = "point is" if n_hidden == 1 else "points are"
        notes.append(f"{n_hidden} {are} not shown: zero or negative on a logarithmic axis.")
    series = tuple(drawn[m] for m in range(len(ordered)))
    filled = [d.x for d in series if d.x.size]
    has_margin = not chart.is_ordered or any(d.source.style == "points" for d in series)
    ends = min((float(x.min()) for x in filled), default=1.0), max((float(x.max()) for x in filled), default=10.0)
    return ThinnedChart(chart, series, padded_range(*ends, chart.x_scale, _MARGIN * has_margin), tuple(notes))


def pack(thinned: ThinnedChart) -> dict[str, Any]:
    """Describe a thinned chart with types that JSON has (arrays as base64 of little-endian)."""
    chart = thinned.chart
    axes = _shared_axes([d.x for d in thinned.series])
    axis_of = {m: place for place, members in enumerate(axes) for m in members}
    return {
        "kind": "plane" if not chart.is_ordered else "line",
        "title": chart.title,
        "xLabel": chart.x_label,
        "yLabel": chart.y_label,
        "xScale": chart.x_scale,
        "yScale": chart.y_scale,
        "height": chart.height_px,
        "range": list(thinned.x_range),
        "group": chart.group,
        "views": [[a, b] for _, a, b in chart.views],
        "opensOnView": chart.opens_on_view,
        "lines": [[n, x] for n, x in chart.vlines],
        "axes": [b64encode(thinned.series[m[0]].x.astype("<f8").tobytes()).decode() for m in axes],
        "series": [_packed_series(d, axis_of[m]) for m, d in enumerate(thinned.series)],
    }


def _looks(chart: LineChart) -> dict[int, tuple[LineLook, bool]]:
    """Return look and marking of every series by its identity; the first band looks like the first curve."""
    found: dict[int, LineLook] = {}
    for is_band in (False, True):
        chosen = [s for s in chart.series if (s.style == "band") == is_band and s.level is None]
        found |= zip(map(id, chosen), looks([s.role for s in chosen]), strict=True)
    found |= {id(s): level_look(s.level, s.role) for s in chart.series if s.level is not None}
    if len(chart.series) == 1:
        # Dashes tell curves apart; a curve alone needs none, and its peaks want a whole line.
        found = {key: replace(look, dash=()) for key, look in found.items()}
    curves = [s for s in chart.series if s.style != "band" and s.level is None]
    roles: list[str | None] = [s.role for s in curves if s.role not in (None, "repeat")]
    # Points carry markers already, and markers along lines would hide them.
    can_mark = chart.is_ordered and not any(s.style == "points" for s in curves)
    marked = {id(s) for s in curves if can_mark and roles.count(s.role) > 1}
    family = (s for s in chart.series if s.level is not None and s.style not in ("points", "band"))
    marked |= set(map(id, family)) if chart.is_ordered else set()
    return {key: (look, key in marked) for key, look in found.items()}


def _showable(chart: LineChart, series: Series) -> "tuple[Floats, tuple[Floats, ...], int]":
    """Return x and curves, with gaps where a logarithmic axis cannot show the values, and how many those are."""
    x, curves = np_float(series.x), series.curves
    if chart.x_scale == "log":
        curves = tuple(curve[x > 0] for curve in curves)
        x = x[x > 0]
    n_hidden = np_float(series.x).size - x.size
    if chart.y_scale == "log":
        is_hidden = curves[0] <= 0
        curves = tuple(np.where(is_hidden, np.nan, curve) for curve in curves)
        n_hidden += int(np.count_nonzero(is_hidden))
    return x, curves, n_hidden


def _shared_axes(axes: "Sequence[Floats]") -> list[list[int]]:
    """Group the places of equal arrays."""
    groups: dict[tuple[int, bytes], list[int]] = {}
    for place, x in enumerate(axes):
        groups.setdefault((x.size, x.tobytes()), []).append(place)
    return list(groups.values())


def padded_range(low: float, high: float, scale: str, margin: float) -> tuple[float, float]:
    """Widen a range by a fraction of itself on both sides; a range of one point gets a width."""
    if scale == "log":
        ends = padded_range(math.log10(low), math.log10(high), "linear", margin)
        return (10.0 ** ends[0], 10.0 ** ends[1])
    if low == high:
        half = abs(low) * 0.05 or 1.0
        return (low - half, high + half)
    width = (high - low) * margin
    return (low - width, high + width)


def _packed_series(drawn: Drawn, axis: int) -> dict[str, Any]:
    source, look = drawn.source, drawn.look
    packed: dict[str, Any] = {}
    for name, curve in zip(("low", "high") if source.style == "band" else ("y", "u"), drawn.curves, strict=False):
        # values as 32-bit numbers: offset + scale * data
        finite = curve[np.isfinite(curve)]
        offset = low = high = 0.0
        if finite.size:
            low, high = float(finite.min()), float(finite.max())
            middle = low + (high - low) / 2
            offset = middle if abs(middle) > _OFFSET_RATIO * (high - low) / 2 else 0.0
        scale = max(abs(low - offset), abs(high - offset)) or 1.0  # float32 ends at 3e38 and loses digits below 1e-38
        data = ((curve - offset) / scale).astype("<f4").tobytes()
        packed[name] = {"offset": offset, "scale": scale, "data": b64encode(data).decode()}
    return {
        "name": source.name,
        "axis": axis,
        "style": source.style,
        "role": source.role or "",
        "light": look.light,
        "dark": look.dark,
        "dash": list(look.dash),
        "marker": look.marker,
        "isMarked": drawn.is_marked,
        "filled": look.filled,
        "isLabelled": source.level is not None,
        "onHover": source.on_hover,
        "width": look.width,
    } | packed

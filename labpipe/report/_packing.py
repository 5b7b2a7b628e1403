"""A chart as data for the page: thinned arrays in base64, and a description of how to draw them."""

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe.report._charts import Band, LineChart, Series, np_float
from labpipe.report._style import LineLook, level_look, looks
from labpipe.report._thinning import kept_samples

if TYPE_CHECKING:
    from labpipe.arrays import Floats

# A float32 resolves 6e-8 of its size. Where the curve is a small ripple on a large offset, the
# offset is taken out first, so that the ripple keeps its digits.
_OFFSET_RATIO = 100.0
_BASE64_GROWTH = 4 / 3
_BYTES_PER_SAMPLE = 4
# The window is a little wider than the points, so that no marker sits on the frame.
_MARGIN = 0.02


@dataclass(frozen=True)
class Drawn:
    """The part of one series that is drawn: after thinning, with values that an axis cannot show as gaps.

    ``source``: where it comes from; ``x`` (m,): positions; ``curves`` (m,): ``(y,)``, ``(y, u)`` or ``(low, high)``;
    ``look``: colour, dashes, marker; ``is_marked``: draw markers along the line: other lines of the chart differ from
    it in colour only.
    """

    source: Series | Band
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
    return int(words * _BYTES_PER_SAMPLE * _BASE64_GROWTH) + 1


def thin(chart: LineChart, max_bytes: int) -> ThinnedChart:
    """Choose the samples of a chart that fit into the given bytes.

    Series that share their `x` keep the same samples, so that `x` is stored once.

    Parameters
    ----------
    chart : LineChart or ScatterChart
        The chart.
    max_bytes : int
        Bytes in the page, base64 included.
    """
    ordered = sorted(chart.series, key=lambda s: s.style != "band")
    found = _looks_by_identity(chart.series)
    samples = [_showable(chart, series) for series in ordered]
    groups = _shared_axes([x for x, _ in samples])
    fraction = min(1.0, max_bytes / wanted_bytes(chart))
    windows = [(a, b) for _, a, b in chart.views]
    drawn: dict[int, Drawn] = {}
    n_all = n_kept = 0
    for members in groups:
        x = samples[members[0]][0]
        curves = [curve for m in members for curve in samples[m][1]]
        # A loop has extremes in both directions; they are sought along its course.
        along = x if chart.is_ordered else np.arange(x.size, dtype=np.float64)
        sought = curves if chart.is_ordered else [*curves, x]
        kept = kept_samples(along, sought, max(int(x.size * fraction), 64), windows)
        n_all += x.size
        n_kept += kept.size
        for m in members:
            series = ordered[m]
            values = tuple(curve[kept] for curve in samples[m][1])
            drawn[m] = Drawn(series, x[kept], values, found[id(series)], _is_marked(chart, series))
    notes = _notes(chart, n_all, n_kept)
    kept_series = tuple(drawn[m] for m in range(len(ordered)))
    return ThinnedChart(chart, kept_series, _x_range(chart, kept_series), notes)


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
        "lines": [[n, x] for n, x in chart.vlines],
        "axes": [_base64(thinned.series[members[0]].x, "<f8") for members in axes],
        "series": [_packed_series(d, axis_of[m]) for m, d in enumerate(thinned.series)],
    }


def _looks_by_identity(series: Sequence[Series | Band]) -> dict[int, LineLook]:
    """Look up bands and curves separately: the first band looks like the first curve."""
    found: dict[int, LineLook] = {}
    for kind in (Series, Band):
        chosen = [s for s in series if isinstance(s, kind) and s.level is None]
        found |= zip(map(id, chosen), looks([s.role for s in chosen]), strict=True)
    found |= {id(s): level_look(s.level) for s in series if s.level is not None}
    if len(series) == 1:
        # Dashes tell curves apart; a curve alone needs none, and its peaks want a whole line.
        found = {key: replace(look, dash=()) for key, look in found.items()}
    return found


def _is_marked(chart: LineChart, series: Series | Band) -> bool:
    """Return whether a line needs markers to be distinguished from its neighbours in grey print."""
    if series.level is not None:
        return series.style != "points"
    curves = [s for s in chart.series if s.style != "band" and s.level is None]
    # Points carry markers already, and markers along lines would hide them.
    if not chart.is_ordered or any(s.style == "points" for s in curves):
        return False
    return series in curves and series.role not in {None, "repeat"} and sum(s.role == series.role for s in curves) > 1


def _showable(chart: LineChart, series: Series | Band) -> "tuple[Floats, tuple[Floats, ...]]":
    """Return x and curves with everything that a logarithmic axis cannot show as gaps."""
    x, curves = np_float(series.x), series.curves
    if chart.x_scale == "log":
        curves = tuple(curve[x > 0] for curve in curves)
        x = x[x > 0]
    if chart.y_scale == "log":
        is_hidden = curves[0] <= 0
        curves = tuple(np.where(is_hidden, np.nan, curve) for curve in curves)
    return x, curves


def _shared_axes(axes: "Sequence[Floats]") -> list[list[int]]:
    """Group the places of equal arrays."""
    groups: dict[tuple[int, bytes], list[int]] = {}
    for place, x in enumerate(axes):
        groups.setdefault((x.size, x.tobytes()), []).append(place)
    return list(groups.values())


def _notes(chart: LineChart, n_all: int, n_kept: int) -> tuple[str, ...]:
    notes = []
    if n_kept < n_all:
        where = "Outside the named windows the" if chart.views else "The"
        notes.append(
            f"{where} curves are drawn through the smallest and largest samples of short stretches "
            f"({n_kept} of {n_all} samples are in this page)."
        )
    n_hidden = 0
    for series in chart.series:
        x, first = np_float(series.x), series.curves[0]
        hidden_x = (x <= 0) & (chart.x_scale == "log")
        n_hidden += int(np.count_nonzero(hidden_x | ((first <= 0) & (chart.y_scale == "log"))))
    if n_hidden:
        notes.append(
            f"{n_hidden} {'point is' if n_hidden == 1 else 'points are'} not shown: zero or "
            "negative on a logarithmic axis."
        )
    return tuple(notes)


def _x_range(chart: LineChart, series: tuple[Drawn, ...]) -> tuple[float, float]:
    filled = [d.x for d in series if d.x.size]
    if not filled:
        return (1.0, 10.0)
    low, high = min(float(x.min()) for x in filled), max(float(x.max()) for x in filled)
    has_points = any(d.source.style == "points" for d in series)
    return padded_range(low, high, chart.x_scale, _MARGIN if has_points or not chart.is_ordered else 0.0)


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
    names = ("low", "high") if source.style == "band" else ("y", "u")
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
        "isLabelled": source.level is not None and source.style != "points",
        "onHover": source.on_hover,
        "width": look.width,
    } | {name: _packed_curve(c) for name, c in zip(names, drawn.curves, strict=False)}


def _packed_curve(curve: "Floats") -> dict[str, Any]:
    """Store values as 32-bit numbers: ``offset + scale * data``."""
    finite = curve[np.isfinite(curve)]
    offset = low = high = 0.0
    if finite.size:
        low, high = float(finite.min()), float(finite.max())
        middle = low + (high - low) / 2
        offset = middle if abs(middle) > _OFFSET_RATIO * (high - low) / 2 else 0.0
    scale = max(abs(low - offset), abs(high - offset)) or 1.0  # float32 ends at 3e38 and loses digits below 1e-38
    return {"offset": offset, "scale": scale, "data": _base64((curve - offset) / scale, "<f4")}


def _base64(array: "Floats", form: str) -> str:
    return base64.b64encode(array.astype(form).tobytes()).decode("ascii")

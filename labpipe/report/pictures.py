"""The still picture of a chart: what is printed, and what is seen where scripts are switched off.

It is drawn from the same thinned data in the same colours as the interactive chart. It is written
as SVG directly: a page holds a dozen such pictures, and matplotlib, which lays out and draws a
picture in a second, took nine tenths of the time of a page.
"""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from labpipe.report import vector
from labpipe.report.charts import Band, LineChart, ScatterChart, Series
from labpipe.report.packing import Drawn, ThinnedChart, padded_range, thin
from labpipe.report.page import clean
from labpipe.report.style import COLUMN_WIDTHS_MM, MILLIMETRES_PER_INCH
from labpipe.report.thinning import kept_samples
from labpipe.report.ticks import Ticks, ticks
from labpipe.report.vector import text_width, units, write_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Numbers = NDArray[np.float64]

_WIDTH = COLUMN_WIDTHS_MM[2] / MILLIMETRES_PER_INCH * 72.0
# A chart on the screen is this wide when its height in the picture is worked out.
_SCREEN_WIDTH_PX = 800.0
_MAX_SMALL_PANELS = 3
_SMALL_PANEL_SHARE = 0.75
# More samples than this per panel are finer than a printer's dots along the width. Where many
# curves of noise would make a picture too large, the smallest and largest of fewer, wider
# stretches look the same.
_SAMPLES_PER_PANEL = (1600, 800, 400)
_MAX_BYTES = 90_000
_LONGEST_TEXT = 60
_MOST_POSITIONS = 150.0
_MARKER_SPACING = 0.12
_MARKER_SHIFT = 0.03

# Lengths in points.
_LETTER, _SMALL_LETTER = 8.0, 7.0
_EDGE = 2.0
_HEADING = 13.0
_LEGEND_ROW = 11.5
_SWATCH, _SWATCH_GAP, _LEGEND_GAP = 18.0, 5.0, 14.0
_TICK, _MINOR_TICK, _TICK_GAP = 3.0, 1.8, 3.5
_TICK_ROW, _LABEL_ROW = 12.0, 11.0
_PANEL_GAP = 7.0
_COLUMN_GAP = 12.0
_X_TICK_SPACING, _Y_TICK_SPACING = 52.0, 15.0
_LEAST_HEIGHT = 24.0
_ENOUGH_TICKS = 3
_CAP = 1.8


class _Frame(NamedTuple):
    """Where a panel lies in the picture (points; top and bottom count downwards)."""

    left: float
    right: float
    top: float
    bottom: float


class _Panel(NamedTuple):
    """One pair of axes: what is shown of the chart, and where."""

    chart: LineChart | ScatterChart
    series: tuple[Drawn, ...]
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    heading: str
    x_label: str
    frame: _Frame

    def x(self, values: "Numbers") -> "Numbers":
        """Bring values of the axis to points of the picture."""
        share = _shares(values, self.x_range, self.chart.x_scale)
        return self.frame.left + share * (self.frame.right - self.frame.left)

    def y(self, values: "Numbers") -> "Numbers":
        """Bring values of the axis to points of the picture."""
        share = _shares(values, self.y_range, self.chart.y_scale)
        return self.frame.bottom - share * (self.frame.bottom - self.frame.top)

    def x_ticks(self) -> Ticks:
        """As many as have room for their texts."""
        width = self.frame.right - self.frame.left
        most = max(int(width / _X_TICK_SPACING), 3)
        found = ticks(*self.x_range, self.chart.x_scale, most)
        while most > 2 and _crowd(found, width):
            most -= 1
            found = ticks(*self.x_range, self.chart.x_scale, most)
        return found

    def y_ticks(self) -> Ticks:
        """Choose ticks after the height of the panel; a scale needs three, if they have room."""
        height = self.frame.bottom - self.frame.top
        most = max(int(height / _Y_TICK_SPACING), 2)
        found = ticks(*self.y_range, self.chart.y_scale, most)
        while len(found.positions) < _ENOUGH_TICKS and most < height / _SMALL_LETTER - 1:
            most += 1
            found = ticks(*self.y_range, self.chart.y_scale, most)
        return found


def static_picture(thinned: ThinnedChart) -> bytes:
    """Draw a chart as an SVG file.

    The first three named views that show less than half of the range get a panel of their own
    below the whole.

    Parameters
    ----------
    thinned : ThinnedChart
        From :func:`labpipe.report.packing.thin`.

    Returns
    -------
    bytes
        A whole SVG file; the same chart gives the same bytes.
    """
    series = _without_hovered(thinned)
    views = _views(thinned)
    height = _WIDTH * thinned.chart.height_px / _SCREEN_WIDTH_PX
    height *= 1 + (_SMALL_PANEL_SHARE if views else 0)
    names = [_short(drawn.source.name) for drawn in series]
    legend, below = _legend(series, names)
    panels = _panels(thinned, series, views, _Frame(_EDGE, _WIDTH - _EDGE, below, height))
    parts = [*_definitions(series, panels), *legend]
    made, foot = b"", _TICK_ROW + _LABEL_ROW + _EDGE
    for samples in _SAMPLES_PER_PANEL:
        drawn = [part for place, p in enumerate(panels) for part in _draw(p, place, samples)]
        made = vector.picture(_WIDTH, panels[-1].frame.bottom + foot, parts + drawn)
        if len(made) <= _MAX_BYTES:
            break
    return made


def thumbnail(chart: LineChart | ScatterChart, width_px: int = 240) -> bytes:
    """Draw a chart without axes as a small SVG file, for an index page.

    Parameters
    ----------
    chart : LineChart or ScatterChart
        What to draw.
    width_px : int
        Width of the picture; its height is half of it.
    """
    thinned = thin(chart, max_bytes=100_000)
    series = _without_hovered(thinned)
    width = width_px * 72.0 / 100.0
    frame = _Frame(0.0, width, 0.0, width / 2)
    panel = _fitted(chart, series, thinned.x_range, frame)
    parts = [*_definitions(series, [panel]), *_curves(panel, 0, int(4 * width))]
    return vector.picture(width, width / 2, parts)


def _without_hovered(thinned: ThinnedChart) -> tuple[Drawn, ...]:
    """Leave out what shows only where somebody points."""
    return tuple(d for d in thinned.series if not getattr(d.source, "on_hover", False))


def _views(thinned: ThinnedChart) -> list[tuple[str, float, float]]:
    chart = thinned.chart
    if isinstance(chart, ScatterChart):
        return []
    whole = thinned.x_range[1] - thinned.x_range[0]
    narrow = [view for view in chart.views if view[2] - view[1] < whole / 2]
    return narrow[:_MAX_SMALL_PANELS]


def _short(text: str) -> str:
    """Bring a text onto one line that fits into the picture; the page holds it whole."""
    line = " ".join(clean(text).split())
    return line if len(line) <= _LONGEST_TEXT else f"{line[: _LONGEST_TEXT - 1]}…"


# --- the legend ----------------------------------------------------------------------------------


def _legend(series: Sequence[Drawn], names: Sequence[str]) -> tuple[list[str], float]:
    """Write the names in columns, row by row; return them with the height they take."""
    longest = max((text_width(name, _SMALL_LETTER) for name in names), default=0.0)
    column = _SWATCH + _SWATCH_GAP + longest + _LEGEND_GAP
    columns = max(int((_WIDTH + _LEGEND_GAP - 2 * _EDGE) / column), 1)
    parts = []
    for place, (drawn, name) in enumerate(zip(series, names, strict=True)):
        row, position = divmod(place, columns)
        left, middle = _EDGE + position * column, _EDGE + (row + 0.5) * _LEGEND_ROW
        parts += _swatch(drawn, place, left, middle)
        text = left + _SWATCH + _SWATCH_GAP
        parts.append(write_text(text, middle + 0.36 * _SMALL_LETTER, name, _SMALL_LETTER))
    return parts, _EDGE + -(-len(names) // columns) * _LEGEND_ROW


def _swatch(drawn: Drawn, place: int, left: float, middle: float) -> list[str]:
    x = np.array([left, left + _SWATCH])
    if isinstance(drawn.source, Band):
        return [_area(drawn, vector.area_path(x, x * 0 + middle - 2.5, x * 0 + middle + 2.5))]
    y, parts = x * 0 + middle, []
    if drawn.source.style != "points":
        parts.append(vector.stroke(vector.curve_path(x, y), drawn.look))
    centre = vector.whole(x.mean(keepdims=True), y[:1])
    if len(drawn.curves) == 2:
        parts.append(_bars(drawn, x.mean(keepdims=True), y[:1] - 4.0, y[:1] + 4.0))
    if _has_markers(drawn):
        parts.append(vector.marked(centre, f"m{place}"))
    return parts


# --- where everything lies -----------------------------------------------------------------------


def _panels(
    thinned: ThinnedChart,
    series: tuple[Drawn, ...],
    views: Sequence[tuple[str, float, float]],
    room: _Frame,
) -> list[_Panel]:
    """Lay out the whole above and the views below it; all texts have their room."""
    chart = thinned.chart
    rows = 2 if views else 1
    fixed = rows * (_HEADING + _TICK_ROW + _LABEL_ROW) + _EDGE + (rows - 1) * _PANEL_GAP
    share = room.bottom - room.top - fixed
    height = max(share / (1 + _SMALL_PANEL_SHARE) if views else share, _LEAST_HEIGHT)
    top = room.top + _HEADING
    frame = room._replace(top=top, bottom=top + height)
    main = _labelled(_fitted(chart, series, thinned.x_range, frame), chart.y_label, chart.x_label)
    top = frame.bottom + _TICK_ROW + _LABEL_ROW + _PANEL_GAP + _HEADING
    width = (room.right - room.left + _COLUMN_GAP) / max(len(views), 1)
    small = []
    for place, (name, start, stop) in enumerate(views):
        left = room.left + place * width
        frame = _Frame(left, left + width - _COLUMN_GAP, top, top + height * _SMALL_PANEL_SHARE)
        label = chart.x_label if place == len(views) // 2 else ""
        small.append(_labelled(_fitted(chart, series, (start, stop), frame), name, label))
    return [
        _beside_its_ticks(main, [main, *small[:1]]),
        *(_beside_its_ticks(p, small) for p in small),
    ]


def _fitted(
    chart: LineChart | ScatterChart,
    series: tuple[Drawn, ...],
    window: tuple[float, float],
    frame: _Frame,
) -> _Panel:
    """Choose the range of y after what a window of x shows."""
    extremes = [
        end
        for drawn in series
        for end in _ends(drawn, _part(drawn, window, None, chart)[1], chart.y_scale)
    ]
    low, high = (min(extremes), max(extremes)) if extremes else (1.0, 10.0)
    y_range = padded_range(low, high, chart.y_scale, 0.05)
    return _Panel(chart, series, window, y_range, "", "", frame)


def _labelled(panel: _Panel, heading: str, x_label: str) -> _Panel:
    return panel._replace(heading=_short(heading), x_label=_short(x_label))


def _beside_its_ticks(panel: _Panel, alike: Sequence[_Panel]) -> _Panel:
    """Move the left edge so far in that the texts of all panels like this one have room."""
    texts = [text for p in alike for text in p.y_ticks().texts]
    widest = max((text_width(text, _SMALL_LETTER) for text in texts), default=0.0)
    last = text_width((panel.x_ticks().texts or ("",))[-1], _SMALL_LETTER) / 2
    frame = panel.frame
    left = frame.left + widest + _TICK + _TICK_GAP
    at_the_edge = frame.right > _WIDTH - last
    right = frame.right - (last if at_the_edge else 0.0)
    return _with_equal_axes(panel._replace(frame=frame._replace(left=left, right=right)))


def _with_equal_axes(panel: _Panel) -> _Panel:
    """Widen one range until a unit is equally long on both axes, where a chart asks for it."""
    chart, frame = panel.chart, panel.frame
    if not (isinstance(chart, ScatterChart) and chart.has_equal_axes):
        return panel
    width, height = frame.right - frame.left, frame.bottom - frame.top
    unit = max(_length(panel.x_range) / width, _length(panel.y_range) / height)
    return panel._replace(
        x_range=_widened(panel.x_range, unit * width),
        y_range=_widened(panel.y_range, unit * height),
    )


def _length(ends: tuple[float, float]) -> float:
    return ends[1] - ends[0]


def _widened(ends: tuple[float, float], length: float) -> tuple[float, float]:
    middle = ends[0] + _length(ends) / 2
    return (middle - length / 2, middle + length / 2)


def _shares(values: "Numbers", ends: tuple[float, float], scale: str) -> "Numbers":
    """Tell which part of an axis lies before each value."""
    low, high = ends
    values = np.asarray(values, dtype=np.float64)
    if scale == "log":
        low, high = math.log10(low), math.log10(high)
        # Zero and less lie far off on a logarithmic axis.
        values = np.log10(np.where(values > 0, values, np.nan))
    return (values - low) / (high - low)


def _crowd(found: Ticks, width: float) -> bool:
    room = sum(text_width(text, _SMALL_LETTER) + _SMALL_LETTER for text in found.texts)
    return room > width


# --- drawing -------------------------------------------------------------------------------------


def _definitions(series: Sequence[Drawn], panels: Sequence[_Panel]) -> list[str]:
    """Define the markers, and the frames that curves are cut off at."""
    markers = [
        vector.marker_definition(f"m{place}", drawn.look)
        for place, drawn in enumerate(series)
        if _has_markers(drawn)
    ]
    frames = [
        f'<clipPath id="c{place}"><path d="{_outline(panel.frame)}"/></clipPath>'
        for place, panel in enumerate(panels)
    ]
    return ["<defs>", *markers, *frames, "</defs>"]


def _outline(frame: _Frame) -> str:
    left, right, top, bottom = map(units, frame)
    return f"M{left} {top}H{right}V{bottom}H{left}z"


def _draw(panel: _Panel, place: int, samples: int) -> list[str]:
    """Draw a panel: its grid, its curves, then its axes with their texts."""
    x_ticks, y_ticks = panel.x_ticks(), panel.y_ticks()
    frame = panel.frame
    at_x = panel.x(np.array(x_ticks.positions))
    at_y = panel.y(np.array(y_ticks.positions))
    left, right, top, bottom = map(units, frame)
    grid = "".join(f"M{units(x)} {bottom}V{top}" for x in at_x)
    grid += "".join(f"M{left} {units(y)}H{right}" for y in at_y)
    return [
        _thin(grid, "#e2e2e2", 0.5),
        *_curves(panel, place, samples),
        _thin(f"M{left} {top}V{bottom}H{right}{_tick_path(panel, x_ticks, y_ticks)}", "#000", 0.6),
        *_texts(
            panel, zip(at_x, x_ticks.texts, strict=True), zip(at_y, y_ticks.texts, strict=True)
        ),
    ]


def _thin(path: str, colour: str, width: float, dashes: str = "") -> str:
    return (
        f'<path fill="none" stroke="{colour}" stroke-width="{units(width)}"{dashes} d="{path}"/>'
        if path
        else ""
    )


def _tick_path(panel: _Panel, x_ticks: Ticks, y_ticks: Ticks) -> str:
    left, bottom = units(panel.frame.left), units(panel.frame.bottom)
    path = ""
    for length, x, y in (
        (_TICK, x_ticks.positions, y_ticks.positions),
        (_MINOR_TICK, x_ticks.minor, y_ticks.minor),
    ):
        path += "".join(f"M{units(p)} {bottom}v{units(length)}" for p in panel.x(np.array(x)))
        path += "".join(f"M{left} {units(p)}h-{units(length)}" for p in panel.y(np.array(y)))
    return path


def _texts(
    panel: _Panel, at_x: Iterable[tuple[float, str]], at_y: Iterable[tuple[float, str]]
) -> list[str]:
    """Name x below and y above the axes, where a long name has room even on a low chart."""
    frame, middle = panel.frame, (panel.frame.left + panel.frame.right) / 2
    below = frame.bottom + _TICK_ROW
    parts = [write_text(x, below - 1.0, text, _SMALL_LETTER, "middle") for x, text in at_x]
    beside, foot = frame.left - _TICK - _TICK_GAP, 0.36 * _SMALL_LETTER
    parts += [write_text(beside, y + foot, text, _SMALL_LETTER, "end") for y, text in at_y]
    parts.append(write_text(frame.left, frame.top - 4.0, panel.heading, _LETTER))
    if panel.x_label:
        place = below + _LABEL_ROW - 2.0
        parts.append(write_text(middle, place, panel.x_label, _LETTER, "middle"))
    return parts


def _curves(panel: _Panel, place: int, samples: int) -> list[str]:
    """Draw all series of a panel, and the positions marked in it."""
    chart, frame = panel.chart, panel.frame
    parts = [f'<g clip-path="url(#c{place})">']
    left, right, top, bottom = map(units, frame)
    is_difference = any(d.source.role == "residual" for d in panel.series)
    if is_difference and chart.y_scale == "linear":
        zero = units(float(panel.y(np.zeros(1))[0]))
        parts.append(_thin(f"M{left} {zero}H{right}", "#808080", 0.6))
    marked = _uncrowded([x for _, x in getattr(chart, "vlines", ())], panel.x_range)
    lines = "".join(f"M{units(x)} {bottom}V{top}" for x in panel.x(np.array(marked)))
    parts.append(_thin(lines, "#a0a0a0", 0.5, ' stroke-dasharray="10 20"'))
    for position, drawn in enumerate(panel.series):
        parts += _one(panel, drawn, position, samples)
    return [part for part in [*parts, "</g>"] if part]


def _uncrowded(positions: Sequence[float], window: tuple[float, float]) -> list[float]:
    """Leave out marked positions that would merge into a grey block."""
    shown: list[float] = []
    nearest = (window[1] - window[0]) / _MOST_POSITIONS
    for position in sorted(positions):
        if window[0] <= position <= window[1] and (not shown or position - shown[-1] > nearest):
            shown.append(position)
    return shown


def _one(panel: _Panel, drawn: Drawn, place: int, samples: int) -> list[str]:
    """Draw one series."""
    values, curves = _part(drawn, panel.x_range, samples, panel.chart)
    x, y = panel.x(values), panel.y(curves[0])
    if isinstance(drawn.source, Band):
        return [_area(drawn, vector.area_path(x, y, panel.y(curves[1])))]
    if drawn.source.style == "step":
        x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
    parts = []
    if len(curves) == 2:
        u = _error_lengths(curves[1])
        parts.append(_bars(drawn, x, panel.y(curves[0] - u), panel.y(curves[0] + u)))
    if drawn.source.style != "points":
        parts.append(vector.stroke(vector.curve_path(x, y), drawn.look))
    if _has_markers(drawn):
        is_shown = np.isfinite(x) & np.isfinite(y)
        x, y = x[is_shown], y[is_shown]
        if drawn.source.style != "points":
            chosen = _along(x, y, place, panel.frame)
            x, y = x[chosen], y[chosen]
        parts.append(vector.marked(vector.whole(x, y), f"m{place}"))
    return parts


def _part(
    drawn: Drawn,
    window: tuple[float, float],
    samples: int | None,
    chart: LineChart | ScatterChart,
) -> "tuple[Numbers, tuple[Numbers, ...]]":
    """Cut a series to a window and thin it to what the panel can resolve."""
    x, curves = drawn.x, drawn.curves
    along, sought = x, list(curves)
    if isinstance(chart, ScatterChart):
        along, sought = np.arange(x.size, dtype=float), [*curves, x]
    else:
        first = max(int(np.searchsorted(x, window[0], "left")) - 1, 0)
        last = int(np.searchsorted(x, window[1], "right")) + 1
        x, curves = x[first:last], tuple(curve[first:last] for curve in curves)
        along, sought = x, list(curves)
    if samples is None or x.size == 0:
        return x, curves
    kept = kept_samples(along, sought, samples)
    return x[kept], tuple(curve[kept] for curve in curves)


def _has_markers(drawn: Drawn) -> bool:
    return isinstance(drawn.source, Series) and (drawn.source.style == "points" or drawn.is_marked)


def _along(x: "Numbers", y: "Numbers", place: int, frame: _Frame) -> "NDArray[np.intp]":
    """Choose the samples of a line that carry its markers: evenly along what is seen of it."""
    if x.size == 0:
        return np.zeros(0, dtype=np.intp)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    diagonal = math.hypot(frame.right - frame.left, frame.bottom - frame.top)
    wanted = np.arange(_MARKER_SHIFT * place, way[-1] / diagonal, _MARKER_SPACING) * diagonal
    return np.unique(np.searchsorted(way, wanted))


def _area(drawn: Drawn, path: str) -> str:
    return f'<path fill="{drawn.look.light}" fill-opacity=".22" d="{path}"/>'


def _bars(drawn: Drawn, x: "Numbers", low: "Numbers", high: "Numbers") -> str:
    """Draw error bars with their caps."""
    is_shown = np.isfinite(x) & np.isfinite(high)
    # A bar that reaches below zero has no lower end on a logarithmic axis.
    low = np.where(np.isfinite(low), low, 1e4)[is_shown]
    ends = zip(
        vector.whole(x[is_shown], low), vector.whole(x[is_shown], high[is_shown]), strict=True
    )
    cap = units(_CAP)
    path = "".join(
        f"M{a} {b}V{d}M{a - cap} {b}h{2 * cap}M{a - cap} {d}h{2 * cap}" for (a, b), (_, d) in ends
    )
    return _thin(path, drawn.look.light, 0.7)


def _error_lengths(u: "Numbers") -> "Numbers":
    return np.where(np.isfinite(u), np.abs(u), 0.0)


def _ends(drawn: Drawn, curves: "tuple[Numbers, ...]", scale: str) -> list[float]:
    """Return the smallest and largest value of a series, error bars included."""
    first, second = curves[0], curves[-1]
    if isinstance(drawn.source, Series) and len(curves) == 2:
        u = _error_lengths(curves[1])
        first, second = first - u, first + u
    both = np.concatenate([first, second])
    shown = both[np.isfinite(both) & ((both > 0) | (scale == "linear"))]
    return [float(shown.min()), float(shown.max())] if shown.size else []

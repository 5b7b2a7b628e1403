"""The still picture of a chart: what is printed, and what is seen where scripts are switched off.

It is drawn from the same thinned data in the same colours as the interactive chart.
"""

import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe.report.charts import Band, LineChart, ScatterChart, Series
from labpipe.report.packing import Drawn, ThinnedChart, padded_range, thin
from labpipe.report.page import clean
from labpipe.report.style import (
    MATPLOTLIB_MARKERS,
    figure_bytes,
    figure_style,
    matplotlib_dash,
)
from labpipe.report.tables import power_of_ten
from labpipe.report.thinning import kept_samples

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

# A chart on the screen is this wide when its height in the picture is worked out.
_SCREEN_WIDTH_PX = 800.0
_MAX_SMALL_PANELS = 3
_SMALL_PANEL_SHARE = 0.75
# More samples than this per panel are finer than a printer's dots along the width.
_SAMPLES_PER_PANEL = 1600
# Beyond this a vector picture is larger than a raster of printing quality.
_MAX_VECTOR_BYTES = 90_000
_RASTER_DPI = 170.0
# About as many characters of legend text fit beside each other; a line sample takes eight.
_LEGEND_CHARACTERS = 130
_SWATCH_CHARACTERS = 8
_LONGEST_TEXT = 60
_SMALL_PANEL_TICKS = 4
_MOST_POSITIONS = 150.0
_MARKER_SPACING = 0.12
# Hundredths of a point are finer than any printer; matplotlib writes millionths.
_LONG_NUMBER = re.compile(rb"(\.\d\d)\d+")
_PATH = re.compile(rb'\bd="[^"]*"')


def static_picture(thinned: ThinnedChart) -> bytes:
    """Draw a chart as an SVG file, or as a PNG file when that is smaller.

    The first three named views that show less than half of the range get a panel of their own
    below the whole.

    Parameters
    ----------
    thinned : ThinnedChart
        From :func:`labpipe.report.packing.thin`.

    Returns
    -------
    bytes
        A whole SVG or PNG file; the same chart gives the same bytes.
    """
    thinned = _without_hovered(thinned)
    views = _panels(thinned)
    height = thinned.chart.height_px / _SCREEN_WIDTH_PX
    with _chart_style(height * (1 + (_SMALL_PANEL_SHARE if views else 0))):
        figure = _draw(thinned, views)
        vector = _PATH.sub(_shortened, _quietly(figure, "svg", None))
        if len(vector) <= _MAX_VECTOR_BYTES:
            return vector
        raster = _quietly(figure, "png", _RASTER_DPI)
        return min(vector, raster, key=len)


def thumbnail(chart: LineChart | ScatterChart, width_px: int = 240) -> bytes:
    """Draw a chart without axes as a small PNG file, for an index page.

    Parameters
    ----------
    chart : LineChart or ScatterChart
        What to draw.
    width_px : int
        Width of the picture; its height is half of it.
    """
    from matplotlib.figure import Figure

    dpi = 100.0
    thinned = thin(chart, max_bytes=100_000)
    with _chart_style(0.5):
        figure = Figure(
            figsize=(width_px / dpi, width_px / dpi / 2),
        )
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        _plot(axes, thinned, thinned.x_range)
        axes.set_axis_off()
        return _quietly(figure, "png", dpi)


def _without_hovered(thinned: ThinnedChart) -> ThinnedChart:
    """Leave out what shows only where somebody points."""
    kept = tuple(d for d in thinned.series if not getattr(d.source, "on_hover", False))
    return replace(thinned, series=kept)


def _shortened(path: "re.Match[bytes]") -> bytes:
    return _LONG_NUMBER.sub(rb"\1", path.group())


def _chart_style(aspect: float) -> Any:
    return figure_style(columns=2, aspect=aspect)


def _panels(thinned: ThinnedChart) -> list[tuple[str, float, float]]:
    chart = thinned.chart
    if isinstance(chart, ScatterChart):
        return []
    whole = thinned.x_range[1] - thinned.x_range[0]
    narrow = [view for view in chart.views if view[2] - view[1] < whole / 2]
    return narrow[:_MAX_SMALL_PANELS]


def _draw(thinned: ThinnedChart, views: Sequence[tuple[str, float, float]]) -> "Figure":
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    chart = thinned.chart
    figure = Figure()
    figure.set_layout_engine("constrained", h_pad=2 / 72, w_pad=2 / 72)
    if views:
        grid = figure.add_gridspec(2, len(views), height_ratios=[1, _SMALL_PANEL_SHARE])
        main = figure.add_subplot(grid[0, :])
    else:
        main = figure.add_subplot()
    handles = _plot(main, thinned, thinned.x_range)
    _label(main, chart.x_label, chart.y_label)
    if isinstance(chart, ScatterChart) and chart.has_equal_axes:
        main.set_aspect("equal", adjustable="datalim")
    for place, (name, start, stop) in enumerate(views):
        panel = figure.add_subplot(grid[1, place])
        _plot(panel, thinned, (start, stop))
        _label(panel, chart.x_label if place == len(views) // 2 else "", name)
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(MaxNLocator(_SMALL_PANEL_TICKS))
    _legend(figure, handles, [drawn.source.name for drawn in thinned.series])
    return figure


def _label(axes: "Axes", x_label: str, heading: str) -> None:
    """Name x below and y above the axes, where a long name has room even on a low chart."""
    # A dollar sign in a label is a dollar sign, not a formula.
    axes.set_xlabel(_short(x_label), parse_math=False)
    axes.set_title(_short(heading), parse_math=False)


def _short(text: str) -> str:
    """Bring a text onto one line that fits into the picture; the page holds it whole."""
    line = " ".join(clean(text).split())
    return line if len(line) <= _LONGEST_TEXT else f"{line[: _LONGEST_TEXT - 1]}…"


def _legend(figure: "Figure", handles: Sequence[Any], texts: Sequence[str]) -> None:
    names = [_short(text) for text in texts]
    longest = max(map(len, names), default=0)
    columns = min(max(_LEGEND_CHARACTERS // (longest + _SWATCH_CHARACTERS), 1), len(handles))
    rows = -(-len(handles) // columns)
    # matplotlib fills columns first; a reader reads along the rows.
    order = [r * columns + c for c in range(columns) for r in range(rows)]
    order = [place for place in order if place < len(handles)]
    legend = figure.legend(
        [handles[place] for place in order],
        [names[place] for place in order],
        loc="outside upper left",
        ncols=columns,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)


def _plot(axes: "Axes", thinned: ThinnedChart, window: tuple[float, float]) -> list[Any]:
    """Draw everything inside a window of x; return one legend handle per series."""
    chart = thinned.chart
    axes.set_xscale(chart.x_scale)
    axes.set_yscale(chart.y_scale)
    axes.set_xlim(*window)
    if any(d.source.role == "residual" for d in thinned.series) and chart.y_scale == "linear":
        axes.axhline(0.0, color="#808080", linewidth=0.6)
    for position in _uncrowded([x for _, x in getattr(chart, "vlines", ())], window):
        axes.axvline(position, color="#a0a0a0", linewidth=0.5, linestyle=(0.0, (1.0, 2.0)))
    extremes: list[float] = []
    handles: list[Any] = []
    for place, drawn in enumerate(thinned.series):
        x, curves = _part(drawn, window, is_loop=isinstance(chart, ScatterChart))
        handles.append(_plot_one(axes, drawn, place, x, curves))
        extremes += _ends(drawn, curves, chart.y_scale)
    if extremes:
        axes.set_ylim(*padded_range(min(extremes), max(extremes), chart.y_scale, 0.05))
    _ticks(axes, chart)
    return handles


def _uncrowded(positions: Sequence[float], window: tuple[float, float]) -> list[float]:
    """Leave out marked positions that would merge into a grey block."""
    shown: list[float] = []
    nearest = (window[1] - window[0]) / _MOST_POSITIONS
    for position in sorted(positions):
        if window[0] <= position <= window[1] and (not shown or position - shown[-1] > nearest):
            shown.append(position)
    return shown


def _part(
    drawn: Drawn, window: tuple[float, float], *, is_loop: bool
) -> "tuple[NDArray[np.float64], tuple[NDArray[np.float64], ...]]":
    """Cut a series to a window and thin it to what the panel can resolve."""
    x, curves = drawn.x, drawn.curves
    if is_loop:
        kept = kept_samples(np.arange(x.size, dtype=float), [*curves, x], _SAMPLES_PER_PANEL)
        return x[kept], tuple(curve[kept] for curve in curves)
    first = max(int(np.searchsorted(x, window[0], "left")) - 1, 0)
    last = int(np.searchsorted(x, window[1], "right")) + 1
    x, curves = x[first:last], tuple(curve[first:last] for curve in curves)
    if x.size == 0:
        return x, curves
    kept = kept_samples(x, curves, _SAMPLES_PER_PANEL)
    return x[kept], tuple(curve[kept] for curve in curves)


def _plot_one(
    axes: "Axes",
    drawn: Drawn,
    place: int,
    x: "NDArray[np.float64]",
    curves: "tuple[NDArray[np.float64], ...]",
) -> Any:
    """Draw one series; return what stands for it in the legend."""
    source, look = drawn.source, drawn.look
    if isinstance(source, Band):
        return axes.fill_between(x, curves[0], curves[1], color=look.light, alpha=0.22, linewidth=0)
    arguments = _line_look(drawn, place)
    if len(curves) == 1:
        return axes.plot(x, curves[0], **arguments)[0]
    u = _error_lengths(curves[1])
    return axes.errorbar(
        x, curves[0], yerr=u, elinewidth=0.7, capsize=1.8, capthick=0.7, **arguments
    )


def _line_look(drawn: Drawn, place: int) -> dict[str, Any]:
    look, style = drawn.look, getattr(drawn.source, "style", "line")
    marker = {
        "marker": MATPLOTLIB_MARKERS[look.marker],
        "markerfacecolor": look.light if look.filled else "white",
        "markeredgewidth": 0.8,
    }
    if style == "points":
        return {"color": look.light, "linestyle": "none", "zorder": 3, **marker}
    line = {
        "color": look.light,
        "linewidth": look.width,
        "linestyle": matplotlib_dash(look),
        "drawstyle": "steps-post" if style == "step" else "default",
    }
    if drawn.is_marked:
        line |= marker | {"markevery": (0.03 * place, _MARKER_SPACING)}
    return line


def _error_lengths(u: "NDArray[np.float64]") -> "NDArray[np.float64]":
    return np.where(np.isfinite(u), np.abs(u), 0.0)


def _ends(drawn: Drawn, curves: "tuple[NDArray[np.float64], ...]", scale: str) -> list[float]:
    """Return the smallest and largest value of a series, error bars included."""
    first, second = curves[0], curves[-1]
    if isinstance(drawn.source, Series) and len(curves) == 2:
        u = _error_lengths(curves[1])
        first, second = first - u, first + u
    both = np.concatenate([first, second])
    shown = both[np.isfinite(both) & ((both > 0) | (scale == "linear"))]
    return [float(shown.min()), float(shown.max())] if shown.size else []


def _ticks(axes: "Axes", chart: LineChart | ScatterChart) -> None:
    """Write ticks as the interactive chart does, without formulas and without offsets."""
    from matplotlib.ticker import FuncFormatter, NullFormatter, ScalarFormatter

    for axis, scale in ((axes.xaxis, chart.x_scale), (axes.yaxis, chart.y_scale)):
        if scale == "linear":
            plain = ScalarFormatter(useOffset=False, useMathText=False)
            plain.set_powerlimits((-6, 7))
            axis.set_major_formatter(plain)
            continue
        low, high = axis.get_view_interval()
        axis.set_major_formatter(FuncFormatter(_power_tick))
        has_few_powers = math.log10(high / low) < 2 if low > 0 else False
        axis.set_minor_formatter(FuncFormatter(_minor_tick) if has_few_powers else NullFormatter())


def _power_tick(value: float, _: object = None) -> str:
    exponent = round(math.log10(value))
    return f"{value:.6g}" if -3 <= exponent <= 3 else power_of_ten(exponent)


def _minor_tick(value: float, _: object = None) -> str:
    exponent = math.floor(math.log10(value) + 1e-9)
    digit = round(value / 10.0**exponent)
    if digit not in {2, 5}:
        return ""
    return f"{value:.1g}" if -3 <= exponent <= 3 else f"{digit}·{power_of_ten(exponent)}"


def _quietly(figure: "Figure", file_format: str, dpi: float | None) -> bytes:
    """Draw without matplotlib's remark that its own font lacks a character.

    The text of an SVG file is drawn by the browser, which finds another font.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        return figure_bytes(figure, file_format, dpi)

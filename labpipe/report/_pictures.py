"""The static picture of a chart, for print and for browsers without scripts.

It is drawn from the same thinned data in the same colours as the interactive chart. A page holds
a dozen such pictures, so each is drawn once: its layout is reckoned from the sizes of its texts,
where a layout engine would draw it twice more to find the same places.
"""

import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from io import StringIO
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe.report._charts import Band, LineChart, ScatterChart, Series
from labpipe.report._packing import Drawn, ThinnedChart, padded_range, thin
from labpipe.report._page import clean
from labpipe.report._style import MATPLOTLIB_MARKERS, figure_bytes, figure_style, matplotlib_dash
from labpipe.report._tables import power_of_ten
from labpipe.report._thinning import kept_samples

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

# A chart on the screen is this wide when its height in the picture is worked out.
_SCREEN_WIDTH_PX = 800.0
_MAX_SMALL_PANELS = 3
_SMALL_PANEL_SHARE = 0.75
# More samples than this per panel are finer than a printer's dots along the width; fewer show.
_MOST_SAMPLES, _LEAST_SAMPLES = 1600, 400
# So many make a vector picture as large as a raster of printing quality,
_SAMPLES_PER_PICTURE = 8000
# which has about this size.
_MAX_VECTOR_BYTES = 90_000
_RASTER_DPI = 170.0
_LONGEST_TEXT = 60
_SMALL_PANEL_TICKS = 4
_MOST_POSITIONS = 150.0
_LABEL_SIZE = (0.08, 0.05)  # of the axes, which a name of a curve takes
_MARKER_SPACING = 0.12

# Lengths in points.
_POINTS_PER_INCH = 72.0
_EDGE = 2.0
_LEGEND_ROW = 11.5
_SWATCH = 24.0
_LEGEND_GAP = 14.0
_HEADING = 14.0
_FOOT = 27.0
_TICK_GAP = 7.0
_COLUMN_GAP = 12.0
_LEAST_HEIGHT = 24.0
# Hundredths of a point are finer than any printer; matplotlib writes millionths.
_LONG_NUMBER = re.compile(r"(\.\d\d)\d+")
_PATH = re.compile(r'\bd="[^"]*"')


def static_picture(thinned: ThinnedChart) -> bytes:
    """Draw a chart as an SVG file, or as a PNG file when that is smaller.

    The first three named views that show less than half of the range get a panel of their own
    below the whole.

    Parameters
    ----------
    thinned : ThinnedChart
        From :func:`.thin`.

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
        vector = _vector(figure)
        if len(vector) <= _MAX_VECTOR_BYTES:
            return vector
        raster = _raster(figure, _RASTER_DPI)
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
        figure = Figure(figsize=(width_px / dpi, width_px / dpi / 2))
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        _plot(axes, thinned, thinned.x_range)
        axes.set_axis_off()
        return _raster(figure, dpi)


def _without_hovered(thinned: ThinnedChart) -> ThinnedChart:
    """Leave out what shows only where somebody points."""
    kept = tuple(d for d in thinned.series if not getattr(d.source, "on_hover", False))
    return replace(thinned, series=kept)


def _shortened(path: "re.Match[str]") -> str:
    return _LONG_NUMBER.sub(r"\1", path.group())


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
    figure.set_layout_engine("none")
    main = figure.add_subplot()
    rows = _legend(figure, _plot(main, thinned, thinned.x_range), [d.source.name for d in thinned.series])
    _label(main, chart.x_label, chart.y_label)
    if isinstance(chart, ScatterChart) and chart.has_equal_axes:
        main.set_aspect("equal", adjustable="datalim")
    small = []
    for place, (name, start, stop) in enumerate(views):
        panel = figure.add_subplot()
        _plot(panel, thinned, (start, stop))
        _label(panel, chart.x_label if place == len(views) // 2 else "", name)
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(MaxNLocator(_SMALL_PANEL_TICKS))
        small.append(panel)
    _place(figure, main, small, rows)
    return figure


def _place(figure: "Figure", main: "Axes", small: Sequence["Axes"], legend_rows: int) -> None:
    """Give every panel its place, with room for the texts around it."""
    width, height = (_POINTS_PER_INCH * float(n) for n in figure.get_size_inches())
    above = _EDGE + legend_rows * _LEGEND_ROW + _HEADING
    room = height - above - _FOOT
    share = 1.0
    if small:
        room -= _HEADING + _FOOT
        share = 1.0 / (1.0 + _SMALL_PANEL_SHARE)
    tall = max(room * share, _LEAST_HEIGHT)

    def put(axes: "Axes", left: float, right: float, top: float, bottom: float) -> None:
        axes.set_position((left / width, 1 - bottom / height, (right - left) / width, (bottom - top) / height))

    # Ticks depend on the size of the panel, and its left edge on their texts: two rounds do.
    put(main, 0.0, width, above, above + tall)
    left, right = _beside(main)
    put(main, _EDGE + left, width - _EDGE - right, above, above + tall)
    top = above + tall + _FOOT + _HEADING
    column = (width - 2 * _EDGE + _COLUMN_GAP) / max(len(small), 1)
    for place, panel in enumerate(small):
        begin = _EDGE + place * column
        end = begin + column - _COLUMN_GAP
        put(panel, begin, end, top, top + tall * _SMALL_PANEL_SHARE)
        left, right = _beside(panel)
        put(panel, begin + left, end - right, top, top + tall * _SMALL_PANEL_SHARE)


def _beside(axes: "Axes") -> tuple[float, float]:
    """Reckon the room that texts of ticks take left of a panel, and right of it (points)."""
    from matplotlib import rcParams

    size = rcParams["ytick.labelsize"]
    at_y = [_text_width(text, size) for text in _tick_texts(axes.yaxis)]
    at_x = [_text_width(text, size) for text in _tick_texts(axes.xaxis)]
    return max(at_y, default=0.0) + _TICK_GAP, max(at_x, default=0.0) / 2


def _tick_texts(axis: "Axis") -> list[str]:
    low, high = sorted(axis.get_view_interval())
    places = [p for p in axis.get_majorticklocs() if low <= p <= high]
    texts = axis.get_major_formatter().format_ticks(places)
    minor = [p for p in axis.get_minorticklocs() if low <= p <= high]
    return [*texts, *axis.get_minor_formatter().format_ticks(minor)]


def _text_width(text: str, size: float) -> float:
    """Measure a text in points; ``size`` is that of its letters."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    with _no_remark_on_glyphs():
        width, _, _ = text_to_path.get_text_width_height_descent(text, FontProperties(size=size), ismath=False)
    return float(width)


def _label(axes: "Axes", x_label: str, heading: str) -> None:
    """Name x below and y above the axes, where a long name has room even on a low chart."""
    # A dollar sign in a label is a dollar sign, not a formula.
    axes.set_xlabel(_short(x_label), parse_math=False)
    axes.set_title(_short(heading), parse_math=False, y=1.0)


def _short(text: str) -> str:
    """Bring a text onto one line that fits into the picture; the page holds it whole."""
    line = " ".join(clean(text).split())
    return line if len(line) <= _LONGEST_TEXT else f"{line[: _LONGEST_TEXT - 1]}…"


def _legend(figure: "Figure", handles: Sequence[Any], texts: Sequence[str]) -> int:
    """Name the curves at the top of the picture; return how many rows that takes."""
    from matplotlib import rcParams

    names, size = [_short(text) for text in texts], rcParams["legend.fontsize"]
    longest = max((_text_width(name, size) for name in names), default=0.0)
    room = figure.get_figwidth() * _POINTS_PER_INCH + _LEGEND_GAP
    columns = min(max(int(room / (_SWATCH + longest + _LEGEND_GAP)), 1), len(handles))
    rows = -(-len(handles) // columns)
    # matplotlib fills columns first; a reader reads along the rows.
    order = [r * columns + c for c in range(columns) for r in range(rows)]
    order = [place for place in order if place < len(handles)]
    legend = figure.legend(
        [handles[place] for place in order],
        [names[place] for place in order],
        loc="upper left",
        ncols=columns,
        columnspacing=_LEGEND_GAP / size,
        borderpad=0.0,
        borderaxespad=_EDGE / size,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
    return rows


def _plot(axes: "Axes", thinned: ThinnedChart, window: tuple[float, float]) -> list[Any]:
    """Draw everything inside a window of x; return one legend handle per series."""
    chart = thinned.chart
    axes.set_xscale(chart.x_scale)
    axes.set_yscale(chart.y_scale)
    axes.set_xlim(*window)
    axes.set_autoscale_on(False)
    if any(d.source.role == "residual" for d in thinned.series) and chart.y_scale == "linear":
        axes.axhline(0.0, color="#808080", linewidth=0.6)
    for position in _uncrowded([x for _, x in getattr(chart, "vlines", ())], window):
        axes.axvline(position, color="#a0a0a0", linewidth=0.5, linestyle=(0.0, (1.0, 2.0)))
    curves_drawn = max(len(thinned.series), 1) * (1 + len(_panels(thinned)))
    most = min(max(_SAMPLES_PER_PICTURE // curves_drawn, _LEAST_SAMPLES), _MOST_SAMPLES)
    extremes: list[float] = []
    handles: list[Any] = []
    for place, drawn in enumerate(thinned.series):
        x, curves = _part(drawn, window, most, is_loop=isinstance(chart, ScatterChart))
        handles.append(_plot_one(axes, drawn, place, x, curves))
        extremes += _ends(drawn, curves, chart.y_scale)
    if extremes:
        axes.set_ylim(*padded_range(min(extremes), max(extremes), chart.y_scale, 0.05))
    _ticks(axes, chart)
    _labels(axes, thinned.series, window)
    return handles


def _labels(axes: "Axes", series: Sequence[Drawn], window: tuple[float, float]) -> None:
    """Name the curves of a family at their ends; leave out what would cover another name."""
    family = [d for d in series if isinstance(d.source, Series) and d.source.level is not None]
    family = [d for d in family if d.source.style != "points"]  # type: ignore[union-attr]  # a family has no bands
    # Both ends of the scale first: they say where it begins and where it ends.
    order = sorted(range(len(family)), key=lambda i: (0 < i < len(family) - 1, i))
    taken: list[tuple[float, float]] = []
    for drawn in (family[i] for i in order):
        inside = np.flatnonzero(np.isfinite(drawn.curves[0]) & (drawn.x >= window[0]) & (drawn.x <= window[1]))
        if not inside.size:
            continue
        point = float(drawn.x[inside[-1]]), float(drawn.curves[0][inside[-1]])
        across, up = axes.transAxes.inverted().transform(axes.transData.transform(point))
        if any(abs(across - x) < _LABEL_SIZE[0] and abs(up - y) < _LABEL_SIZE[1] for x, y in taken):
            continue
        taken.append((across, up))
        axes.annotate(
            clean(drawn.source.name), point, (0, 2), textcoords="offset points", ha="right", va="bottom",
            fontsize=6.0, color=drawn.look.light, clip_on=True,
        )  # fmt: skip


def _uncrowded(positions: Sequence[float], window: tuple[float, float]) -> list[float]:
    """Leave out marked positions that would merge into a grey block."""
    shown: list[float] = []
    nearest = (window[1] - window[0]) / _MOST_POSITIONS
    for position in sorted(positions):
        if window[0] <= position <= window[1] and (not shown or position - shown[-1] > nearest):
            shown.append(position)
    return shown


def _part(
    drawn: Drawn, window: tuple[float, float], most: int, *, is_loop: bool
) -> "tuple[NDArray[np.float64], tuple[NDArray[np.float64], ...]]":
    """Cut a series to a window and thin it to what the panel can resolve."""
    x, curves = drawn.x, drawn.curves
    if is_loop:
        kept = kept_samples(np.arange(x.size, dtype=float), [*curves, x], most)
        return x[kept], tuple(curve[kept] for curve in curves)
    first = max(int(np.searchsorted(x, window[0], "left")) - 1, 0)
    last = int(np.searchsorted(x, window[1], "right")) + 1
    x, curves = x[first:last], tuple(curve[first:last] for curve in curves)
    if x.size == 0:
        return x, curves
    kept = kept_samples(x, curves, most)
    return x[kept], tuple(curve[kept] for curve in curves)


def _plot_one(
    axes: "Axes", drawn: Drawn, place: int, x: "NDArray[np.float64]", curves: "tuple[NDArray[np.float64], ...]"
) -> Any:
    """Draw one series; return what stands for it in the legend."""
    source, look = drawn.source, drawn.look
    if isinstance(source, Band):
        return axes.fill_between(x, curves[0], curves[1], color=look.light, alpha=0.22, linewidth=0)
    arguments = _line_look(drawn, place)
    if len(curves) == 1:
        return axes.plot(x, curves[0], **arguments)[0]
    u = _error_lengths(curves[1])
    return axes.errorbar(x, curves[0], yerr=u, elinewidth=0.7, capsize=1.8, capthick=0.7, **arguments)


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


def _vector(figure: "Figure") -> bytes:
    """Draw once; ``savefig`` draws twice, for layout engines and tight boxes that are not used."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    target = StringIO()
    with _no_remark_on_glyphs():
        FigureCanvasSVG(figure).print_svg(target, metadata={"Date": None})  # type: ignore[no-untyped-call]
    return _PATH.sub(_shortened, target.getvalue()).encode()


def _raster(figure: "Figure", dpi: float) -> bytes:
    with _no_remark_on_glyphs():
        return figure_bytes(figure, "png", dpi)


@contextmanager
def _no_remark_on_glyphs() -> Iterator[None]:
    """Silence matplotlib where its own font lacks a character; a browser finds another font."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield

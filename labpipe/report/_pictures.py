"""The static picture of a chart, for print and for browsers without scripts.

It is drawn from the same thinned data in the same colours as the interactive chart, and written
as SVG at once: a page holds a dozen pictures, and a drawing library takes a hundred times longer
for each. Its layout is reckoned from the sizes of its texts.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import Any

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.report._axes import TICK_TEXT, UNITS, Panel, Tick, text_width, y_window
from labpipe.report._charts import Band, LineChart, ScatterChart, Series
from labpipe.report._packing import Drawn, ThinnedChart, thin
from labpipe.report._page import clean
from labpipe.report._style import COLUMN_WIDTHS_MM, MILLIMETRES_PER_INCH, LineLook
from labpipe.report._thinning import kept_samples

# A chart on the screen is this wide when its height in the picture is worked out.
_SCREEN_WIDTH_PX = 800.0
_MAX_SMALL_PANELS = 3
_SMALL_PANEL_SHARE = 0.75
# More samples than this per panel are finer than a printer's dots along the width; fewer show.
_MOST_SAMPLES, _LEAST_SAMPLES = 1600, 100
# So many in all panels together keep a picture below a tenth of a megabyte.
_SAMPLES_PER_PICTURE = 8000
_LONGEST_TEXT = 60
_SMALL_PANEL_TICKS = 5
_MOST_POSITIONS = 150.0
_LABEL_SIZE = (0.08, 0.05)  # of the axes, which a name of a curve takes
_MARKER_SPACING = 0.12

# Lengths in points.
_POINTS_PER_INCH = 72.0
_PICTURE_WIDTH = COLUMN_WIDTHS_MM[2] / MILLIMETRES_PER_INCH * _POINTS_PER_INCH
_TEXT, _SMALL_TEXT, _NAME_TEXT = 8.0, TICK_TEXT, 6.0
_EDGE = 2.0
_LEGEND_ROW = 11.5
_LINE_IN_LEGEND = 18.0
_SWATCH = 24.0
_LEGEND_GAP = 14.0
_HEADING = 14.0
_FOOT = 27.0
_TICK, _SMALL_TICK, _TICK_GAP = 3.0, 1.8, 6.5
_COLUMN_GAP = 12.0
_LEAST_HEIGHT = 24.0
_MARKER = 1.6  # half of its width
_CAP = 1.8  # half of the width of the end of an error bar

_MARKERS = {
    "circle": "M-{r} 0a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0-{d} 0z",
    "square": "M-{r}-{r}h{d}v{d}h-{d}z",
    "triangle": "M0-{r}l{r} {d}h-{d}z",
    "diamond": "M0-{q}l{q} {q}-{q} {q}-{q}-{q}z",
}


def static_picture(thinned: ThinnedChart) -> bytes:
    """Draw a chart as an SVG file.

    The first three named views that show less than half of the range get a panel of their own
    below the whole.

    Parameters
    ----------
    thinned : ThinnedChart
        From :func:`.thin`.

    Returns
    -------
    bytes
        A whole SVG file; the same chart gives the same bytes.
    """
    # without what shows only where somebody points
    kept = tuple(d for d in thinned.series if not getattr(d.source, "on_hover", False))
    thinned = replace(thinned, series=kept)
    chart, views = thinned.chart, _panels(thinned)
    shape = chart.height_px / _SCREEN_WIDTH_PX * (1 + (_SMALL_PANEL_SHARE if views else 0))
    paper = _Paper(_PICTURE_WIDTH, _PICTURE_WIDTH * shape)
    top = _EDGE + _legend(paper, thinned.series) * _LEGEND_ROW + _HEADING
    room = paper.height - top - _FOOT - ((_HEADING + _FOOT) if views else 0.0)
    tall = max(room / (1.0 + _SMALL_PANEL_SHARE) if views else room, _LEAST_HEIGHT)
    whole = _Place(_EDGE, paper.width - _EDGE, top, tall)
    _draw_panel(paper, thinned, whole, thinned.x_range, chart.x_label, chart.y_label)
    column = (paper.width - 2 * _EDGE + _COLUMN_GAP) / max(len(views), 1)
    for number, (name, start, stop) in enumerate(views):
        left = _EDGE + number * column
        place = _Place(left, left + column - _COLUMN_GAP, top + tall + _FOOT + _HEADING, tall * _SMALL_PANEL_SHARE)
        label = chart.x_label if number == len(views) // 2 else ""
        _draw_panel(paper, thinned, place, (start, stop), label, name, most_ticks=_SMALL_PANEL_TICKS)
    return paper.svg()


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
    paper = _Paper(float(width_px), width_px / 2.0)
    cut = _cut(thinned, thinned.x_range, 2 * width_px)
    whole = _panel(thinned, _Place(0.0, paper.width, 0.0, paper.height), thinned.x_range, cut, 0.0, 0.0)
    _draw_data(paper, thinned, whole, cut)
    return paper.svg()


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a panel goes with the texts beside it, in points."""

    left: float
    right: float
    top: float
    height: float


_Curves = tuple["Floats", ...]
_Cut = list[tuple["Floats", _Curves]]


@dataclass(slots=True)
class _Paper:
    """A picture of a size in points, and what has been drawn on it.

    ``parts`` are its elements; ``shared`` are the shapes that they refer to, each with its name.
    """

    width: float
    height: float
    parts: list[str] = field(default_factory=list)
    shared: dict[str, str] = field(default_factory=dict)

    def path(self, data: str, look: str) -> None:
        """Draw a path, unless there is nothing of it."""
        if data:
            self.parts.append(f'<path d="{data}" {look}/>')

    def text(self, x: float, y: float, text: str, size: float, look: str = "") -> None:
        """Write a line of text at a place in points."""
        if text:
            place = f'x="{_whole(x)}" y="{_whole(y)}" font-size="{_whole(size)}"'
            self.parts.append(f"<text {place}{look and ' '}{look}>{escape(clean(text), quote=False)}</text>")

    def name(self, shape: str, before: str) -> str:
        """Return the name of a shared shape; ``shape`` lacks it between ``before`` and the rest."""
        return self.shared.setdefault(shape, f"{before}{len(self.shared)}")

    def svg(self) -> bytes:
        """Return the whole file."""
        shared = "".join(shape.replace("NAME", name, 1) for shape, name in self.shared.items())
        size = f"{_whole(self.width)} {_whole(self.height)}"
        head = (
            '<?xml version="1.0" encoding="utf-8"?>\n'
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{self.width:.2f}pt" height="{self.height:.2f}pt" '
            f'viewBox="0 0 {size}" font-family="DejaVu Sans,Arial,Helvetica,sans-serif">'
            f'<defs>{shared}</defs><rect width="100%" height="100%" fill="#fff"/>'
        )
        return "\n".join((head, *self.parts, "</svg>\n")).encode()


def _whole(points: float) -> int:
    return round(UNITS * points)


def _stroke(colour: str, width: float, dash: Sequence[float] = ()) -> str:
    dashes = f' stroke-dasharray="{" ".join(str(_whole(length)) for length in dash)}"' if dash else ""
    return f'fill="none" stroke="{colour}" stroke-width="{_whole(width)}" stroke-linejoin="round"{dashes}'


def _panels(thinned: ThinnedChart) -> list[tuple[str, float, float]]:
    chart = thinned.chart
    if isinstance(chart, ScatterChart):
        return []
    whole = thinned.x_range[1] - thinned.x_range[0]
    narrow = [view for view in chart.views if view[2] - view[1] < whole / 2]
    return narrow[:_MAX_SMALL_PANELS]


# --- a panel: its place, its frame -------------------------------------------------------------


def _draw_panel(
    paper: _Paper,
    thinned: ThinnedChart,
    place: _Place,
    window: tuple[float, float],
    x_label: str,
    heading: str,
    most_ticks: int = 9,
) -> None:
    chart = thinned.chart
    curves_drawn = max(len(thinned.series), 1) * (1 + len(_panels(thinned)))
    cut = _cut(thinned, window, min(max(_SAMPLES_PER_PICTURE // curves_drawn, _LEAST_SAMPLES), _MOST_SAMPLES))
    # Ticks along y do not depend on where the panel begins, which depends on their texts.
    ticks = _panel(thinned, place, window, cut, 0.0, 0.0).y_ticks(most_ticks)
    left = max((text_width(tick.text, _SMALL_TEXT) for tick in ticks), default=0.0) + _TICK_GAP
    ticks = _panel(thinned, place, window, cut, left, 0.0).x_ticks(most_ticks)
    right = text_width(ticks[-1].text, _SMALL_TEXT) / 2 if ticks else 0.0
    panel = _panel(thinned, place, window, cut, left, right)
    if isinstance(chart, ScatterChart) and chart.has_equal_axes:
        panel = panel.with_equal_units()
    across, down = panel.x_ticks(most_ticks), panel.y_ticks(most_ticks)
    _draw_grid(paper, panel, across, down)
    _draw_data(paper, thinned, panel, cut)
    _draw_names(paper, panel, thinned.series)
    _draw_frame(paper, panel, across, down)
    middle, foot = panel.left + panel.width / 2, panel.top + panel.height
    paper.text(middle, foot + _TICK_GAP + _SMALL_TEXT + _TEXT + 2.0, _short(x_label), _TEXT, 'text-anchor="middle"')
    paper.text(panel.left, panel.top - 5.0, _short(heading), _TEXT)


def _panel(
    thinned: ThinnedChart, place: _Place, window: tuple[float, float], cut: _Cut, left: float, right: float
) -> Panel:
    """Make a panel that leaves room for texts on both sides."""
    chart = thinned.chart
    ends = [end for drawn, (_, curves) in zip(thinned.series, cut, strict=True) for end in _ends(drawn, curves, chart)]
    width = max(place.right - place.left - left - right, _LEAST_HEIGHT)
    y = y_window(ends, chart.y_scale)
    return Panel(place.left + left, place.top, width, place.height, window, y, chart.x_scale, chart.y_scale)


def _draw_grid(paper: _Paper, panel: Panel, across: Iterable[Tick], down: Iterable[Tick]) -> None:
    left, top = _whole(panel.left), _whole(panel.top)
    x = _places(panel.across, across, is_small=False)
    y = _places(panel.down, down, is_small=False)
    lines = [f"M{place} {top}v{_whole(panel.height)}" for place in x]
    lines += [f"M{left} {place}h{_whole(panel.width)}" for place in y]
    paper.path("".join(lines), _stroke("#e2e2e2", 0.5))


def _places(axis: Any, ticks: Iterable[Tick], *, is_small: bool) -> list[int]:
    return [round(float(axis(tick.value))) for tick in ticks if tick.is_small == is_small]


def _draw_frame(paper: _Paper, panel: Panel, across: Sequence[Tick], down: Sequence[Tick]) -> None:
    """Draw the axes with the marks of their ticks and the numbers."""
    left, foot = _whole(panel.left), _whole(panel.top + panel.height)
    lines = [f"M{left} {_whole(panel.top)}V{foot}h{_whole(panel.width)}"]
    for is_small, length in ((False, _whole(_TICK)), (True, _whole(_SMALL_TICK))):
        lines += [f"M{place} {foot}v{length}" for place in _places(panel.across, across, is_small=is_small)]
        lines += [f"M{left} {place}h-{length}" for place in _places(panel.down, down, is_small=is_small)]
    paper.path("".join(lines), _stroke("#000", 0.6))
    for tick in across:
        x = float(panel.across(tick.value)) / UNITS
        below = panel.top + panel.height + _TICK_GAP + 0.73 * _SMALL_TEXT
        paper.text(x, below, tick.text, _SMALL_TEXT, 'text-anchor="middle"')
    for tick in down:
        y = float(panel.down(tick.value)) / UNITS + 0.36 * _SMALL_TEXT
        paper.text(panel.left - _TICK_GAP + 1.0, y, tick.text, _SMALL_TEXT, 'text-anchor="end"')


def _short(text: str) -> str:
    """Bring a text onto one line that fits into the picture; the page holds it whole."""
    line = " ".join(clean(text).split())
    return line if len(line) <= _LONGEST_TEXT else f"{line[: _LONGEST_TEXT - 1]}…"


def _legend(paper: _Paper, series: Sequence[Drawn]) -> int:
    """Name the curves at the top of the picture, along its rows; return how many rows that takes."""
    names = [_short(drawn.source.name) for drawn in series]
    longest = max((text_width(name, _SMALL_TEXT) for name in names), default=0.0)
    one = _SWATCH + longest + _LEGEND_GAP
    columns = min(max(int((paper.width + _LEGEND_GAP) / one), 1), max(len(names), 1))
    for number, (drawn, name) in enumerate(zip(series, names, strict=True)):
        row, column = divmod(number, columns)
        left, middle = _EDGE + column * one, _EDGE + (row + 0.5) * _LEGEND_ROW
        _draw_swatch(paper, drawn, left, middle)
        paper.text(left + _SWATCH, middle + 0.36 * _SMALL_TEXT, name, _SMALL_TEXT)
    return -(-len(names) // columns)


def _draw_swatch(paper: _Paper, drawn: Drawn, left: float, middle: float) -> None:
    look, half = drawn.look, _whole(_LINE_IN_LEGEND / 2)
    line = f"M{_whole(left)} {_whole(middle)}h{half}h{half}"
    if isinstance(drawn.source, Band):
        tall = _whole(_SMALL_TEXT * 0.7)
        data = f"M{_whole(left)} {_whole(middle) - tall // 2}h{2 * half}v{tall}h-{2 * half}z"
        paper.path(data, _area(look))
        return
    if drawn.source.style != "points":
        paper.path(line, _stroke(look.light, look.width, look.dash))
    if drawn.source.style == "points" or drawn.is_marked:
        paper.path(line, f'fill="none" marker-mid="{_marker(paper, look)}"')


# --- what a panel shows ------------------------------------------------------------------------


def _cut(thinned: ThinnedChart, window: tuple[float, float], most: int) -> _Cut:
    """Cut every series to a window and thin it to what the panel can resolve."""
    is_loop = isinstance(thinned.chart, ScatterChart)
    return [_part(drawn, window, most, is_loop=is_loop) for drawn in thinned.series]


def _part(drawn: Drawn, window: tuple[float, float], most: int, *, is_loop: bool) -> tuple[Floats, _Curves]:
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


def _ends(drawn: Drawn, curves: _Curves, chart: LineChart | ScatterChart) -> list[float]:
    """Return the smallest and largest value of a series, error bars included."""
    first, second = curves[0], curves[-1]
    if isinstance(drawn.source, Series) and len(curves) == 2:
        u = _error_lengths(curves[1])
        first, second = first - u, first + u
    both = np.concatenate([first, second])
    shown = both[np.isfinite(both) & ((both > 0) | (chart.y_scale == "linear"))]
    return [float(shown.min()), float(shown.max())] if shown.size else []


def _error_lengths(u: Floats) -> Floats:
    return np.where(np.isfinite(u), np.abs(u), 0.0)


def _draw_data(paper: _Paper, thinned: ThinnedChart, panel: Panel, cut: _Cut) -> None:
    """Draw everything inside a panel, points above lines."""
    left, top, wide, tall = (_whole(n) for n in (panel.left, panel.top, panel.width, panel.height))
    frame = f'<clipPath id="NAME"><rect x="{left}" y="{top}" width="{wide}" height="{tall}"/></clipPath>'
    paper.parts.append(f'<g clip-path="url(#{paper.name(frame, "c")})">')
    chart = thinned.chart
    if any(d.source.role == "residual" for d in thinned.series) and chart.y_scale == "linear":
        paper.path(f"M{left} {round(float(panel.down(0.0)))}h{wide}", _stroke("#808080", 0.6))
    marked = _uncrowded([x for _, x in getattr(chart, "vlines", ())], panel.x)
    lines = [f"M{round(float(panel.across(x)))} {top}v{tall}" for x in marked]
    paper.path("".join(lines), _stroke("#a0a0a0", 0.5, (0.5, 1.0)))
    together = [(d, number, *part) for number, (d, part) in enumerate(zip(thinned.series, cut, strict=True))]
    together.sort(key=lambda entry: getattr(entry[0].source, "style", "line") == "points")
    for drawn, number, x, curves in together:
        _draw_one(paper, panel, drawn, number, x, curves)
    paper.parts.append("</g>")


def _draw_one(paper: _Paper, panel: Panel, drawn: Drawn, number: int, x: Floats, curves: _Curves) -> None:
    source, look, across = drawn.source, drawn.look, panel.across(x)
    if isinstance(source, Band):
        low, high = (panel.down(_shown(curve, panel)) for curve in curves)
        runs = _runs(np.isfinite(across) & np.isfinite(low) & np.isfinite(high))
        outline = "".join(
            _line(np.append(across[r], across[r][::-1]), np.append(high[r], low[r][::-1])) + "z" for r in runs
        )
        paper.path(outline, _area(look))
        return
    down = panel.down(curves[0])
    is_there = np.isfinite(across) & np.isfinite(down)
    if len(curves) == 2:
        u = _error_lengths(curves[1])
        ends = panel.down(_shown(curves[0] - u, panel)), panel.down(curves[0] + u)
        paper.path(_error_bars(across[is_there], *(end[is_there] for end in ends)), _stroke(look.light, 0.7))
    if source.style == "points":
        _draw_markers(paper, look, across[is_there], down[is_there])
        return
    if source.style == "step":
        across, down = np.repeat(across, 2)[1:], np.repeat(down, 2)[:-1]
    runs = _runs(np.isfinite(across) & np.isfinite(down))
    paper.path("".join(_line(across[r], down[r]) for r in runs), _stroke(look.light, look.width, look.dash))
    if drawn.is_marked:
        apart = UNITS * _MARKER_SPACING * panel.diagonal
        chosen = _spaced(across, down, 0.25 * number * apart, apart)
        _draw_markers(paper, look, across[chosen], down[chosen])


def _shown(values: Floats, panel: Panel) -> Floats:
    """Let an edge that a logarithmic axis cannot show lie at its lower end."""
    return np.where(values <= 0.0, panel.y[0], values) if panel.y_scale == "log" else values


def _area(look: LineLook) -> str:
    return f'fill="{look.light}" fill-opacity="0.22"'


def _runs(is_there: Flags) -> Iterator[slice]:
    """Yield the parts of a curve between its gaps."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], is_there.view(np.int8), [0]))))
    yield from (slice(first, last) for first, last in zip(edges[::2], edges[1::2], strict=True))


def _line(across: Floats, down: Floats) -> str:
    """Write a line through all points as the data of a path; steps that round to none are left out."""
    places = np.rint(np.column_stack([across, down])).astype(int)
    steps = np.diff(places, axis=0)
    steps = steps[steps.any(axis=1)]
    begin = f"M{places[0, 0]} {places[0, 1]}"
    return begin + ("l" + " ".join(map(str, steps.ravel().tolist())).replace(" -", "-") if steps.size else "h0")


def _error_bars(across: Floats, low: Floats, high: Floats) -> str:
    half = _whole(_CAP)
    places = np.rint(np.column_stack([across, low, high])).astype(int).tolist()
    cap = f"m-{half} 0h{2 * half}"
    return "".join(f"M{x} {foot}V{top}{cap}M{x} {foot}{cap}" for x, foot, top in places if foot != top)


def _draw_markers(paper: _Paper, look: LineLook, across: Floats, down: Floats) -> None:
    if across.size:
        name = _marker(paper, look)
        marks = " ".join(f'marker-{where}="{name}"' for where in ("start", "mid", "end"))
        paper.path(_line(across, down), f'fill="none" {marks}')


def _marker(paper: _Paper, look: LineLook) -> str:
    """Return the address of a marker, which a path shows at its points."""
    sizes = {"r": _whole(_MARKER), "d": 2 * _whole(_MARKER), "q": _whole(_MARKER * np.sqrt(2.0))}
    outline = _MARKERS[look.marker].format(**sizes)
    inside = look.light if look.filled else "#fff"
    drawing = f'<path d="{outline}" fill="{inside}" stroke="{look.light}" stroke-width="{_whole(0.8)}"/>'
    shape = f'<marker id="NAME" markerUnits="userSpaceOnUse" overflow="visible">{drawing}</marker>'
    return f"url(#{paper.name(shape, 'm')})"


def _spaced(across: Floats, down: Floats, first: float, apart: float) -> Integers:
    """Choose points of a curve at equal distances along it."""
    is_there = np.isfinite(across) & np.isfinite(down)
    places = np.flatnonzero(is_there)
    if not places.size:
        return places
    length = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(across[places]), np.diff(down[places])))))
    wanted = np.searchsorted(length, np.arange(first % apart, length[-1] + 1.0, apart))
    return places[np.unique(np.minimum(wanted, places.size - 1))]


def _draw_names(paper: _Paper, panel: Panel, series: Sequence[Drawn]) -> None:
    """Name the curves of a family at their ends; leave out what would cover another name."""
    family = [d for d in series if isinstance(d.source, Series) and d.source.level is not None]
    family = [d for d in family if d.source.style != "points"]  # type: ignore[union-attr]  # a family has no bands
    # Both ends of the scale first: they say where it begins and where it ends.
    order = sorted(range(len(family)), key=lambda i: (0 < i < len(family) - 1, i))
    taken: list[tuple[float, float]] = []
    for drawn in (family[i] for i in order):
        inside = np.flatnonzero(np.isfinite(drawn.curves[0]) & (drawn.x >= panel.x[0]) & (drawn.x <= panel.x[1]))
        if not inside.size:
            continue
        x = float(panel.across(drawn.x[inside[-1]])) / UNITS
        y = float(panel.down(drawn.curves[0][inside[-1]])) / UNITS
        wide, tall = _LABEL_SIZE[0] * panel.width, _LABEL_SIZE[1] * panel.height
        if not np.isfinite(x + y) or any(abs(x - a) < wide and abs(y - b) < tall for a, b in taken):
            continue
        taken.append((x, y))
        look = f'text-anchor="end" fill="{drawn.look.light}"'
        paper.text(x, max(y - 2.0, panel.top + _NAME_TEXT), drawn.source.name, _NAME_TEXT, look)


def _uncrowded(positions: Sequence[float], window: tuple[float, float]) -> list[float]:
    """Leave out marked positions that would merge into a grey block."""
    shown: list[float] = []
    nearest = (window[1] - window[0]) / _MOST_POSITIONS
    for position in sorted(positions):
        if window[0] <= position <= window[1] and (not shown or position - shown[-1] > nearest):
            shown.append(position)
    return shown

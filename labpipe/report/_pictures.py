"""The static picture of a chart, for print and for browsers without scripts.

It shows the same thinned data in the same colours as the interactive chart, and is written as SVG at once: a page holds
a dozen pictures, and matplotlib takes a hundred times longer for each.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from html import escape

import numpy as np

from labpipe.arrays import Floats
from labpipe.report._charts import LineChart
from labpipe.report._packing import Drawn, ThinnedChart, padded_range, thin
from labpipe.report._style import COLUMN_WIDTHS_MM, LineLook
from labpipe.report._tables import MINUS, clean, power_of_ten
from labpipe.report._thinning import kept_samples

UNITS = 20
"""Places are whole numbers of 1/20 point: finer than a printer's dots, and shorter than decimals."""
_WIDTH = round(UNITS * COLUMN_WIDTHS_MM[2] / 25.4 * 72.0)
_TEXT, _LINE, _HEADING, _FOOT, _GAP, _SWATCH = 150, 230, 290, 540, 240, 480
"""Heights of a letter, of a line of the legend, of the texts above and below a panel; distances and widths."""
_LETTER = 0.65 * _TEXT
"""Width of a letter, on the safe side for DejaVu Sans."""
_VIEWS, _VIEW_HEIGHT = 3, 0.75
"""Panels for named views below the whole, and their height relative to that."""
_MARKERS = {
    "circle": "M-32 0a32 32 0 1 0 64 0a32 32 0 1 0-64 0z",
    "square": "M-32-32h64v64h-64z",
    "triangle": "M0-32l32 64h-64z",
    "diamond": "M0-45l45 45-45 45-45-45z",
}


def static_picture(thinned: ThinnedChart) -> bytes:
    """Draw a chart, thinned by :func:`.thin`, as an SVG file; the same chart gives the same bytes.

    The first three named views that show less than half of the range get a panel of their own below the whole.
    """
    thinned = replace(thinned, series=tuple(d for d in thinned.series if not d.source.on_hover))
    chart, whole = thinned.chart, thinned.x_range
    views = [v for v in chart.views if v[2] - v[1] < (whole[1] - whole[0]) / 2][:_VIEWS]
    rows, share = (2, 1.0 + _VIEW_HEIGHT) if views else (1, 1.0)
    tall = max(round(_WIDTH * chart.height_px / 800.0 - rows * (_HEADING + _FOOT) / share), 2 * _GAP)
    low = round(_VIEW_HEIGHT * tall)
    paper = _Paper(_WIDTH, 0)
    top = _legend(paper, thinned.series) + _HEADING
    most = int(np.clip(8000 // (len(thinned.series) * (1 + len(views))), 100, 1600))  # samples that a curve may take
    _panel(paper, thinned, (0, top, _WIDTH, tall), whole, most, (chart.x_label, chart.y_label))
    top += tall + _FOOT
    column = (_WIDTH + _GAP) // max(len(views), 1)
    for number, (name, start, stop) in enumerate(views):
        place = (number * column, top + _HEADING, column - _GAP, low)
        label = chart.x_label if number == len(views) // 2 else ""
        _panel(paper, thinned, place, (start, stop), most, (label, name))
    paper.height = top + (_HEADING + low + _FOOT if views else 0)
    return paper.svg()


def thumbnail(chart: LineChart, width_px: int = 240) -> bytes:
    """Draw a chart without axes as a small SVG file, twice as wide as high, for an index page."""
    thinned = thin(chart, max_bytes=100_000)
    paper = _Paper(UNITS * width_px, UNITS * width_px // 2)
    place = (0, 0, paper.width, paper.height)
    _panel(paper, thinned, place, thinned.x_range, 2 * width_px)
    return paper.svg()


@dataclass(slots=True)
class _Paper:
    """A picture: its elements, and the shapes that they share, by their markup."""

    width: int
    height: int
    parts: list[str] = field(default_factory=list)
    shared: dict[str, str] = field(default_factory=dict)

    def path(self, data: str, look: str) -> None:
        if data:
            self.parts.append(f'<path d="{data}" {look}/>')

    def text(self, x: float, y: float, text: str, anchor: str = "start") -> None:
        line = " ".join(clean(text).split())
        line = escape(line if len(line) <= 60 else f"{line[:59]}…", quote=False)
        self.parts.append(f'<text x="{round(x)}" y="{round(y)}" text-anchor="{anchor}">{line}</text>' if line else "")

    def share(self, shape: str) -> str:
        """Return the address of a shape, whose markup has NAME for its name."""
        return f"url(#{self.shared.setdefault(shape, f's{len(self.shared)}')})"

    def marker(self, look: LineLook) -> str:
        """Return the address of a curve's marker."""
        inside = look.light if look.filled else "#fff"
        drawing = f'<path d="{_MARKERS[look.marker]}" fill="{inside}" stroke="{look.light}" stroke-width="16"/>'
        return self.share(f'<marker id="NAME" markerUnits="userSpaceOnUse" overflow="visible">{drawing}</marker>')

    def svg(self) -> bytes:
        shared = "".join(shape.replace("NAME", name, 1) for shape, name in self.shared.items())
        size = f'width="{self.width / UNITS:.2f}pt" height="{self.height / UNITS:.2f}pt"'
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {self.width} {self.height}" '
            f'font-size="{_TEXT}" font-family="DejaVu Sans,Arial,Helvetica,sans-serif">'
            f'<defs>{shared}</defs><rect width="100%" height="100%" fill="#fff"/>'
        )
        return "\n".join((head, *filter(None, self.parts), "</svg>\n")).encode()


def _stroke(colour: str, width: float, dash: Sequence[float] = ()) -> str:
    dashes = f' stroke-dasharray="{" ".join(str(round(UNITS * length)) for length in dash)}"' if dash else ""
    return f'fill="none" stroke="{colour}" stroke-width="{round(UNITS * width)}" stroke-linejoin="round"{dashes}'


def _area(look: LineLook) -> str:
    return f'fill="{look.light}" fill-opacity="0.22"'


def _legend(paper: _Paper, series: Sequence[Drawn]) -> int:
    """Name the curves at the top of the picture; return the height that this takes."""
    longest = max((min(len(drawn.source.name), 60) for drawn in series), default=0)
    cell = round(_SWATCH + longest * _LETTER + _GAP)
    columns = min(max((paper.width + _GAP) // cell, 1), max(len(series), 1))
    for number, drawn in enumerate(series):
        row, column = divmod(number, columns)
        x, y, look = 40 + column * cell, 40 + row * _LINE + _LINE // 2, drawn.look
        line = f"M{x} {y}h180h180"
        is_points = drawn.source.style == "points"
        if drawn.source.style == "band":
            paper.path(f"M{x} {y - 49}h360v98h-360z", _area(look))
        elif not is_points:
            paper.path(line, _stroke(look.light, look.width, look.dash))
        if is_points or drawn.is_marked:
            paper.path(line, f'fill="none" marker-mid="{paper.marker(look)}"')
        paper.text(x + _SWATCH, y + 0.36 * _TEXT, drawn.source.name)
    return 40 + -(-len(series) // columns) * _LINE


def _cut(
    thinned: ThinnedChart, window: tuple[float, float], most: int
) -> tuple[list[tuple[Drawn, Floats, tuple[Floats, ...]]], tuple[float, float]]:
    """Return the curves in a window along x, of ``most`` samples each, and the window along y that shows them."""
    chart = thinned.chart
    curves, ends = [], []
    for drawn in thinned.series:
        x, values = drawn.x, drawn.curves
        along = np.arange(x.size, dtype=float)
        if chart.is_ordered:
            first = max(int(np.searchsorted(x, window[0], "left")) - 1, 0)
            inside = slice(first, int(np.searchsorted(x, window[1], "right")) + 1)
            x, values = x[inside], tuple(curve[inside] for curve in values)
            along = x
        kept = kept_samples(along, values if along is x else [*values, x], most)
        x, values = x[kept], tuple(curve[kept] for curve in values)
        curves.append((drawn, x, values))
        both = np.concatenate(values)
        if drawn.source.style != "band" and len(values) == 2:
            both = np.concatenate([values[0] - np.nan_to_num(values[1]), values[0] + np.nan_to_num(values[1])])
        shown = both[np.isfinite(both) & ((both > 0) | (chart.y_scale == "linear"))]
        ends += [float(shown.min()), float(shown.max())] if shown.size else []
    empty = (1.0, 10.0) if chart.y_scale == "log" else (0.0, 1.0)
    return curves, padded_range(min(ends), max(ends), chart.y_scale, 0.05) if ends else empty


def _panel(
    paper: _Paper,
    thinned: ThinnedChart,
    place: tuple[int, int, int, int],
    window: tuple[float, float],
    most: int,
    labels: tuple[str, str] | None = None,
) -> None:
    """Draw a window along x of a chart in a rectangle; with ``labels``, of x and above it, grid and axes too."""
    chart, (left, top, wide, tall) = thinned.chart, place
    curves, y_window = _cut(thinned, window, most)
    named = ticks(*y_window, chart.y_scale, min(9, tall // 300)) if labels else []
    if labels:
        before = round(max(len(text) for _, text in named) * _LETTER) + 130
        left, wide = left + before, wide - before - round(3 * _LETTER)

    def across(values: Floats) -> Floats:
        return left + wide * _part(values, window, chart.x_scale)

    def down(values: Floats) -> Floats:
        """Places along y, which grow downwards; values below a logarithmic axis are at its lower end."""
        shown = np.where(values <= 0.0, y_window[0], values) if chart.y_scale == "log" else values
        return top + tall * (1.0 - _part(shown, y_window, chart.y_scale))

    axis: list[tuple[float, str]] = []
    x: list[int] = []
    y: list[int] = down(np.array([v for v, _ in named])).astype(int).tolist()
    if labels:
        for count in range(9, 1, -1):  # as many ticks across as have room for their texts
            axis = ticks(*window, chart.x_scale, count)
            places = across(np.array([value for value, _ in axis]))
            if np.all(np.diff(places) > _LETTER * (1 + max(len(text) for _, text in axis))):
                break
        x = places.astype(int).tolist()
        grid = [f"M{at} {top}v{tall}" for at in x] + [f"M{left} {at}h{wide}" for at in y]
        paper.path("".join(grid), _stroke("#e2e2e2", 0.5))
    clip = f'<clipPath id="NAME"><rect x="{left}" y="{top}" width="{wide}" height="{tall}"/></clipPath>'
    paper.parts.append(f'<g clip-path="{paper.share(clip)}">')
    if chart.y_scale == "linear" and any(drawn.source.role == "residual" for drawn, _, _ in curves):
        paper.path(f"M{left} {int(down(np.zeros(1))[0])}h{wide}", _stroke("#808080", 0.6))
    lines = np.array([x for _, x in chart.vlines if window[0] <= x <= window[1]])
    marked = np.unique(across(lines).astype(int) // 60 * 60)  # three points apart at least
    paper.path("".join(f"M{at} {top}v{tall}" for at in marked), _stroke("#a0a0a0", 0.5, (0.5, 1.0)))
    for drawn, along, values in sorted(curves, key=lambda one: one[0].source.style == "points"):  # above lines
        _draw_curve(paper, drawn, across(along), values, down)
    paper.parts.append("</g>")
    if labels:
        paper.path(f"M{left} {top}V{top + tall}h{wide}", _stroke("#000", 0.6))
        for at, (_, text) in zip(x, axis, strict=True):
            paper.text(at, top + tall + 130 + 0.5 * _TEXT, text, "middle")
        for at, (_, text) in zip(y, named, strict=True):
            paper.text(left - 110, at + 0.36 * _TEXT, text, "end")
        paper.text(left + wide / 2, top + tall + 190 + 2 * _TEXT, labels[0], "middle")
        paper.text(left, top - 100, labels[1])


def _draw_curve(
    paper: _Paper, drawn: Drawn, across: Floats, values: tuple[Floats, ...], to_y: Callable[[Floats], Floats]
) -> None:
    source, look = drawn.source, drawn.look
    if source.style == "band":
        low, high = map(to_y, values)
        for run in _runs(across + low + high):
            edge = np.append(across[run], across[run][::-1]), np.append(high[run], low[run][::-1])
            paper.path(_line(*edge) + "z", _area(look))
        return
    down = np.where(np.isfinite(values[0]), to_y(values[0]), np.nan)
    is_there = np.flatnonzero(np.isfinite(across + down))
    if len(values) == 2:
        u = np.nan_to_num(values[1])
        ends = np.column_stack([across, to_y(values[0] - u), to_y(values[0] + u)])[is_there]
        bars = (bar for bar in np.rint(ends).astype(int).tolist() if bar[1] != bar[2])
        data = "".join(f"M{at} {foot}V{top}m-36 0h72M{at} {foot}m-36 0h72" for at, foot, top in bars)
        paper.path(data, _stroke(look.light, 0.7))
    if source.style == "step":
        across, down = np.repeat(across, 2)[1:], np.repeat(down, 2)[:-1]
    if source.style != "points":
        data = "".join(_line(across[run], down[run]) for run in _runs(across + down))
        paper.path(data, _stroke(look.light, look.width, look.dash))
    marked = is_there if source.style == "points" else is_there[:: max(is_there.size // 8, 1)][: 8 * drawn.is_marked]
    if marked.size:
        marks = " ".join(f'marker-{where}="{paper.marker(look)}"' for where in ("start", "mid", "end"))
        paper.path(_line(across[marked], down[marked]), f'fill="none" {marks}')


def ticks(low: float, high: float, scale: str, most: int) -> list[tuple[float, str]]:
    """Round numbers between two ends, with their texts; on a logarithm powers of ten, and 2 and 5 times those."""
    if scale == "log":
        powers = range(math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9) + 1)
        every = -(-len(powers) // max(most, 2)) or 1
        factors = (1, 2, 5) if len(powers) < 3 else (1,)
        around = range(powers.start - 1, powers.stop + 1) if len(powers) < 3 else [n for n in powers if n % every == 0]
        found = [(f * 10.0**n, _power_text(f, n)) for n in around for f in factors]
        found = [(value, text) for value, text in found if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
        if len(found) > 1:
            return found
    least = (high - low) / max(most, 2)
    decade = 10.0 ** math.floor(math.log10(least))
    step = next(decade * s for s in (1.0, 2.0, 2.5, 5.0, 10.0) if decade * s >= least * (1.0 - 1e-9))
    size = max(abs(low), abs(high))
    exponent = 0 if 1e-6 <= size < 1e7 else math.floor(math.log10(size))
    scaled = step / 10.0**exponent
    digits = max(0, -math.floor(math.log10(scaled) + 1e-9))
    digits += round(scaled * 10.0**digits, 6) % 1.0 != 0.0
    power = f"·{power_of_ten(exponent)}" if exponent else ""
    values = [n * step for n in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
    if scale == "day":
        return [(v, str(np.datetime64(int(v), "D"))) for v in values if v % 1.0 == 0.0]
    written = [f"{v / 10.0**exponent:.{digits}f}".replace("-", MINUS) + (power if v else "") for v in values]
    return [(v, text) for v, text in zip(values, written, strict=True) if scale == "linear" or v > 0.0]


def _power_text(factor: int, power: int) -> str:
    if -3 <= power <= 3:
        return f"{factor * 10.0**power:g}"
    return power_of_ten(power) if factor == 1 else f"{factor}·{power_of_ten(power)}"


def _part(values: Floats, window: tuple[float, float], scale: str) -> Floats:
    """Places of values in a window, as parts of it; not far beyond it, where places would only be long."""
    low, high = window
    if scale == "log":
        values = np.log10(np.where(values > 0.0, values, np.nan))
        low, high = math.log10(low), math.log10(high)
    return np.clip((values - low) / (high - low), -3.0, 4.0)


def _runs(values: Floats) -> Iterator[slice]:
    """Yield the parts of a curve between its gaps."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.isfinite(values).view(np.int8), [0]))))
    yield from (slice(first, last) for first, last in zip(edges[::2], edges[1::2], strict=True))


def _line(across: Floats, down: Floats) -> str:
    """Write a line through all points as the data of a path; steps that round to none are left out."""
    places = np.rint(np.column_stack([across, down])).astype(int)
    steps = np.diff(places, axis=0)
    steps = steps[steps.any(axis=1)]
    begin = f"M{places[0, 0]} {places[0, 1]}"
    return begin + ("l" + " ".join(map(str, steps.ravel().tolist())).replace(" -", "-") if steps.size else "h0")

"""The static picture of a chart, for print and for browsers without scripts.

It is drawn from the same thinned data in the same colours as the interactive chart, and written as SVG at once: a
page holds a dozen pictures, and matplotlib takes a hundred times longer for each.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from html import escape

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.report._charts import Band, LineChart, ScatterChart, Series
from labpipe.report._packing import Drawn, ThinnedChart, padded_range, thin
from labpipe.report._page import clean
from labpipe.report._style import COLUMN_WIDTHS_MM, MILLIMETRES_PER_INCH, LineLook
from labpipe.report._tables import MINUS, power_of_ten
from labpipe.report._thinning import kept_samples

UNITS = 20
"""Places are whole numbers of 1/20 point: finer than a printer's dots, and shorter than decimals."""
_WIDTH = COLUMN_WIDTHS_MM[2] / MILLIMETRES_PER_INCH * 72.0
"""Points."""
_SCREEN_WIDTH_PX = 800.0
_LETTER = 0.65
"""Mean width of a letter as a part of its size, on the safe side for DejaVu Sans."""
_TEXT, _SMALL, _LINE = 8.0, 7.0, 11.5
"""Points: sizes of texts, and the height of a line of the legend."""
_HEADING, _FOOT, _GAP, _SWATCH = 14.0, 27.0, 12.0, 24.0
_VIEWS, _VIEW_HEIGHT = 3, 0.75
"""Panels for named views below the whole, and their height relative to that."""
_SAMPLES_PER_PICTURE, _SAMPLES_PER_CURVE = 8000, (100, 1600)
_MARKERS = {
    "circle": "M-32 0a32 32 0 1 0 64 0a32 32 0 1 0-64 0z",
    "square": "M-32-32h64v64h-64z",
    "triangle": "M0-32l32 64h-64z",
    "diamond": "M0-45l45 45-45 45-45-45z",
}


def static_picture(thinned: ThinnedChart) -> bytes:
    """Draw a chart as an SVG file.

    The first three named views that show less than half of the range get a panel of their own below the whole.

    Parameters
    ----------
    thinned : ThinnedChart
        From :func:`.thin`.

    Returns
    -------
    bytes
        A whole SVG file; the same chart gives the same bytes.
    """
    thinned = replace(thinned, series=tuple(d for d in thinned.series if not getattr(d.source, "on_hover", False)))
    chart, whole = thinned.chart, thinned.x_range
    views = [v for v in getattr(chart, "views", ()) if v[2] - v[1] < (whole[1] - whole[0]) / 2][:_VIEWS]
    height = _WIDTH * chart.height_px / _SCREEN_WIDTH_PX * (1.0 + (_VIEW_HEIGHT if views else 0.0))
    paper = _Paper(_WIDTH, height)
    top = 2.0 + _legend(paper, thinned.series) * _LINE + _HEADING
    room = height - top - _FOOT - ((_HEADING + _FOOT) if views else 0.0)
    tall = max(room / (1.0 + _VIEW_HEIGHT) if views else room, 2 * _GAP)
    most = int(np.clip(_SAMPLES_PER_PICTURE // (len(thinned.series) * (1 + len(views))), *_SAMPLES_PER_CURVE))
    _panel(paper, thinned, (2.0, top, _WIDTH - 4.0, tall), whole, most).draw(chart.x_label, chart.y_label)
    column = (_WIDTH - 4.0 + _GAP) / max(len(views), 1)
    for number, (name, start, stop) in enumerate(views):
        place = (2.0 + number * column, top + tall + _FOOT + _HEADING, column - _GAP, tall * _VIEW_HEIGHT)
        label = chart.x_label if number == len(views) // 2 else ""
        _panel(paper, thinned, place, (start, stop), most).draw(label, name)
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
    place = (0.0, 0.0, paper.width, paper.height)
    _panel(paper, thinned, place, thinned.x_range, 2 * width_px, has_texts=False).draw_data()
    return paper.svg()


@dataclass(slots=True)
class _Paper:
    """A picture of a size in points: its elements, and the shapes that they share, by their markup."""

    width: float
    height: float
    parts: list[str] = field(default_factory=list)
    shared: dict[str, str] = field(default_factory=dict)

    def path(self, data: str, look: str) -> None:
        if data:
            self.parts.append(f'<path d="{data}" {look}/>')

    def text(self, x: float, y: float, text: str, size: float = _SMALL, anchor: str = "", fill: str = "") -> None:
        line = " ".join(clean(text).split())
        line = line if len(line) <= 60 else f"{line[:59]}…"
        look = (f' text-anchor="{anchor}"' if anchor else "") + (f' fill="{fill}"' if fill else "")
        place = f'x="{_units(x)}" y="{_units(y)}" font-size="{_units(size)}"'
        self.parts.append(f"<text {place}{look}>{escape(line, quote=False)}</text>" if line else "")

    def share(self, shape: str) -> str:
        """Return the address of a shape, whose markup has NAME for its name."""
        return f"url(#{self.shared.setdefault(shape, f's{len(self.shared)}')})"

    def svg(self) -> bytes:
        shared = "".join(shape.replace("NAME", name, 1) for shape, name in self.shared.items())
        head = (
            '<?xml version="1.0" encoding="utf-8"?>\n'
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{self.width:.2f}pt" height="{self.height:.2f}pt" '
            f'viewBox="0 0 {_units(self.width)} {_units(self.height)}" '
            'font-family="DejaVu Sans,Arial,Helvetica,sans-serif">'
            f'<defs>{shared}</defs><rect width="100%" height="100%" fill="#fff"/>'
        )
        return "\n".join((head, *filter(None, self.parts), "</svg>\n")).encode()


def _units(points: float) -> int:
    return round(UNITS * points)


def _stroke(colour: str, width: float, dash: Sequence[float] = ()) -> str:
    dashes = f' stroke-dasharray="{" ".join(str(_units(length)) for length in dash)}"' if dash else ""
    return f'fill="none" stroke="{colour}" stroke-width="{_units(width)}" stroke-linejoin="round"{dashes}'


def _area(look: LineLook) -> str:
    return f'fill="{look.light}" fill-opacity="0.22"'


def _legend(paper: _Paper, series: Sequence[Drawn]) -> int:
    """Name the curves at the top of the picture; return the number of lines."""
    longest = max((min(len(drawn.source.name), 60) for drawn in series), default=0)
    one = _SWATCH + longest * _LETTER * _SMALL + _GAP
    columns = min(max(int((paper.width + _GAP) / one), 1), max(len(series), 1))
    for number, drawn in enumerate(series):
        row, column = divmod(number, columns)
        left, middle, look = 2.0 + column * one, 2.0 + (row + 0.5) * _LINE, drawn.look
        x, y, half = _units(left), _units(middle), _units(9.0)
        line = f"M{x} {y}h{half}h{half}"
        if isinstance(drawn.source, Band):
            paper.path(f"M{x} {y - 49}h{2 * half}v98h-{2 * half}z", _area(look))
        elif drawn.source.style != "points":
            paper.path(line, _stroke(look.light, look.width, look.dash))
        if getattr(drawn.source, "style", "") == "points" or drawn.is_marked:
            paper.path(line, f'fill="none" marker-mid="{_marker(paper, look)}"')
        paper.text(left + _SWATCH, middle + 0.36 * _SMALL, drawn.source.name)
    return -(-len(series) // columns)


# --- a panel -----------------------------------------------------------------------------------

_Curves = list[tuple[Drawn, Floats, tuple[Floats, ...]]]


def _panel(
    paper: _Paper,
    thinned: ThinnedChart,
    place: tuple[float, float, float, float],
    window: tuple[float, float],
    most: int,
    *,
    has_texts: bool = True,
) -> "_Panel":
    """Make the panel for a window along x, its curves thinned to ``most`` samples, inside the texts at its sides."""
    chart, (left, top, width, height) = thinned.chart, place
    curves = [_cut(drawn, window, most, is_loop=isinstance(chart, ScatterChart)) for drawn in thinned.series]
    ends = [end for drawn, _, values in curves for end in _extremes(drawn, values, chart.y_scale)]
    empty = (1.0, 10.0) if chart.y_scale == "log" else (0.0, 1.0)
    y = padded_range(min(ends), max(ends), chart.y_scale, 0.05) if ends else empty
    if has_texts:
        texts = [text for _, text in ticks(*y, chart.y_scale, int(min(9.0, height / 15.0)))]
        before, behind = max(map(len, texts)) * _LETTER * _SMALL + 6.5, 2.5 * _LETTER * _SMALL
        left, width = left + before, width - before - behind
    panel = _Panel(paper, thinned, curves, left, top, width, height, window, y)
    return panel.with_equal_units() if getattr(chart, "has_equal_axes", False) else panel


@dataclass(frozen=True, slots=True)
class _Panel:
    """A rectangle of a picture (in points), and the window of values that it shows."""

    paper: _Paper
    thinned: ThinnedChart
    curves: _Curves
    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]

    def across(self, values: "Floats | float") -> Floats:
        """Places along x; NaN where the axis cannot show a value."""
        return UNITS * (self.left + self.width * _part(values, self.x, self.thinned.chart.x_scale))

    def down(self, values: "Floats | float") -> Floats:
        """Places along y, which grow downwards."""
        return UNITS * (self.top + self.height * (1.0 - _part(values, self.y, self.thinned.chart.y_scale)))

    def with_equal_units(self) -> "_Panel":
        """Widen one of the windows until a unit is as long along x as along y."""
        unit = max((self.x[1] - self.x[0]) / self.width, (self.y[1] - self.y[0]) / self.height)
        x, y = (
            (sum(w) / 2 - unit * size / 2, sum(w) / 2 + unit * size / 2)
            for w, size in ((self.x, self.width), (self.y, self.height))
        )
        return replace(self, x=x, y=y)

    def draw(self, x_label: str, heading: str) -> None:
        """Draw grid, data and axes."""
        paper, chart = self.paper, self.thinned.chart
        left, top, wide, tall = (_units(n) for n in (self.left, self.top, self.width, self.height))
        down = ticks(*self.y, chart.y_scale, int(min(9.0, self.height / 15.0)))
        across = self._ticks_across(chart.x_scale)
        x, y = [int(self.across(v)) for v, _ in across], [int(self.down(v)) for v, _ in down]
        grid = [f"M{place} {top}v{tall}" for place in x] + [f"M{left} {place}h{wide}" for place in y]
        paper.path("".join(grid), _stroke("#e2e2e2", 0.5))
        self.draw_data()
        self._name_family()
        marks = [f"M{place} {top + tall}v60" for place in x] + [f"M{left} {place}h-60" for place in y]
        paper.path(f"M{left} {top}V{top + tall}h{wide}" + "".join(marks), _stroke("#000", 0.6))
        foot = self.top + self.height
        for place, (_, text) in zip(x, across, strict=True):
            paper.text(place / UNITS, foot + 6.5 + 0.73 * _SMALL, text, anchor="middle")
        for place, (_, text) in zip(y, down, strict=True):
            paper.text(self.left - 5.5, place / UNITS + 0.36 * _SMALL, text, anchor="end")
        paper.text(self.left + self.width / 2, foot + 8.5 + _SMALL + _TEXT, x_label, _TEXT, "middle")
        paper.text(self.left, self.top - 5.0, heading, _TEXT)

    def _ticks_across(self, scale: str) -> list[tuple[float, str]]:
        """As many ticks as have room for their texts."""
        for count in range(9, 2, -1):
            found = ticks(*self.x, scale, count)
            places = self.across(np.array([value for value, _ in found]))
            wide = UNITS * _LETTER * _SMALL * max(len(text) for _, text in found) + 5 * UNITS
            if np.all(np.diff(places) > wide):
                return found
        return ticks(*self.x, scale, 2)[:2]

    def draw_data(self) -> None:
        """Draw everything inside the panel, points above lines."""
        paper, chart = self.paper, self.thinned.chart
        left, top, wide, tall = (_units(n) for n in (self.left, self.top, self.width, self.height))
        clip = f'<clipPath id="NAME"><rect x="{left}" y="{top}" width="{wide}" height="{tall}"/></clipPath>'
        paper.parts.append(f'<g clip-path="{paper.share(clip)}">')
        if chart.y_scale == "linear" and any(drawn.source.role == "residual" for drawn, _, _ in self.curves):
            paper.path(f"M{left} {int(self.down(0.0))}h{wide}", _stroke("#808080", 0.6))
        places = sorted({int(self.across(x)) for _, x in getattr(chart, "vlines", ()) if self.x[0] <= x <= self.x[1]})
        shown = [p for n, p in enumerate(places) if n == 0 or p - places[n - 1] > 3 * UNITS]
        paper.path("".join(f"M{place} {top}v{tall}" for place in shown), _stroke("#a0a0a0", 0.5, (0.5, 1.0)))
        numbered = list(enumerate(self.curves))
        numbered.sort(key=lambda one: getattr(one[1][0].source, "style", "line") == "points")
        for number, (drawn, x, values) in numbered:
            self._draw_one(drawn, number, self.across(x), values)
        paper.parts.append("</g>")

    def _draw_one(self, drawn: Drawn, number: int, across: Floats, values: tuple[Floats, ...]) -> None:
        paper, source, look = self.paper, drawn.source, drawn.look
        if isinstance(source, Band):
            low, high = (self.down(self._shown(curve)) for curve in values)
            runs = _runs(np.isfinite(across) & np.isfinite(low) & np.isfinite(high))
            edges = ((np.append(across[r], across[r][::-1]), np.append(high[r], low[r][::-1])) for r in runs)
            paper.path("".join(_line(*edge) + "z" for edge in edges), _area(look))
            return
        down = self.down(values[0])
        is_there = np.isfinite(across) & np.isfinite(down)
        if len(values) == 2:
            u = np.nan_to_num(values[1])
            ends = np.column_stack([across, self.down(self._shown(values[0] - u)), self.down(values[0] + u)])
            bars = np.rint(ends[is_there]).astype(int).tolist()
            cap = "m-36 0h72"
            data = "".join(f"M{x} {foot}V{top}{cap}M{x} {foot}{cap}" for x, foot, top in bars if foot != top)
            paper.path(data, _stroke(look.light, 0.7))
        if source.style == "points":
            self._mark(look, across[is_there], down[is_there])
            return
        if source.style == "step":
            across, down = np.repeat(across, 2)[1:], np.repeat(down, 2)[:-1]
        runs = _runs(np.isfinite(across) & np.isfinite(down))
        paper.path("".join(_line(across[r], down[r]) for r in runs), _stroke(look.light, look.width, look.dash))
        if drawn.is_marked:
            apart = 0.12 * UNITS * math.hypot(self.width, self.height)
            places = np.flatnonzero(np.isfinite(across) & np.isfinite(down))
            steps = np.hypot(np.diff(across[places]), np.diff(down[places]))
            length = np.concatenate(([0.0], np.cumsum(steps)))
            wanted = np.arange(0.25 * number * apart % apart, length[-1] + 1.0, apart)
            chosen = places[np.unique(np.minimum(np.searchsorted(length, wanted), places.size - 1))]
            self._mark(look, across[chosen], down[chosen])

    def _mark(self, look: LineLook, across: Floats, down: Floats) -> None:
        if across.size:
            name = _marker(self.paper, look)
            marks = " ".join(f'marker-{where}="{name}"' for where in ("start", "mid", "end"))
            self.paper.path(_line(across, down), f'fill="none" {marks}')

    def _shown(self, values: Floats) -> Floats:
        """Let an edge that a logarithmic axis cannot show lie at its lower end."""
        return np.where(values <= 0.0, self.y[0], values) if self.thinned.chart.y_scale == "log" else values

    def _name_family(self) -> None:
        """Name the curves of a family at their ends, but where a name would cover another."""
        family = [one for one in self.curves if isinstance(one[0].source, Series) and one[0].source.level is not None]
        taken: list[tuple[float, float]] = []
        # both ends of the scale first: they say where it begins and where it ends
        for _, (drawn, x, values) in sorted(enumerate(family), key=lambda one: (0 < one[0] < len(family) - 1, one[0])):
            inside = np.flatnonzero(np.isfinite(values[0]) & (x >= self.x[0]) & (x <= self.x[1]))
            if not inside.size or getattr(drawn.source, "style", "") == "points":
                continue
            at = float(self.across(x[inside[-1]])) / UNITS, float(self.down(values[0][inside[-1]])) / UNITS
            near = (abs(at[0] - a) < 0.08 * self.width and abs(at[1] - b) < 0.05 * self.height for a, b in taken)
            if np.isfinite(sum(at)) and not any(near):
                taken.append(at)
                y = max(at[1] - 2.0, self.top + 6.0)
                self.paper.text(at[0], y, drawn.source.name, 6.0, "end", drawn.look.light)


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
    written = [f"{v / 10.0**exponent:.{digits}f}".replace("-", MINUS) + (power if v else "") for v in values]
    return [(v, text) for v, text in zip(values, written, strict=True) if scale == "linear" or v > 0.0]


def _power_text(factor: int, power: int) -> str:
    if -3 <= power <= 3:
        return f"{factor * 10.0**power:g}"
    return power_of_ten(power) if factor == 1 else f"{factor}·{power_of_ten(power)}"


def _part(values: "Floats | float", window: tuple[float, float], scale: str) -> Floats:
    """Where values lie in a window, as a part of it; not far beyond it, where places would only be long."""
    found, (low, high) = np.asarray(values, float), window
    if scale == "log":
        found = np.log10(np.where(found > 0.0, found, np.nan))
        low, high = math.log10(low), math.log10(high)
    return np.clip((found - low) / (high - low), -3.0, 4.0)


def _cut(
    drawn: Drawn, window: tuple[float, float], most: int, *, is_loop: bool
) -> tuple[Drawn, Floats, tuple[Floats, ...]]:
    """Cut a series to a window and thin it to what a panel resolves."""
    x, curves = drawn.x, drawn.curves
    along = np.arange(x.size, dtype=float) if is_loop else x
    inside = slice(None)
    if not is_loop:
        first = max(int(np.searchsorted(x, window[0], "left")) - 1, 0)
        inside = slice(first, int(np.searchsorted(x, window[1], "right")) + 1)
    x, along, curves = x[inside], along[inside], tuple(curve[inside] for curve in curves)
    if x.size:
        kept = kept_samples(along, [*curves, x] if is_loop else curves, most)
        x, curves = x[kept], tuple(curve[kept] for curve in curves)
    return drawn, x, curves


def _extremes(drawn: Drawn, curves: tuple[Floats, ...], scale: str) -> list[float]:
    """Smallest and largest value of a series, error bars included."""
    low, high = curves[0], curves[-1]
    if isinstance(drawn.source, Series):
        u = np.nan_to_num(curves[1]) if len(curves) == 2 else 0.0
        low, high = curves[0] - u, curves[0] + u
    both = np.concatenate([low, high])
    shown = both[np.isfinite(both) & ((both > 0) | (scale == "linear"))]
    return [float(shown.min()), float(shown.max())] if shown.size else []


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


def _marker(paper: _Paper, look: LineLook) -> str:
    inside = look.light if look.filled else "#fff"
    drawing = f'<path d="{_MARKERS[look.marker]}" fill="{inside}" stroke="{look.light}" stroke-width="16"/>'
    return paper.share(f'<marker id="NAME" markerUnits="userSpaceOnUse" overflow="visible">{drawing}</marker>')

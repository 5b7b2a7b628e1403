"""The static picture of a chart, for print and for browsers without scripts.

It shows the same thinned data in the same colours as the interactive chart: places are found here, and a template
writes them as SVG. A page holds a dozen pictures, and matplotlib takes a hundred times longer for each.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from labpipe.arrays import Floats
from labpipe.report._charts import LineChart
from labpipe.report._packing import Drawn, ThinnedChart, padded_range, thin
from labpipe.report._style import COLUMN_WIDTHS_MM
from labpipe.report._tables import MINUS, clean, power_of_ten
from labpipe.report._templates import fill
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


def static_picture(thinned: ThinnedChart) -> bytes:
    """Draw a chart, thinned by :func:`.thin`, as an SVG file; the same chart gives the same bytes.

    The first three named views that show less than half of the range get a panel of their own below the whole.
    """
    chart, whole = thinned.chart, thinned.x_range
    series = [drawn for drawn in thinned.series if not drawn.source.on_hover]
    views = [v for v in chart.views if v[2] - v[1] < (whole[1] - whole[0]) / 2][:_VIEWS]
    rows, share = (2, 1.0 + _VIEW_HEIGHT) if views else (1, 1.0)
    tall = max(round(_WIDTH * chart.height_px / 800.0 - rows * (_HEADING + _FOOT) / share), 2 * _GAP)
    low = round(_VIEW_HEIGHT * tall)
    cell = round(_SWATCH + max((min(len(d.source.name), 60) for d in series), default=0) * _LETTER + _GAP)
    columns = min(max((_WIDTH + _GAP) // cell, 1), max(len(series), 1))
    legend = [
        (40 + n % columns * cell, 40 + n // columns * _LINE + _LINE // 2, _line_of_text(drawn.source.name))
        for n, drawn in enumerate(series)
    ]
    top = 40 + -(-len(series) // columns) * _LINE + _HEADING
    most = int(np.clip(8000 // (len(series) * (1 + len(views))), 100, 1600))  # samples that a curve may take
    panels = [_panel(chart, series, (0, top, _WIDTH, tall), whole, most, (chart.x_label, chart.y_label))]
    top += tall + _FOOT
    column = (_WIDTH + _GAP) // max(len(views), 1)
    for number, (name, start, stop) in enumerate(views):
        place = (number * column, top + _HEADING, column - _GAP, low)
        label = chart.x_label if number == len(views) // 2 else ""
        panels.append(_panel(chart, series, place, (start, stop), most, (label, name)))
    return _svg((_WIDTH, top + (_HEADING + low + _FOOT if views else 0)), series, panels, legend)


def thumbnail(chart: LineChart, width_px: int = 240) -> bytes:
    """Draw a chart without axes as a small SVG file, twice as wide as high, for an index page."""
    thinned, size = thin(chart, max_bytes=100_000), (UNITS * width_px, UNITS * width_px // 2)
    return _svg(size, thinned.series, [_panel(chart, thinned.series, (0, 0, *size), thinned.x_range, 2 * width_px)], [])


def _svg(size: tuple[int, int], series: Sequence[Drawn], panels: list[Any], legend: list[Any]) -> bytes:
    return fill("still", size=size, units=UNITS, text=_TEXT, series=series, panels=panels, legend=legend).encode()


def _line_of_text(text: str) -> str:
    line = " ".join(clean(text).split())
    return line if len(line) <= 60 else f"{line[:59]}…"


def _cut(
    chart: LineChart, series: Sequence[Drawn], window: tuple[float, float], most: int
) -> tuple[list[tuple[Floats, tuple[Floats, ...]]], tuple[float, float]]:
    """Return the curves in a window along x, of ``most`` samples each, and the window along y that shows them."""
    curves, ends = [], []
    for drawn in series:
        x, values = drawn.x, drawn.curves
        along = np.arange(x.size, dtype=float)
        if chart.is_ordered:
            first = max(int(np.searchsorted(x, window[0], "left")) - 1, 0)
            inside = slice(first, int(np.searchsorted(x, window[1], "right")) + 1)
            x, values = x[inside], tuple(curve[inside] for curve in values)
            along = x
        kept = kept_samples(along, values if along is x else [*values, x], most)
        x, values = x[kept], tuple(curve[kept] for curve in values)
        curves.append((x, values))
        both = np.concatenate(values)
        if drawn.source.style != "band" and len(values) == 2:
            both = np.concatenate([values[0] - np.nan_to_num(values[1]), values[0] + np.nan_to_num(values[1])])
        shown = both[np.isfinite(both) & ((both > 0) | (chart.y_scale == "linear"))]
        ends += [float(shown.min()), float(shown.max())] if shown.size else []
    empty = (1.0, 10.0) if chart.y_scale == "log" else (0.0, 1.0)
    return curves, padded_range(min(ends), max(ends), chart.y_scale, 0.05) if ends else empty


def _panel(
    chart: LineChart,
    series: Sequence[Drawn],
    place: tuple[int, int, int, int],
    window: tuple[float, float],
    most: int,
    labels: tuple[str, str] | None = None,
) -> dict[str, Any]:
    """Place a window along x of a chart in a rectangle; with ``labels``, of x and above it, grid and axes too."""
    left, top, wide, tall = place
    curves, y_window = _cut(chart, series, window, most)
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
    for count in range(9, 1, -1) if labels else ():  # as many ticks across as have room for their texts
        axis = ticks(*window, chart.x_scale, count)
        places = across(np.array([value for value, _ in axis]))
        if np.all(np.diff(places) > _LETTER * (1 + max(len(text) for _, text in axis))):
            break
    lines = np.array([x for _, x in chart.vlines if window[0] <= x <= window[1]])
    has_zero = chart.y_scale == "linear" and any(drawn.source.role == "residual" for drawn in series)
    return {
        "left": left, "top": top, "wide": wide, "tall": tall, "labels": labels and tuple(map(_line_of_text, labels)),
        "x": [(int(across(np.array(value))), text) for value, text in axis],
        "y": [(int(down(np.array(value))), text) for value, text in named],
        "zero": int(down(np.array(0.0))) if has_zero else None,
        "marks": np.unique(across(lines).astype(int) // 60 * 60).tolist(),  # three points apart at least
        "curves": [_curve(drawn, across(x), y, down) for drawn, (x, y) in zip(series, curves, strict=True)],
    }  # fmt: skip


def _curve(
    drawn: Drawn, across: Floats, values: tuple[Floats, ...], to_y: Callable[[Floats], Floats]
) -> dict[str, str]:
    """Return the data of the paths of a curve: its area, error bars, line and marks, as far as it has them."""
    found = dict.fromkeys(("area", "bars", "line", "marks"), "")
    if drawn.source.style == "band":
        low, high = map(to_y, values)
        for run in _runs(across + low + high):
            edge = np.append(across[run], across[run][::-1]), np.append(high[run], low[run][::-1])
            found["area"] += f"{_line(*edge)}z"
        return found
    down = np.where(np.isfinite(values[0]), to_y(values[0]), np.nan)
    is_there = np.flatnonzero(np.isfinite(across + down))
    if len(values) == 2:
        u = np.nan_to_num(values[1])
        ends = np.column_stack([across, to_y(values[0] - u), to_y(values[0] + u)])[is_there]
        bars = (bar for bar in np.rint(ends).astype(int).tolist() if bar[1] != bar[2])
        found["bars"] = "".join(f"M{at} {foot}V{top}m-36 0h72M{at} {foot}m-36 0h72" for at, foot, top in bars)
    is_points = drawn.source.style == "points"
    marked = is_there if is_points else is_there[:: max(is_there.size // 8, 1)][: 8 * drawn.is_marked]
    found["marks"] = _line(across[marked], down[marked]) if marked.size else ""
    if drawn.source.style == "step":
        across, down = np.repeat(across, 2)[1:], np.repeat(down, 2)[:-1]
    if not is_points:
        found["line"] = "".join(_line(across[run], down[run]) for run in _runs(across + down))
    return found


def ticks(low: float, high: float, scale: str, most: int) -> list[tuple[float, str]]:
    """Round numbers between two ends, with their texts; on a logarithm powers of ten, and 2 and 5 times those."""
    if scale == "log":
        powers = range(math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9) + 1)
        every = -(-len(powers) // max(most, 2)) or 1
        factors = (1, 2, 5) if len(powers) < 3 else (1,)
        around = range(powers.start - 1, powers.stop + 1) if len(powers) < 3 else [n for n in powers if n % every == 0]
        found = [
            (f * 10.0**n, f"{f * 10.0**n:g}" if -3 <= n <= 3 else f"{f}·{power_of_ten(n)}".removeprefix("1·"))
            for n in around for f in factors
        ]  # fmt: skip
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

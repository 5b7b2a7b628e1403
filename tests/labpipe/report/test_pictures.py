"""The still picture of a chart: all of it is seen, and nothing covers anything else."""

import xml.etree.ElementTree as ET
from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.transforms import Bbox

from labpipe.report import LineChart, ScatterChart, Series, _pictures
from labpipe.report._packing import thin

T = np.linspace(0.0, 1.0, 50)
WINDOWS = (("a first window", 0.1, 0.2), ("another", 0.5, 0.6), ("a third", 0.8, 0.9))


def tick_labels(axis):
    """Those within the axis; matplotlib keeps one beyond either end and does not draw it."""
    low, high = axis.get_view_interval()
    places = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=True)
    return [label for place, label in places if low <= place <= high]


def laid_out(chart):
    """The figure and the extents of its texts in px, by whose they are."""
    thinned = thin(chart, 10**6)
    views = _pictures._panels(thinned)
    with _pictures._chart_style(0.5):
        figure = _pictures._draw(thinned, views)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    extents = {}
    for place, axes in enumerate(figure.axes):
        named = [axes._left_title, axes.xaxis.label]
        ticks = [shown for axis in (axes.xaxis, axes.yaxis) for shown in tick_labels(axis)]
        extents[place] = [t.get_window_extent() for t in (*named, *ticks) if t.get_text()]
    extents["legend"] = [t.get_window_extent() for t in figure.legends[0].get_texts()]
    return figure, extents


@pytest.mark.parametrize("count", [1, 4, 9])
@pytest.mark.parametrize("views", [(), WINDOWS], ids=["whole", "windows"])
@pytest.mark.parametrize("factor", [1.0, 1e-9, 123456.0])
def test_every_text_lies_in_the_picture_and_covers_no_other_panel(count, views, factor):
    series = [Series(f"curve of a rather long name, number {n}", T, factor * T * n) for n in range(count)]
    chart = LineChart("c", "time / s", "height / mm", series, views=views, height_px=400)
    figure, extents = laid_out(chart)
    page = Bbox.from_bounds(-1.0, -1.0, figure.bbox.width + 2.0, figure.bbox.height + 2.0)
    assert all(page.containsx(b.x0) and page.containsx(b.x1) for e in extents.values() for b in e)
    assert all(page.containsy(b.y0) and page.containsy(b.y1) for e in extents.values() for b in e)
    for one, other in combinations(extents, 2):
        assert not any(a.overlaps(b) for a in extents[one] for b in extents[other])
    panels = [axes.get_window_extent() for axes in figure.axes]
    assert not any(a.overlaps(b) for a, b in combinations(panels, 2))
    assert min(panel.height for panel in panels) > 30.0


def test_equal_axes_have_equal_units():
    phase = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = Series("circle", 3.0 * np.cos(phase), 3.0 * np.sin(phase))
    figure, _ = laid_out(ScatterChart("c", "x", "y", (circle,), has_equal_axes=True))
    (x, _), (_, y) = figure.axes[0].transData.transform([(1.0, 0.0), (0.0, 1.0)])
    origin = figure.axes[0].transData.transform((0.0, 0.0))
    assert x - origin[0] == pytest.approx(y - origin[1], rel=1e-6)


def test_noise_stays_small():
    t = np.arange(200_000) / 1000.0
    noise = np.random.default_rng(2).normal(size=(12, t.size))
    series = [Series(f"{n}", t, y) for n, y in enumerate(noise)]
    made = _pictures.static_picture(thin(LineChart("c", "x", "y", series, height_px=500), 10**6))
    assert len(made) < 300_000


def test_a_name_is_text_and_no_formula():
    made = _pictures.static_picture(thin(LineChart("c", "$x$", "y < 1 & 2", (Series("$a_1$ & b", T, T),)), 10**6))
    texts = {e.text for e in ET.fromstring(made).iter() if e.tag.endswith("text")}  # noqa: S314 - our own picture
    assert {"$x$", "y < 1 & 2", "$a_1$ & b"} <= texts

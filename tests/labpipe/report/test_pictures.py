"""The still picture of a chart: all of it is seen, and nothing covers anything else."""

import re
import xml.etree.ElementTree as ET
from itertools import combinations

import numpy as np
import pytest
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path
from matplotlib.transforms import Bbox

from labpipe.report import LineChart, Series, _pictures
from labpipe.report._packing import thin
from labpipe.report._pictures import UNITS, ticks

T = np.linspace(0.0, 1.0, 50)
WINDOWS = (("a first window", 0.1, 0.2), ("another", 0.5, 0.6), ("a third", 0.8, 0.9))
_START = {"middle": 0.5, "end": 1.0}
SIZE = 150.0  # of letters, in units of the picture


def drawn(chart):
    return ET.fromstring(_pictures.static_picture(thin(chart, 10**6)))  # noqa: S314 - our own picture


def found(picture, tag):
    return [element for element in picture.iter() if element.tag.endswith(tag)]


def extent(text):
    """Where a text lies, by the font's own measures."""
    x, y, font = float(text.get("x")), float(text.get("y")), FontProperties(family="DejaVu Sans", size=SIZE / UNITS)
    width = UNITS * text_to_path.get_text_width_height_descent(text.text, font, ismath=False)[0]
    left = x - width * _START.get(text.get("text-anchor"), 0.0)
    return Bbox.from_extents(left, y - 0.76 * SIZE, left + width, y + 0.1 * SIZE)


def panels(picture):
    rows = [rect.attrib for clip in found(picture, "clipPath") for rect in clip]
    return [Bbox.from_bounds(*(float(row[name]) for name in ("x", "y", "width", "height"))) for row in rows]


@pytest.mark.parametrize(("count", "views", "factor"), [(1, (), 1e-9), (9, WINDOWS, 123456.0), (9, (), 1e-9)])
def test_every_text_lies_in_the_picture_and_covers_no_other_text_or_panel(count, views, factor):
    series = [Series(f"curve of a rather long name, number {n}", T, factor * T * n) for n in range(count)]
    picture = drawn(LineChart("c", "time / s", "height / mm", series, views=views, height_px=400))
    width, height = map(float, picture.get("viewBox").split()[2:])
    texts, places = [extent(text) for text in found(picture, "text")], panels(picture)
    assert len(places) == 1 + len(views)
    assert all(t.x0 >= 0 and t.x1 <= width and t.y0 >= 0 and t.y1 <= height for t in texts)
    assert not any(a.overlaps(b) for a, b in combinations(texts, 2))
    assert not any(a.overlaps(b) for a in texts for b in places)
    assert not any(a.overlaps(b) for a, b in combinations(places, 2))
    assert min(panel.height for panel in places) > 20.0 * UNITS


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("window", [(1.0, 2.0), (2.9, 4.1), (1e-3, 1e4), (1e9, 1e9 + 1.0), (1e-30, 1e30)])
def test_ticks_are_where_their_texts_say_and_at_least_two_are_named(window, scale):
    named = ticks(*window, scale, 9)
    assert 2 <= len(named) <= 12
    raised = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
    for value, written in named:
        assert window[0] - 1e-6 * (window[1] - window[0]) <= value <= window[1] * (1 + 1e-9)
        text = written.replace("\N{MINUS SIGN}", "-").replace("·10", "*10")
        said = re.sub(r"10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)", lambda m: f"10e{int(m[1].translate(raised)) - 1}", text)
        factors = [float(part) for part in said.split("*")]
        assert np.prod(factors) == pytest.approx(value, rel=1e-9)


def test_a_curve_is_drawn_where_its_values_are():
    """The first and the last point of a line are the ends of its axes, and a gap stays one."""
    y = np.where(np.arange(50) == 20, np.nan, T)
    picture = drawn(LineChart("c", "x", "y", (Series("a", T, y, role="measured"),)))
    (panel,) = panels(picture)
    (path,) = [p for p in found(picture, "path") if p.get("stroke") == "#0066a6" and p.get("d").count("M") == 2]
    first, second = re.findall(r"M(\d+) (\d+)l([-\d ]+)", path.get("d"))
    steps = [np.array(re.findall(r"-?\d+", run[2]), int).reshape(-1, 2) for run in (first, second)]
    assert [len(one) for one in steps] == [19, 28]
    ends = np.array(second[:2], int) + steps[1].sum(axis=0)
    margin = 0.05 / 1.1  # of the window beyond the values
    assert int(first[1]) == pytest.approx(panel.y1 - margin * panel.height, abs=1)
    assert ends[1] == pytest.approx(panel.y0 + margin * panel.height, abs=1)
    across = (int(first[0]) - panel.x0, panel.x1 - ends[0])
    assert across[0] == pytest.approx(across[1], abs=1)

"""The still picture of a chart, read back: what is drawn where, and that nothing overlaps."""

import re
import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest

from labpipe.report import Band, LineChart, ScatterChart, Series
from labpipe.report.packing import thin
from labpipe.report.pictures import static_picture
from labpipe.report.vector import UNITS, curve_path, text_width

SVG = "{http://www.w3.org/2000/svg}"
STEP = re.compile(r"-?\d+")


def drawn(chart):
    return ET.fromstring(static_picture(thin(chart, 10**6)))  # noqa: S314 - the kit's own picture


def texts(root):
    return {e.text: (float(e.get("x")), float(e.get("y"))) for e in root.iter(f"{SVG}text")}


def places(path):
    """Follow a path of one move and relative steps."""
    begin, _, rest = path.partition("l")
    start = [int(n) for n in STEP.findall(begin)]
    steps = np.array([int(n) for n in STEP.findall(rest)]).reshape(-1, 2)
    return np.cumsum(np.concatenate([[start], steps]), axis=0)


def lines(root, colour):
    return [p.get("d") for p in root.iter(f"{SVG}path") if p.get("stroke") == colour]


def test_a_curve_lies_where_its_ticks_say():
    x = np.linspace(0.0, 10.0, 101)
    root = drawn(LineChart("c", "x", "y", (Series("a", x, 3.0 * x - 4.0, role="measured"),)))
    points = places(lines(root, "#0066a6")[-1])
    at = texts(root)
    # Ticks 0 and 10 of x and 0 and 20 of y tell how values become places.
    x_at = {n: at[str(n)][0] for n in (2, 8)}
    slope = (x_at[8] - x_at[2]) / 6.0
    assert points[:, 0] == pytest.approx(x_at[2] + slope * (x - 2.0), abs=2.0)
    per_unit = (at["0"][1] - at["20"][1]) / 20.0
    heights = points[:, 1]
    assert (heights[0] - heights[-1]) / 30.0 == pytest.approx(per_unit, rel=0.01)


def test_a_gap_in_a_curve_is_a_gap_in_its_line():
    x, y = np.arange(6.0), np.array([1.0, 2.0, np.nan, 3.0, np.nan, 5.0])
    path = curve_path(x, y)
    assert path.count("M") == 3
    assert path.startswith(f"M0 {UNITS}l{UNITS} {UNITS}M")


def test_all_texts_lie_inside_the_picture_and_names_do_not_meet():
    t = np.linspace(0.0, 1.0, 50)
    series = [Series(f"curve of a rather long name, number {n}", t, t * n) for n in range(9)]
    views = (("a first window", 0.1, 0.2), ("another", 0.5, 0.6))
    root = drawn(LineChart("c", "time / s", "height / mm", series, views=views))
    width, height = (float(n) for n in root.get("viewBox").split()[2:])
    rows = {}
    for element in root.iter(f"{SVG}text"):
        x, y, size = (float(element.get(n)) for n in ("x", "y", "font-size"))
        extent = text_width(element.text, size)
        left = x - extent * {None: 0.0, "middle": 0.5, "end": 1.0}[element.get("text-anchor")]
        assert left >= 0.0
        assert left + extent <= width
        assert size <= y <= height
        rows.setdefault(y, []).append((left, left + extent))
    for row in rows.values():
        row.sort()
        assert all(a[1] < b[0] for a, b in pairwise(row))
    assert sum(text.startswith("curve of") for text in texts(root)) == 9


def test_every_point_has_its_marker_and_every_uncertainty_its_bar():
    x = np.arange(1.0, 8.0)
    points = Series("p", x, x**2, "points", role="measured", u=0.1 * x)
    root = drawn(LineChart("c", "x", "y", (points,), x_scale="log", y_scale="log"))
    marked = [p for p in root.iter(f"{SVG}path") if p.get("marker-mid")]
    assert len(places(marked[-1].get("d"))) == 7
    bars = lines(root, "#0066a6")
    assert max(path.count("V") for path in bars) == 7


def test_noise_stays_small_and_keeps_its_highest_peak():
    t = np.arange(200_000) / 1000.0
    noise = np.random.default_rng(2).normal(size=(12, t.size))
    noise[7, 123_456] = 40.0
    series = [Series(f"{n}", t, y) for n, y in enumerate(noise)]
    chart = LineChart("c", "x", "y", series, height_px=500)
    made = static_picture(thin(chart, 10**6))
    assert len(made) < 100_000
    root = ET.fromstring(made)  # noqa: S314 - the kit's own picture
    top = min(places(p.get("d"))[:, 1].min() for p in root.iter(f"{SVG}path") if "l" in p.get("d"))
    assert top < texts(root)["0"][1] - 20 * UNITS


def test_equal_axes_have_equal_units():
    phase = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = Series("circle", 3.0 * np.cos(phase), 3.0 * np.sin(phase))
    root = drawn(ScatterChart("c", "x", "y", (circle,), has_equal_axes=True))
    points = places(lines(root, "#0066a6")[-1])
    width, height = np.ptp(points, axis=0)
    assert width == pytest.approx(height, rel=0.01)


def test_a_band_is_an_area_with_its_gaps():
    x = np.arange(5.0)
    low = np.array([0.0, 0.0, np.nan, 0.0, 0.0])
    root = drawn(LineChart("c", "x", "y", (Band("b", x, low, low + 1.0, "measured"),)))
    areas = [p.get("d") for p in root.iter(f"{SVG}path") if p.get("fill-opacity")]
    assert areas[-1].count("z") == 2

"""Pages in a real browser: nothing fails, nothing leaves, zoom works, stills stand in."""

import numpy as np
import pytest

from labpipe.report import (
    Band,
    Column,
    Details,
    Document,
    Gallery,
    LineChart,
    Paragraph,
    Picture,
    ScatterChart,
    Section,
    Series,
    Table,
    thumbnail,
)
from tests.labpipe.report.conftest import assert_quiet
from tests.labpipe.report.index_page import index_page, index_row

FULL = [0.0, 0.49995]


def bounce_train():
    """Return 0.5 s at 20 kHz of parabolas that lose a fifth of their speed at each bounce."""
    t = np.arange(10_000) / 20_000
    height = np.zeros_like(t)
    start, speed, touches = 0.0, 0.3, []
    while speed > 0.01:
        flight = 2 * speed / 9.81
        inside = (t >= start) & (t < start + flight)
        since = t[inside] - start
        height[inside] = speed * since - 9.81 / 2 * since**2
        start, speed = start + flight, speed * 0.8
        touches.append(start)
    return t, height, touches


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    t, height, touches = bounce_train()
    noisy = height + np.random.default_rng(0).normal(0, 1e-6, t.size)
    views = [(f"impact {i}", x - 5e-4, x + 5e-4) for i, x in enumerate(touches[:3], start=1)]
    f = np.array([0.1, 1.0, 10.0, 100.0])
    phase = np.linspace(0, 2 * np.pi, 200)
    picture = thumbnail(LineChart("p", "x", "y", (Series("a", t, height),)), 60)
    frames = tuple(Picture(picture, f"frame {i}", f"caption {i}", at=0.1 * i) for i in range(4))
    repeats = [Series(f"repeat {n}", t, noisy * 1e3 + shift, role="repeat", on_hover=True)
               for n, shift in ((1, -0.008), (2, 0.008))]  # fmt: skip
    curves = (
        Band("band", t, noisy * 1e3 - 0.01, noisy * 1e3 + 0.01, "measured"),
        *repeats,
        Series("measured", t, noisy * 1e3, role="measured"),
        Series("model", t, height * 1e3, role="model"),
    )
    lines = [(str(i), x) for i, x in enumerate(touches, start=1)]
    residual = Series("residual", t, (noisy - height) * 1e6, role="residual")
    moduli = Series("storage", f, 1e6 * f**0.2, "points", "measured", u=1e4 * f)
    charts = (
        LineChart("displacement", "time / s", "height / mm", curves, group="drop", views=views, vlines=lines),
        LineChart("residual", "time / s", "measured − model / µm", (residual,), group="drop", height_px=160),
        LineChart("moduli", "frequency / Hz", "modulus / Pa", (moduli,), x_scale="log", y_scale="log"),
        ScatterChart("loop", "x / m", "F / N", (Series("loop", np.cos(phase), np.sin(phase)),)),
    )
    folded = LineChart("folded", "x", "y", (Series("a", t, height, "step"),))
    table = Table((Column("n"), Column("e")), [(1, 0.8), (2, 0.5), (10, None), (3, -0.1)])
    sections = (
        Section("Charts", charts),
        Section("Film", (Gallery("film", frames, start=1, group="drop"),)),
        Section("Rest", (table, Details("more", (folded,), "raw"), Paragraph("text", copyable=True))),
    )
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(Document("A page", "of a test", "synthetic data", sections).render(), encoding="utf-8")
    return path


@pytest.fixture
def opened(browser, page):
    browser.media(prefers_color_scheme="light")
    browser.open(page)
    yield browser
    assert browser.complaints() == []
    assert browser.requests() == [page.as_uri()]


@pytest.mark.parametrize(("width", "scheme"), [(400, "dark"), (1280, "dark"), (2000, "light")])
def test_it_opens_without_complaints_or_requests_and_never_scrolls_sideways(browser, page, width, scheme):
    assert_quiet(browser, page, width, scheme)
    assert browser.run("document.querySelectorAll('.uplot canvas').length") == 4
    assert all(inked_pixels(browser, place) > 50 for place in range(4))
    background = browser.run("getComputedStyle(document.body).backgroundColor")
    assert background == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(20, 24, 28)")


def inked_pixels(browser, place):
    """Count the coloured pixels of a chart (its frame, grid and texts are grey)."""
    return browser.run(
        f"(() => {{ const c = document.querySelectorAll('.uplot canvas')[{place}];"
        " const copy = new OffscreenCanvas(c.width, c.height);"
        " const ink = copy.getContext('2d', { willReadFrequently: true });"
        " ink.drawImage(c, 0, 0);"
        " const d = ink.getImageData(0, 0, c.width, c.height).data; let n = 0;"
        " for (let i = 0; i < d.length; i += 4)"
        " if (d[i + 3] > 200 && Math.max(d[i], d[i+1], d[i+2]) - Math.min(d[i], d[i+1], d[i+2])"
        " > 80) n += 1; return n; })()"
    )


def test_dragging_zooms_the_whole_group_and_double_click_brings_it_back(opened, chart):
    left, top, width, height = chart.box(0)
    opened.drag((left + 0.2 * width, top + height / 2), (left + 0.4 * width, top + height / 2))
    opened.settle()
    shown = chart.window(0)
    assert shown == pytest.approx([0.1, 0.2], abs=2e-3)
    assert chart.window(1) == shown
    assert chart.window(2)[0] < 0.1
    opened.click(left + width / 2, top + height / 2, count=2)
    opened.settle()
    assert chart.window(0) == chart.window(1) == FULL
    left, top, width, height = chart.box(3)  # a loop zooms along both axes
    opened.drag((left + 0.5 * width, top + 0.1 * height), (left + 0.7 * width, top + 0.5 * height))
    opened.settle()
    shown = chart.window(3)
    assert shown[1] - shown[0] < 1.5


def test_a_view_shows_one_millisecond_with_the_axis_fitted_to_it(opened, chart):
    opened.run("document.querySelectorAll('.view')[2].click()")
    opened.settle()
    shown = chart.window(1)
    assert shown[1] - shown[0] == pytest.approx(1e-3)
    pressed = "document.querySelectorAll('.view')[{}].getAttribute('aria-pressed')"
    assert opened.run(pressed.format(2)) == "true"
    assert opened.run(pressed.format(0)) == "false"
    # Full rate inside, and read between the samples as the line is drawn: curves can be subtracted.
    left, top, width, height = chart.box(0)
    t, exact, _ = bounce_train()
    noisy = exact + np.random.default_rng(0).normal(0, 1e-6, t.size)
    for share in np.linspace(0.01, 0.99, 20):
        opened.mouse("mouseMoved", left + share * width, top + height / 2)
        texts = opened.run("[...document.querySelectorAll('.chart-legend .value')].map((v) => v.textContent)")
        x = float(opened.run("document.querySelector('.x-flag').textContent").replace("−", "-"))
        # Half a sample is 7 µm of the flight; the flag's last digit is 1 µs.
        assert float(texts[1].replace("−", "-")) == pytest.approx(1e3 * np.interp(x, t, noisy), abs=1e-3)


def test_the_slider_goes_from_the_whole_range_through_the_views_by_keys(opened, chart):
    assert opened.run("document.querySelectorAll('.view-slider').length") == 1
    opened.run("document.querySelector('.view-slider').focus()")
    views = opened.run("JSON.parse(document.querySelector('figure.chart script').textContent).views")
    for wanted in (*views, views[-1]):
        opened.key("ArrowRight")
        opened.settle()
        assert chart.window(0) == pytest.approx(wanted, abs=1e-12)
        assert chart.window(1) == chart.window(0)
    said = "document.querySelector('.view-slider').getAttribute('aria-valuetext')"
    assert opened.run(said) == "impact 3"
    opened.key("Home")
    assert chart.window(0) == FULL
    assert opened.run(said) == "Whole range"


def test_single_curves_show_only_where_one_points_and_are_named(opened, chart):
    opened.run("document.querySelectorAll('.view')[1].click()")
    left, top, width, height = chart.box(0)
    grey = "document.querySelectorAll('.crowd .value')[0].textContent"
    assert opened.run(grey) == ""
    before = drawn_bytes(opened)
    seen = set()
    for share in (0.02, 0.98):
        opened.mouse("mouseMoved", left + 0.5 * width, top + share * height)
        opened.settle()
        opened.settle()
        seen.add(opened.run(grey).split(":")[0])
    assert seen == {"repeat 1", "repeat 2"}
    assert drawn_bytes(opened) != before
    opened.mouse("mouseMoved", 2, 2)
    opened.settle()
    opened.settle()
    assert opened.run(grey) == ""
    assert drawn_bytes(opened) == before
    opened.run("document.querySelector('.crowd').click()")
    opened.settle()
    assert drawn_bytes(opened) != before


def drawn_bytes(browser):
    return browser.run("document.querySelector('.uplot canvas').toDataURL()")


def test_a_folded_chart_is_drawn_when_it_is_unfolded(opened):
    opened.run("document.querySelector('details').open = true")
    opened.settle()
    assert opened.run("document.querySelectorAll('.uplot canvas').length") == 5


def test_tables_sort_by_number_with_missing_cells_last(opened):
    click = "document.querySelectorAll('table.data .sort')[1].click()"
    column = "[...document.querySelectorAll('table.data tbody tr')].map(r => r.cells[0].textContent)"
    opened.run(click)
    assert opened.run(column) == ["3", "2", "1", "10"]
    opened.run(click)
    assert opened.run(column) == ["1", "2", "3", "10"]
    assert opened.run("document.querySelectorAll('th')[1].getAttribute('aria-sort')") == "descending"


def test_the_gallery_shows_one_frame_at_a_time(opened):
    shown = "[...document.querySelectorAll('.frame')].map(f => f.checkVisibility())"
    assert opened.run(shown) == [False, True, False, False]
    opened.run("document.querySelector('.gallery-next').click()")
    assert opened.run(shown) == [False, False, True, False]
    slide = "const s = document.querySelector('.gallery input'); s.value = 3;"
    opened.run(f"{{ {slide} s.dispatchEvent(new Event('input')); }}")
    assert opened.run(shown) == [False, False, False, True]


def visible_stills(browser):
    return browser.run(
        "[...document.querySelectorAll('.chart-still')].filter(i => i.checkVisibility() && i.naturalWidth > 100).length"
    )


def test_without_scripts_every_chart_and_frame_is_a_still_picture(browser, page):
    browser.open(page, scripts=False)
    browser.send("Emulation.setScriptExecutionDisabled", value=False)
    # Scripts did not run while the page was built; only this question is asked by script.
    assert not browser.run("document.documentElement.classList.contains('has-scripts')")
    browser.run("document.querySelector('details').open = true")
    browser.run("Promise.all([...document.images].map(i => i.decode()))")
    assert visible_stills(browser) == 5
    assert browser.run("[...document.querySelectorAll('.frame')].every(f => f.checkVisibility())")
    assert not browser.run("document.querySelector('.view').checkVisibility()")


def test_in_print_the_stills_stand_on_white_and_what_is_folded_stays_out(browser, page, tmp_path):
    browser.open(page)
    browser.media("print", prefers_color_scheme="dark")
    assert visible_stills(browser) >= 4
    assert not browser.run("document.querySelector('.chart-live').checkVisibility()")
    assert not browser.run("[...document.querySelectorAll('details:not([open])')].some(d => d.checkVisibility())")
    assert browser.run("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert browser.run("getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
    browser.media()
    browser.pdf(tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")
    assert browser.complaints() == []


def test_the_index_is_cards_on_a_phone_sorts_and_fits_on_paper(browser, tmp_path):
    columns = (Column("first restitution", "1"), Column("largest contact radius", "m"))
    rows = [index_row(f"experiment_{n}", 0.5 - 0.1 * n, 1e-3, href="a.html", remark="ball drop") for n in range(3)]
    path = tmp_path / "index.html"
    path.write_text(index_page("Session", rows, columns, caption="A caption of many words. " * 8))
    browser.open(path, width=400)
    assert browser.run("document.documentElement.scrollWidth") <= 400
    inside = "[...document.querySelectorAll('table.index td, caption')].every(c => {"
    inside += " const b = c.getBoundingClientRect(); return b.left >= 0 && b.right <= 400; })"
    assert browser.run(inside)
    label = "getComputedStyle(document.querySelectorAll('td[data-title]')[1], '::before').content"
    assert browser.run(label) == '"largest contact radius / mm"'
    browser.run("document.querySelectorAll('.sort')[2].click()")
    names = browser.run("[...document.querySelectorAll('table.index a')].map(a => a.textContent)")
    assert names == ["experiment_2", "experiment_1", "experiment_0"]
    assert browser.complaints() == []
    browser.open(path, width=round((210 - 2 * 16) / 25.4 * 96))  # of A4 between its margins
    browser.media("print")
    assert browser.run("document.querySelector('table').getBoundingClientRect().right") <= 673
    browser.media()

"""Whole reports of a session in a real browser: quiet, nothing asked for, as wide as the screen."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pipelines.session import beside, compare
from tests.labpipe.report.conftest import Browser, Charts, opened


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    yield from opened(tmp_path_factory.mktemp("profile"))


@pytest.mark.parametrize("page", ["index.html", "reports/drop.html", "reports/nbr.html"])
@pytest.mark.parametrize(("width", "scheme"), [(400, "dark"), (2000, "light")])
def test_a_report_opens_without_complaints_or_requests(
    window: Browser, processed_session: Path, page: str, width: int, scheme: str
) -> None:
    path = processed_session / "labpipe" / page
    window.media(prefers_color_scheme=scheme)
    window.open(path, width=width)
    assert window.complaints() == []
    assert window.requests() == [path.as_uri()]
    assert window.run("document.documentElement.scrollWidth") <= width


def test_pages_of_several_experiments_fit_and_ask_for_nothing(window: Browser, session_copy: Path) -> None:
    beside(session_copy, "drop", "nbr")
    compare(session_copy, jobs=0)
    pages = [session_copy / "labpipe" / name for name in ("compare.html", "beside-drop--nbr.html", "index.html")]
    for path in pages:
        for width in (390, 1400):
            window.open(path, width=width)
            assert window.complaints() == []
            assert window.requests() == [path.as_uri()]
            assert window.run("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("name", ["drop", "nbr"])
def test_the_chart_that_shows_the_verdict_is_on_the_first_screen(
    window: Browser, processed_session: Path, name: str
) -> None:
    window.open(processed_session / f"labpipe/reports/{name}.html", width=1400, height=900)
    top = window.run("document.querySelector('figure.chart').getBoundingClientRect().top")
    assert top < 600
    titles = window.run("[...document.querySelectorAll('h2')].map(h => h.textContent)")
    assert titles[:3] == ["Verdict", "Summary", "What the verdict rests on"]


def test_the_slider_leads_into_one_impact_of_one_millisecond_and_back(window: Browser, processed_session: Path) -> None:
    window.open(processed_session / "labpipe/reports/drop.html")
    charts = Charts(window)
    whole = charts.window(0)
    assert whole[1] - whole[0] > 100  # ms
    window.run("document.querySelector('.view-slider').focus()")
    window.key("ArrowRight")
    shown = charts.window(0)
    assert 1.0 < shown[1] - shown[0] < 2.0
    n_linked = window.run("document.querySelectorAll('figure.chart').length")
    assert all(charts.window(i) == shown for i in range(n_linked))
    window.key("Home")
    assert charts.window(0) == pytest.approx(whole, rel=1e-9)


def test_each_repeat_shows_where_one_points_and_the_same_one_in_every_chart(
    window: Browser, processed_session: Path
) -> None:
    window.open(processed_session / "labpipe/reports/drop.html")
    charts = Charts(window)
    left, top, width, height = charts.box(0)
    window.mouse("mouseMoved", left + width / 2, top + height / 2)
    window.settle()
    window.settle()
    said = window.run("[...document.querySelectorAll('.crowd .value')].map(e => e.textContent)")
    assert len(said) == 2  # displacement and velocity
    names = {text.split(":")[0] for text in said}
    assert len(names) == 1
    assert names <= {"repeat 1", "repeat 2"}
    assert window.complaints() == []


@pytest.mark.parametrize("name", ["drop", "nbr"])
def test_without_scripts_every_chart_is_a_still_picture(window: Browser, processed_session: Path, name: str) -> None:
    window.open(processed_session / f"labpipe/reports/{name}.html", scripts=False)
    window.send("Emulation.setScriptExecutionDisabled", value=False)
    counts = window.run(
        "[document.querySelectorAll('figure.chart').length,"
        " [...document.querySelectorAll('.chart-still')].filter(i => i.checkVisibility()"
        " && i.naturalWidth > 100).length]"
    )
    assert counts[0] == counts[1] > 3


def test_a_report_leads_to_the_session_and_back(window: Browser, processed_session: Path) -> None:
    window.open(processed_session / "labpipe/reports/drop.html")
    target = window.run("document.querySelector('.home a').href")
    assert target == (processed_session / "labpipe/index.html").resolve().as_uri()
    window.open(processed_session / "labpipe/index.html")
    links = window.run("[...document.querySelectorAll('table.index a')].map(a => a.href)")
    assert links == [
        (processed_session / f"labpipe/reports/{name}.html").resolve().as_uri() for name in ("drop", "nbr")
    ]

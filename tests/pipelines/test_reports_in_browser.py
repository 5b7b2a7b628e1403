"""Whole reports of a session in a real browser: quiet, nothing asked for, as wide as the screen."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pipelines.session import beside, compare
from tests.labpipe.report.conftest import Browser, assert_quiet, opened


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    yield from opened(tmp_path_factory.mktemp("profile"))


def test_pages_open_without_complaints_or_requests_and_never_scroll_sideways(
    window: Browser, session_copy: Path
) -> None:
    beside(session_copy, "drop", "nbr")
    compare(session_copy, jobs=0)
    for page in ("index", "reports/drop", "reports/nbr", "compare", "beside-drop--nbr"):
        for width, scheme in ((390, "dark"), (2000, "light")):
            assert_quiet(window, session_copy / f"labpipe/{page}.html", width, scheme)


@pytest.mark.parametrize("name", ["drop", "nbr"])
def test_the_chart_that_shows_the_verdict_is_on_the_first_screen(
    window: Browser, processed_session: Path, name: str
) -> None:
    window.open(processed_session / f"labpipe/reports/{name}.html", width=1400, height=900)
    top = window.run("document.querySelector('figure.chart').getBoundingClientRect().top")
    assert top < 600
    titles = window.run("[...document.querySelectorAll('h2')].map(h => h.textContent)")
    assert titles[:3] == ["Verdict", "Summary", "What the verdict rests on"]

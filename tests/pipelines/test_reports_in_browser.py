"""Whole reports of a session in a real browser: quiet, nothing asked for, as wide as the screen."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.labpipe.report.conftest import CHROMIUM, Browser


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine; the reports are not looked at")
    started = Browser(tmp_path_factory.mktemp("profile"))
    yield started
    started.close()


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


def test_a_report_leads_to_the_session_and_back(window: Browser, processed_session: Path) -> None:
    window.open(processed_session / "labpipe/reports/drop.html")
    target = window.run("document.querySelector('.home a').href")
    assert target == (processed_session / "labpipe/index.html").resolve().as_uri()
    window.open(processed_session / "labpipe/index.html")
    links = window.run("[...document.querySelectorAll('table.index a')].map(a => a.href)")
    assert links == [
        (processed_session / f"labpipe/reports/{name}.html").resolve().as_uri()
        for name in ("drop", "nbr")
    ]

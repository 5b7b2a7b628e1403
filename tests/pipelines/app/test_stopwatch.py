"""A stick of 51 files becomes a first verdict by the browser alone, in few clicks and values."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.labpipe.report.conftest import CHROMIUM, Browser
from tests.pipelines.app.conftest import Page
from tests.pipelines.app.pile import FILES, write_pile
from tests.pipelines.app.stopwatch import Count, to_verdicts


def test_the_time_of_a_person_is_the_sum_of_what_the_person_does() -> None:
    assert Count().seconds == 0
    assert Count(clicks=2, typed=10, values=1, parts=1, moves=1).seconds == pytest.approx(5.3 + 2.8 + 0.4 + 5 + 10)


@pytest.mark.slow
def test_a_stick_of_files_becomes_a_first_verdict_in_minutes_of_a_person(
    tmp_path: Path, serving: Callable[[Path], Page]
) -> None:
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine; the page is not looked at")
    stick = write_pile(tmp_path / "stick")
    before = {path: path.read_bytes() for path in stick.rglob("*") if path.is_file()}
    assert len(before) == FILES
    page = serving(stick)
    window = Browser(tmp_path / "profile")
    try:
        count, _ = to_verdicts(window, page.address, is_whole=False)["first verdict"]
        assert {a for a in window.requests() if not a.startswith(page.address)} == set()
        assert window.complaints() == []
    finally:
        window.close()
    assert count.clicks <= 13
    assert count.values <= 7
    assert count.typed <= 80
    assert count.seconds < 5 * 60
    assert all(path.read_bytes() == data for path, data in before.items())

"""Pages of two experiments side by side."""

import re
from pathlib import Path

import pytest

from labpipe.errors import InputError, UsageError
from pipelines.session import beside, process
from tests.pipelines.command import run


@pytest.fixture
def twins(session_copy: Path) -> Path:
    """The drop under a second name: every result is there already but the judgement and the page."""
    path = session_copy / "session.toml"
    text = path.read_text("utf-8")
    drop = text[text.index("[experiments.drop]") : text.index("[experiments.nbr]")]
    path.write_text(text + "\n" + drop.replace("experiments.drop", "experiments.twin"), "utf-8")
    process(session_copy, jobs=0)
    return session_copy


def headings(page: Path) -> list[str]:
    return re.findall("<h2>(.*?)</h2>", page.read_text("utf-8"))


def test_two_experiments_stand_side_by_side_and_the_index_leads_there(
    twins: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = beside(twins, "drop", "twin")
    text = page.read_text("utf-8")
    assert page.name == "beside-drop--twin.html"
    assert headings(page)[:2] == ["Answer", "Difference"]
    assert re.search(r"0 of \d+ quantities measured in both differ by more", text)
    assert 'href="reports/drop.html"' in text
    assert text.index("quantities measured in both") < text.index("<figure") < text.index("drop minus twin")
    assert text.index("drop: ") < text.index("quantities measured in both")
    index = (twins / "labpipe/index.html").read_text("utf-8")
    assert 'href="beside-drop--twin.html"' in index
    assert "side by side: drop and twin" in index
    code, out, _ = run(capsys, "compare", str(twins), "--beside", "twin", "nbr")
    assert (code, "beside-twin--nbr.html" in out) == (0, True)
    assert "No quantity is measured in both" in (twins / "labpipe/beside-twin--nbr.html").read_text("utf-8")


def test_what_cannot_stand_side_by_side_is_refused(small_session: Path, processed_session: Path) -> None:
    with pytest.raises(UsageError, match='no experiment "dorp"'):
        beside(processed_session, "dorp", "nbr")
    with pytest.raises(UsageError, match="named twice"):
        beside(processed_session, "nbr", "nbr")
    with pytest.raises(InputError, match="drop has no results that are up to date"):
        beside(small_session, "drop", "nbr")

"""What a notebook gets: xarray objects, and HTML in which every text is escaped."""

from html.parser import HTMLParser
from pathlib import Path

import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.notebook import html_table
from labpipe.report import Report
from pipelines.session import report, result, results


class Tags(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.found.append((tag, dict(attrs)))


def test_hostile_texts_stay_texts() -> None:
    evil = '"><script>alert(1)</script>'
    tags = {tag for tag, _ in Tags(html_table(evil, (evil,), [(evil,)])).found}
    assert tags == {"table", "caption", "thead", "tr", "th", "tbody", "td"}


def test_a_report_is_shown_in_a_frame_that_reaches_nothing_else(processed_session: Path) -> None:
    made = report(processed_session, "drop")
    (tag, attrs), *rest = Tags(made._repr_html_()).found
    assert (tag, rest) == ("iframe", [])
    assert attrs["sandbox"] == "allow-scripts"
    assert attrs["srcdoc"] == made.path.read_text("utf-8")
    assert isinstance(made, Report)
    with pytest.raises(InputError, match=r'no report of "dorp" yet.*experiments: drop, nbr'):
        report(processed_session, "dorp")


def test_results_of_an_experiment_are_one_tree(processed_session: Path, small_session: Path) -> None:
    with pytest.raises(InputError, match="--only drop"):
        results(small_session, "drop")
    tree = results(processed_session, "drop")
    assert isinstance(tree, xr.DataTree)
    assert set(tree.children) >= {"readings", "bounces", "repeats", "model", "comparison"}
    assert set(tree["bounces"].children) == {"drop_1", "drop_2"}
    xr.testing.assert_identical(
        tree["bounces/drop_1"].to_dataset(), result(processed_session, "drop", "bounces", "laser/drop_1.csv")
    )

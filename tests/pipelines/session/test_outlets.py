"""Every outlet tells the same verdict: the command, JSON, the pages, the catalogue, exports and Python."""

import csv
import json
import re
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from click.testing import CliRunner

import labpipe as lp
from labpipe.judging import FLAGS
from pipelines.commands.session import process as command
from pipelines.session import PAGE, process, verdict_on
from tests.pipelines.sessions import page_of, replaced


def _copied(folder: Path) -> None:
    (folder / "laser/drop_2.csv").write_bytes((folder / "laser/drop_1.csv").read_bytes())


def _told(folder: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, dict[str, Any]]:
    """Return by outlet what it says of each experiment: how believable it is."""
    done = process(folder, jobs=0)
    runner = CliRunner()
    text = runner.invoke(command, [str(folder), "--jobs", "0"]).output
    document = json.loads(runner.invoke(command, [str(folder), "--jobs", "0", "--json"]).output)
    names = list(done.session.experiments)
    pages = {n: page_of(folder, n) for n in names}
    compared = {one["experiment"]: one["believable"] for one in lp.compare(folder, jobs=0).experiments}
    index = (folder / "labpipe" / PAGE).read_text("utf-8")
    lp.export(folder, "csv", out=folder.parent / "csv")
    lp.export(folder, "nc", stages=["comparison"], out=folder.parent / "nc")
    (summary,) = [p for p in (folder.parent / "csv").glob("*.csv") if "believable" in p.read_text("utf-8")]
    rows = csv.DictReader(line for line in summary.read_text("utf-8").splitlines() if not line.startswith("#"))
    flags: dict[str, set[str]] = {n: set() for n in names}
    words = {number: word for word, number in FLAGS.items()}
    for path in (folder.parent / "nc").glob("*.nc"):
        with xr.open_dataset(path) as dataset:
            flags[dataset.attrs["experiment"]].add(words[int(dataset["quality_flag"])])
    capsys.readouterr()
    table = lp.catalogue(folder.parent).table.set_index("experiment")
    return {
        "command": {n: re.search(rf"^{n}: believable: (\w+)", text, re.MULTILINE)[1] for n in names},  # type: ignore[index]
        "json": {one["experiment"]: one["believable"] for one in document["experiments"]},
        "page": {n: _of_page(pages[n]) for n in names},
        "index": {n: _of_index(index, n) for n in names},
        "compare": compared,
        "table": {row["experiment"]: row["believable"] for row in rows},
        "flag": {n: ", ".join(sorted(found)) for n, found in flags.items()},
        "catalogue": {n: table.loc[n, "believable"] for n in names},
        "verdict": {one.experiment: one.believable for one in lp.verdict(folder, jobs=0).experiments},
        "verdict_on": {n: verdict_on(folder, n).believable for n in names},
    }


def _of_page(page: str) -> str:
    """Return what the first notice of a page says."""
    level, text = re.findall(
        r'<div class="notice notice-(\w+)"[^>]*><strong>\w+</strong><span[^>]*>(.*?)</span>', page
    )[0]
    word = text.split(":")[0].lower()
    assert level == {"impossible": "error", "doubtful": "warning"}.get(word, level)
    return word if word in ("impossible", "doubtful") else "yes"


def _of_index(index: str, name: str) -> str:
    row = re.search(rf"<tr[^>]*>(?:(?!</tr>).)*reports/{name}\.html.*?</tr>", index, re.DOTALL)
    assert row is not None
    words = [word for word in ("impossible", "doubtful") if word in row[0]]
    return words[0] if words else "yes"


_EDITS = {
    "a copy for a repeat": (_copied, {"drop": "doubtful"}, "holds the same bytes as laser/drop_1.csv"),
    "height of another drop": (partial(replaced, old='height = "1.5', new='height = "15'), {"drop": "impossible"}, ""),
}


@pytest.mark.parametrize("edit", _EDITS)
def test_all_outlets_say_the_same(edit: str, session_copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change, expected, text = _EDITS[edit]
    change(session_copy)
    told = _told(session_copy, capsys)
    whole = dict.fromkeys(told["json"], "yes") | expected
    for outlet, said in told.items():
        assert said == {n: whole[n] for n in said}, outlet
        assert said.keys() >= expected.keys(), outlet
    for name in expected:
        assert text in page_of(session_copy, name)


def test_a_page_is_amended_once_and_comes_back_when_the_finding_goes(session_copy: Path) -> None:
    page, laser = session_copy / "labpipe/reports/drop.html", session_copy / "laser/drop_2.csv"
    before, whole = page.read_bytes(), laser.read_bytes()
    _copied(session_copy)
    process(session_copy, jobs=0)
    amended = page.read_bytes(), page.stat().st_mtime_ns
    assert b"laser/drop_2.csv holds the same bytes as laser/drop_1.csv" in amended[0]
    assert all(o.state == "cached" for o in process(session_copy, jobs=0).outcomes)
    assert (page.read_bytes(), page.stat().st_mtime_ns) == amended
    page.write_bytes(amended[0].replace(b"Doubtful", b"Believable"))
    process(session_copy, jobs=0)
    assert page.read_bytes() == amended[0]
    laser.write_bytes(whole)
    process(session_copy, jobs=0)
    assert page.read_bytes() == before

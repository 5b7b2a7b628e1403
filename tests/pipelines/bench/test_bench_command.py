"""The command bench with a toy part: files, page, JSON, names, failures."""

import json
import math
import re
from pathlib import Path

import pytest

from labpipe.errors import UsageError
from pipelines.bench import page, parts
from pipelines.bench.measure import Bound, Point, Suite
from pipelines.commands.system import bench

TOY = Suite(
    "toy",
    "Sums of numbers <against> themselves",
    "error (px)",
    (
        Point("fine", 1e-5, 2.0, is_default=True, cold_seconds=3.0),
        Point("coarse", 1e-3, 0.5, extra={"bias (px)": 4e-4}),
        Point("exact", 0.0, 1.0),
        Point("central differences", 1e-2, 0.25, "thesis"),
        Point("other", 2e-2, 1.0, "peer"),
        Point("not timed", 1e-4, math.nan),
    ),
    (Bound("rounding", 1e-7),),
    ("peer2 is not installed",),
)


def broken(quick: bool) -> list[Suite]:
    raise RuntimeError(f"quick is {quick}")


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    table = {"toy": ("toy", "Toy sums."), "pair": ("pair", "Two suites."), "broken": ("broken", "Fails.")}
    runs = {"toy": lambda quick: [TOY], "pair": lambda quick: [TOY, TOY], "broken": broken}
    monkeypatch.setattr(parts, "PARTS", table)
    monkeypatch.setattr(page, "PARTS", table)
    monkeypatch.setattr(parts, "load", runs.__getitem__)


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as left:
        bench.main(list(arguments), standalone_mode=True)
    return int(left.value.code or 0), *capsys.readouterr()


@pytest.mark.usefixtures("toy")
def test_a_run_writes_page_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "toy", "--quick", "--out", str(tmp_path / "new"), "--json")
    assert code == 0
    document = json.loads(out)
    assert document == json.loads((tmp_path / "new/bench.json").read_text())
    assert str(Path.home()) not in out
    suite = document["parts"][0]["suites"][0]
    assert suite["points"][5]["seconds"] is None
    assert suite["bounds"] == [{"label": "rounding", "error": 1e-7}]
    text = (tmp_path / "new/bench.html").read_text()
    assert "&lt;against&gt;" in text
    assert "peer2 is not installed" in text
    # nothing is asked for over a network
    assert not re.search(r"(src|href)=[\"']?https?:", text)


@pytest.mark.usefixtures("toy")
def test_a_part_that_fails_is_told_and_the_others_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "--out", str(tmp_path))
    assert code == 1
    assert "broken: RuntimeError: quick is False" in err
    document = json.loads((tmp_path / "bench.json").read_text())
    assert [p["name"] for p in document["parts"]] == ["toy", "pair"]
    assert document["failures"][0]["name"] == "broken"
    assert "quick is False" in (tmp_path / "bench.html").read_text()
    assert "bench.html" in out


def test_parts_are_listed_and_an_unknown_one_is_answered_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--list")
    assert (code, [line.split()[0] for line in out.splitlines()]) == (0, list(parts.PARTS))
    assert parts.chosen(["velocity", "contact-radius"]) == parts.chosen(["contact_radius", "velocity"])
    with pytest.raises(UsageError, match='did you mean "velocity"'):
        parts.chosen(["velocty"])


def test_the_fastest_of_ours_that_errs_no_more_is_compared_run_by_run() -> None:
    points = (
        Point("fine", 1e-4, 4.0, is_default=True, samples=(4.0, 5.0, 3.0)),
        Point("coarse", 1e-2, 1.0, samples=(1.0, 1.0, 2.0)),
        Point("steps, long", 5e-1, 0.5, "thesis", samples=(0.5, 0.5, 0.5)),
        Point("steps, short", 2e-2, 3.0, "thesis", samples=(3.0, 4.0, 3.0)),
        Point("peer's", 1e-6, 8.0, "peer"),
        Point("not timed", 1e-9, math.nan, "formula"),
        Point("even", 3e-2, 3.3, "steady", samples=(3.0, 3.3, 5.8)),
    )
    table = page.ratios([Suite("toy", "Toy", "error (1)", points)])
    assert table is not None
    thesis, peer, steady = table.rows
    # times that vary so much from run to run measure the machine
    assert thesis == ("toy", "thesis: steps, short", "coarse", pytest.approx(2.0), None, 1.5, 4.0)
    assert peer == ("toy", "peer's", "fine", pytest.approx(0.01), 2.0, None, None)
    assert steady[4:] == (3.0, pytest.approx(2.9), pytest.approx(3.3))
    assert page.ratios([Suite("alone", "Alone", "error (1)", points[:2])]) is None

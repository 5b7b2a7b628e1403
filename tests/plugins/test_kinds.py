"""A kind of experiment of another distribution takes part in every verb; a broken one harms none.

Everything runs in processes of its own, where the toys' distributions are installed: which kinds
there are is settled once per process.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
FREQUENCY = 15.8  # Hz; a sag of 0.995 mm
VERBS = """
import contextlib, io, json, sys, warnings
from pipelines.cli import main
said = {}
for line in json.loads(sys.stdin.read()):
    heard = io.StringIO()
    try:
        with contextlib.redirect_stdout(heard):
            main(line)
        code = 0
    except SystemExit as left:
        code = left.code or 0
    said[" ".join(line[:1])] = [code, heard.getvalue()]
print(json.dumps(said))
"""


def run(lines: list[list[str]], *homes: Path) -> dict[str, tuple[int, Any]]:
    """Run command lines in one process that finds some distributions; return code and JSON."""
    path = os.pathsep.join(map(str, (*homes, ROOT)))
    done = subprocess.run(
        [sys.executable, "-c", VERBS],
        input=json.dumps(lines),
        text=True,
        check=False,
        capture_output=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    return {name: (code, json.loads(text) if text else None) for name, (code, text) in said.items()}


def write_recordings(folder: Path) -> None:
    """Write two recordings of a bar as the toy vibrometer does."""
    folder.mkdir()
    time = np.arange(2000) * 1e-3
    for number in (1, 2):
        noise = np.random.default_rng(number).normal(0.0, 0.05, time.size)
        moved = 10.0 * np.exp(-0.5 * time) * np.sin(2 * np.pi * FREQUENCY * time + number) + noise
        head = "toy vibrometer\nstart 2024-05-14T10:22:31\ninterval_s 0.001\n"
        text = head + "".join(f"{value:.3f}\n" for value in moved)
        (folder / f"bar_{number}.txt").write_text(text, "utf-8")


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, Any]]:
    """What every verb says of a folder of recordings, from ``init`` on."""
    folder = tmp_path_factory.mktemp("toy") / "session"
    write_recordings(folder)
    homes = (HERE / "toy_instrument", HERE / "toy_kind")
    session = str(folder)
    begun = run([["init", session, "--json"], ["doctor", session, "--json"]], *homes)
    file = folder / "session.toml"
    file.write_text(file.read_text("utf-8").replace("FILL mm", "0.995 ± 0.002 mm"), "utf-8")
    lines = [
        ["inspect", str(file), "--json"],
        ["plan", session, "--json"],
        ["process", session, "--json"],
        ["compare", session, "--json"],
        ["sensitivity", session, "--json"],
        ["catalogue", session, "--json"],
        ["export", session, "--format", "json", "--json"],
    ]
    return begun | run(lines, *homes) | {"folder": (0, folder)}


def test_it_is_known_and_proposed_before_ours_are_asked(said: dict[str, tuple[int, Any]]) -> None:
    assert {name: code for name, (code, _) in said.items() if code and name != "doctor"} == {}
    assert 'the plug-in "ringing_bar" of toy-kind 1.0 is used' in said["doctor"][1]["plugins"]
    begun = said["init"][1]
    assert begun["experiments"] == ["bar"]
    (gap,) = (line for line in begun["to_fill"] if line.startswith("session.toml"))
    assert "sag" in gap
    assert said["inspect"][1]["experiments"] == "bar (ringing_bar)"
    rows = said["plan"][1]["rows"]
    assert {row["stage"] for row in rows} == {"readings", "frequency", "comparison", "report"}
    assert len(rows) == 6


def test_its_results_are_right_and_on_every_page(said: dict[str, tuple[int, Any]]) -> None:
    folder = said["folder"][1]
    index = (folder / "labpipe/index.html").read_text("utf-8")
    assert "bar frequency" in index
    assert 'src="data:image/svg+xml;base64,' in index
    assert "by the sag" in (folder / "labpipe/reports/bar.html").read_text("utf-8")
    (row,) = said["compare"][1]["rows"]
    assert (row["kind"], row["condition"], row["n"]) == ("ringing_bar", "sag 0.995 mm", 2)
    assert abs(row["measured"] - FREQUENCY) < 3 * row["u_measured"] < 0.1
    assert abs(row["deviation"]) < 3
    (quantity,) = said["sensitivity"][1]["quantities"]
    assert quantity["quantity"] == "frequency of the bar"
    assert [Path(page).name for page in said["sensitivity"][1]["pages"]] == ["sensitivity_ringing_bar.html"]


def test_it_is_catalogued_and_exported(said: dict[str, tuple[int, Any]]) -> None:
    (row,) = said["catalogue"][1]["rows"]
    assert row["bar_frequency"] == pytest.approx(FREQUENCY, abs=0.05)
    assert row["sag"] == 0.995e-3
    names = sorted(Path(path).name for path in said["export"][1]["files"])
    each = [f"bar.{stage}.bar_{number}.json" for stage in ("frequency", "readings") for number in (1, 2)]
    assert names == ["bar.comparison.json", *each]


TOY = "from dataclasses import replace\nfrom toy_kind.kind import KIND as toy\nKIND = replace(toy, {})"
BROKEN = {
    "absent": ("import nothing_of_this_name", "ModuleNotFoundError"),
    "no kind": ("KIND = 3", "expected a Kind"),
    "ours": (TOY.format("name='ball_drop'"), 'the name "ball_drop" is taken'),
    "stages": (TOY.format("name='c', stages=toy.stages[1:]"), 'unknown input "readings"'),
    "schema": (TOY.format("name='b', schemas=()"), "schemas that it does not bring"),
}


def test_a_broken_one_is_named_and_left_out(tmp_path: Path) -> None:
    for name, (source, _) in BROKEN.items():
        module = "lab_" + name.replace(" ", "_")
        home = tmp_path / "site"
        info = home / f"{module}-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[labpipe.kinds]\nbad = {module}:KIND\n")
        (home / f"{module}.py").write_text(source + "\n")
    empty = tmp_path / "empty"
    empty.mkdir()
    _, found = run([["doctor", str(empty), "--json"]], HERE / "toy_instrument", HERE / "toy_kind", tmp_path / "site")[
        "doctor"
    ]
    listed = "\n".join(line for line in found["plugins"] if "left out" in line)
    for _, reason in BROKEN.values():
        assert reason in listed
    assert 'the plug-in "ringing_bar" of toy-kind 1.0 is used' in found["plugins"]

"""The command simulate as a new user meets it: units, maps, ledger, and what is refused."""

import json
import shlex
from pathlib import Path

import pytest

from labpipe import files
from tests.pipelines.command import run


def simulate(capsys: pytest.CaptureFixture[str], line: str, *more: str) -> tuple[int, str, str]:
    return run(capsys, "simulate", *shlex.split(line), *more)


def test_a_drop_on_a_plate_shows_units_ledger_and_what_the_plate_takes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "drop.nc"
    plate = "--plate-mass '30 kg' --plate-frequency '180 Hz' --plate-damping 0.03"
    code, text, _ = simulate(capsys, f"drop --duration '0.03 s' --rtol 1e-3 {plate} --out {out}")
    assert code == 0
    rows = {line[:34].strip(): line[34:].split() for line in text.splitlines()}
    assert rows["first peak force"][1] == "N"
    assert rows["plate energy at the end"][1].endswith("J")
    assert rows["first contact duration"][1] == "ms"
    assert "restitution" in rows["impact 1"]
    assert float(rows["first restitution on a rigid flat"][0]) > float(rows["first restitution"][0])
    assert float(rows["energy error"][0]) < 1e-3
    assert files.read_dataset(out)["force"].dims == ("time",)


def test_an_indentation_keeps_maps_and_says_what_its_steps_mislay(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out, picture = tmp_path / "indent.nc", tmp_path / "indent.svg"
    line = f"indent --cycles 1 --hold '1 s' --elements 128 --maps --out {out} --picture {picture} --json"
    code, text, _ = simulate(capsys, line)
    document = json.loads(text)
    assert code == 0
    assert document["units"]["peak force"] == "N"
    assert document["energy error"] < 1e-3
    assert files.read_dataset(out)["pressure"].dims == ("time", "x")
    assert b"<svg" in picture.read_bytes()


def test_a_drop_says_whether_adhesion_and_heating_matter(capsys: pytest.CaptureFixture[str]) -> None:
    asked = "--temperature '39 degC' --vertical-shift 1.1 --adhesion '50 mJ/m2' --heating"
    code, text, _ = simulate(capsys, f"drop --duration '0.03 s' --rtol 1e-3 {asked} --json")
    assert code == 0
    document = json.loads(text)
    assert document["adhesion"] == document["self-heating"] == "negligible"
    assert document["adhesion pull-off force"] == pytest.approx(2.244e-3, rel=1e-3)
    assert 0.2 < document["self-heating by the first impact"] < 1.0
    assert document["units"]["self-heating by the first impact"] == "K"
    assert document["thermal properties"].startswith("estimate")


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("adhesion --work '50 mJ'", 2, "is in J; expected a number in J/m2"),
        ("indent --tip-radius '2 ± 0.5 mm'", 2, "states an uncertainty, and one computation"),
        ("drop --duration '0.01 s' --adhesion '50 mJ/m2'", 3, "no completed impact"),
        ("indent --mean '5 mm'", 3, "reaches the end of the indenter"),
        ("drop --picture x.bmp --duration '0.02 s'", 3, "figure format"),
    ],
)
def test_bad_values_are_refused_with_the_reason(
    capsys: pytest.CaptureFixture[str], line: str, code: int, words: str
) -> None:
    found, _, said = simulate(capsys, line)
    assert found == code
    assert words in said

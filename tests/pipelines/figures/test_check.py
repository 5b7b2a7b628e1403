"""The check table against numbers worked out by hand."""

import json
from collections import Counter

import pytest

from pipelines.cli import main
from pipelines.figures import check

ROWS = {(row.place, row.quantity): row for row in check.rows()}


def test_there_are_forty_rows_and_each_difference_has_a_reason() -> None:
    assert len(ROWS) >= 40
    for row in ROWS.values():
        assert bool(row.reason) != (row.verdict == "agrees"), row


def test_every_stated_misprint_and_only_those() -> None:
    verdicts = Counter(row.verdict for row in ROWS.values())
    assert verdicts["misprint"] == sum(bool(row.misprint) for row in ROWS.values())


@pytest.mark.parametrize(
    ("place", "quantity", "expected"),
    [
        ("reference", "impact speed from 10 mm", (2 * 9.81 * 0.010) ** 0.5),
        ("3.3.2", "first contact of PTFE from 7 mm", (2 * 0.007 / 9.81) ** 0.5),
        ("D.2", "front camera, in um", 30e3 / 386),
        ("3.1", "camera under the disc", 1e3 / 461),
        ("table D.1", "uncertainty of the front camera, 2 px", 200 / 386),
        ("2.5", "f tau_0 at 0.5 Hz", 0.5 * 1.56e-10),
        ("2.4", "Delta/R at 0.3 mm", 0.3 / 2),
        ("3.3.4", "load 5 from the masses of 3.1", 5.5),
        # (3 F R / 4 E*)^(1/3) with F = 0.505 kg g, R = 9.525 mm, E* = 3.2 GPa / (1 - 0.35^2)
        (
            "reference",
            "Hertz radius at rest, E = 3.2 GPa",
            1e3 * (0.75 * 0.505 * 9.81 * 9.525e-3 * (1 - 0.35**2) / 3.2e9) ** (1 / 3),
        ),
    ],
)
def test_ours_is_the_hand_computed_number(place: str, quantity: str, expected: float) -> None:
    assert ROWS[place, quantity].ours == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("depth", "force"), [("0.1", 12.40), ("0.2", 30.90), ("0.3", 54.81)])
def test_plateaus_follow_from_one_modulus(depth: str, force: float) -> None:
    row = ROWS["2.3.2", f"plateau force at {depth} mm"]
    assert row.ours == pytest.approx(force, abs=0.03)
    assert row.verdict == "agrees"


def test_the_command_prints_the_table_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["figures", "--check", "--json"])
    assert not left.value.code
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert len(rows) == len(ROWS)
    assert {"printed", "ours", "difference", "verdict", "reason"} <= set(rows[0])

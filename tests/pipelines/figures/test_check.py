"""The check table against numbers worked out by hand."""

import numpy as np
import pytest

from pipelines.figures import check

Rows = dict[tuple[str, str], check.Row]


@pytest.fixture(scope="module")
def table() -> Rows:
    return {(row.place, row.quantity): row for row in check.rows()}


def test_there_are_forty_rows_and_each_difference_has_a_reason(table: Rows) -> None:
    assert len(table) >= 40
    for row in table.values():
        assert bool(row.reason) != (row.verdict == "agrees"), row


def test_no_spectrum_gives_the_printed_peaks(table: Rows) -> None:
    rows = [table["2.3.2", f"peak over plateau less 1 at {depth} mm"] for depth in ("0.1", "0.2", "0.3")]
    # Printed, the excess rises from the second depth to the third; of any spectrum it falls.
    assert rows[1].printed < rows[2].printed
    assert rows[0].ours > rows[1].ours > rows[2].ours
    assert "inconsistent with linear viscoelasticity" in {row.verdict for row in rows}
    # Half a digit of all six forces does not help.
    best = check.best_excesses((23.15 / 12.15 - 1, 44.75 / 30.95 - 1, 80.55 / 55.55 - 1))
    assert abs(best[2] - (80.55 / 55.55 - 1)) + abs(best[1] - (44.75 / 30.95 - 1)) > 0.01


def test_ours_is_the_hand_computed_number(table: Rows) -> None:
    expected = {
        ("3.3.2", "first contact of PTFE from 7 mm"): (2 * 0.007 / 9.81) ** 0.5,
        ("table D.1", "uncertainty of the front camera, 2 px"): 200 / 386,
        ("2.5", "f tau_0 at 0.5 Hz"): 0.5 * 1.56e-10,
        ("3.3.4", "load 5 from the masses of 3.1"): 5.505,
        # p0 / 1.6 at an approach of 20 um, p0 = 2 E* (20 um / R)^(1/2) / pi
        ("A.1 text", "'yield stress range of 0.02-0.04', as a stress"): (
            2 * 3.2e9 / (1 - 0.35**2) / np.pi * (20e-6 / 9.525e-3) ** 0.5 / 1.6
        ),
        # (3 F R / 4 E*)^(1/3) with F = 0.505 kg g, R = 9.525 mm, E* = 3.2 GPa / (1 - 0.35^2)
        ("reference", "Hertz radius at rest, E = 3.2 GPa"): (
            1e3 * (0.75 * 0.505 * 9.81 * 9.525e-3 * (1 - 0.35**2) / 3.2e9) ** (1 / 3)
        ),
    }
    for row, value in expected.items():
        assert table[row].ours == pytest.approx(value, rel=1e-6), row


def test_misprints_are_found_by_what_the_equations_give(table: Rows) -> None:
    amplitude = table["1.15", "amplitude of the stress over |G*| epsilon_0"]
    # a standard linear solid, 1 and 3, at omega tau = 0.5: tan delta = 0.5 * 3 / (1 + 0.25 * 4)
    assert np.log(amplitude.printed) == pytest.approx(np.arctan2(1.2, 1.6), rel=1e-9)
    assert amplitude.ours == pytest.approx(1.0, abs=1e-4)
    entropy = table["1.17", "dissipation by (1.16), (1.17) over (1.22), rubber"]
    assert entropy.ours == pytest.approx(1.0, abs=1e-5)
    verdicts = {(row.place, row.quantity): row.verdict for row in table.values()}
    assert verdicts["1.17", entropy.quantity] == verdicts["1.15", amplitude.quantity] == "misprint"
    assert verdicts["1.26, 2.35", "sign of d log a_T / d T by both"] == "inconsistent"
    assert verdicts["3.3.3", "peak force by lambda = 40 um, dt = 0.2 ms"] == "inconsistent"
    assert verdicts["3.3.3", "peak force by lambda = 40 um, dt = 4 us, not printed"] == "agrees"

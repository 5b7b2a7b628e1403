"""Budgets of the main quantities: the uncertainties of the results, and true advice."""

import json
from math import cos
from pathlib import Path

import pytest

from labpipe.uncertainty import Input
from pipelines import session as verbs
from pipelines.experiments.shared.budget_quantity import Quantity
from pipelines.session import sensitivity
from pipelines.session._sensitivity import answer, examined
from tests.pipelines.command import run


@pytest.fixture(scope="module")
def found(processed_session: Path):
    return {(e.experiment, e.quantity.name): e for e in sensitivity(processed_session)}


def test_budgets_give_back_what_the_results_report(processed_session: Path, found) -> None:
    waves = verbs.result(processed_session, "nbr", "oscillations")
    work = found["nbr", f"work per cycle at {float(waves['frequency'][0]):.3g} Hz"]
    assert work.budget.value == pytest.approx(float(waves["work_per_cycle"][0]), rel=1e-3)
    assert work.budget.u == pytest.approx(float(waves["u_work_per_cycle"][0]), rel=0.15)
    repeats = verbs.result(processed_session, "drop", "repeats")
    bounce = found["drop", "restitution, impact 1"]
    assert bounce.budget.value == pytest.approx(float(repeats["restitution"][0]), rel=1e-6)
    assert bounce.budget.u == pytest.approx(float(repeats["u_restitution"][0]), rel=1e-3)


def test_lag_of_the_filter_limits_the_work_and_the_advice_says_so(found) -> None:
    work = next(e for (name, what), e in found.items() if name == "nbr" and "work" in what)
    assert work.advice.startswith("reduce the uncertainty of filter lag")
    assert work.indices["filter_lag"].total > 0.9
    table, below = answer([e for (name, _), e in found.items() if name == "nbr"])
    advice = {row[0]: row[-1] for row in table.rows}
    assert advice["storage stiffness"].startswith("reduce the uncertainty of filter lag")
    assert advice["work per cycle"].startswith("reduce the uncertainty of filter lag")
    assert "agree within" in below.text


def test_advice_is_true() -> None:
    def along(reading: float, inclination: float, noise: float) -> float:
        return reading / cos(inclination) + noise

    inputs = {"reading": Input(1.0, 1e-4), "inclination": Input(0.3, 2e-3), "noise": Input(0, 1e-4)}
    first = examined("a", Quantity("x", "m", along, inputs))
    assert first.advice == "reduce the uncertainty of inclination 2.2 times"
    better = inputs | {"inclination": Input(0.3, 2e-3 / 2.17)}
    second = examined("a", Quantity("x", "m", along, better))
    assert second.budget.u == pytest.approx(0.5 * first.budget.u, rel=0.01)


def test_command_writes_a_page_per_kind_though_another_recording_is_lost(
    session_copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (session_copy / "laser/drop_2.csv").unlink()
    code, out, _ = run(capsys, "sensitivity", str(session_copy), "harmonic", "--json")
    document = json.loads(out)
    assert code == 0
    assert [Path(p).name for p in document["pages"]] == ["sensitivity_harmonic.html"]
    page = (session_copy / "labpipe/sensitivity_harmonic.html").read_text(encoding="utf-8")
    assert "limiting inputs, mean share of the variance" in page
    assert "Monte Carlo" in page
    assert {row["experiment"] for row in document["quantities"]} == {"nbr"}

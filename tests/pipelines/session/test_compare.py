"""Measurement against model over a whole session: the rows and the page."""

import json
from pathlib import Path

import pytest

from pipelines.session import compare, open_session, result
from tests.pipelines.command import run


def test_every_experiment_gives_its_curves_and_events(processed_session: Path) -> None:
    found = compare(processed_session, jobs=0)
    assert not found.failed
    assert {row.experiment for row in found.rows} == set(open_session(processed_session).experiments)
    first = next(r for r in found.rows if r.quantity == "restitution, impact 1")
    made = result(processed_session, "drop", "comparison")
    assert first.difference == pytest.approx(first.measured - first.model)
    assert first.u_difference == float(made["u_restitution_difference"][0])
    assert first.deviation == pytest.approx(first.difference / first.u_difference)
    assert (first.n, first.material, first.condition) == (2, "acrylic", "1.5 mm")
    assert sum(row.quantity == "dissipated work per cycle" for row in found.rows) == 2
    assert all(row.nrmse < 0.03 for row in found.rows if row.is_curve)


def test_the_command_prints_one_document_and_writes_one_page(
    session_copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "compare", str(session_copy), "--jobs", "0", "--json")
    document = json.loads(out)
    assert code == 0
    assert {"experiment", "nrmse", "difference", "deviation", "n"} <= set(document["rows"][0])
    page = Path(document["page"]).read_text("utf-8")
    assert "Measurement against model" in page
    assert "synthetic" in page
    assert "SI unit" not in page
    verdicts = [found["model"] for found in document["experiments"]]
    assert f"The model agrees in {verdicts.count('agrees')} of {len(verdicts)} experiments" in page
    judged = [row for row in document["rows"] if row["deviation"] is not None]
    assert page.count('class="deviation-point ') == len(judged)
    inside = sum(abs(row["deviation"]) < 1.96 for row in judged)
    assert f"{inside} of {len(judged)}" in page
    curves = [row["nrmse"] for row in document["rows"] if row["nrmse"] is not None]
    assert f"{sum(error < 0.03 for error in curves)} of {len(curves)}" in page
    assert "with an nRMSE below 3 %" in page
    assert ">µJ<" in page
    _, text, _ = run(capsys, "compare", str(session_copy), "--jobs", "0")
    assert "nRMSE" in text
    assert "restitution, impact 1" in text

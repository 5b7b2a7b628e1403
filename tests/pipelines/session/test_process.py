"""A session from files to reports: results against truth, and what a second run does."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from labpipe.errors import InputError, UsageError
from labpipe.workflow.store import Store
from pipelines.commands import session as commands
from pipelines.session import catalogue, compare, export, plan, process, report, result, verdict
from tests.pipelines.sessions import page_of, replaced, truth


def test_every_experiment_has_a_report_and_every_result_can_be_opened(processed_session: Path) -> None:
    for name in ("drop", "nbr"):
        page = page_of(processed_session, name)
        assert "synthetic" in page
        assert len(page.encode()) <= 3_000_000
    assert result(processed_session, "drop", "repeats").sizes["repeat"] == 2
    assert Store(processed_session).check() == []


def test_first_contact_and_restitution_are_the_true_ones(processed_session: Path) -> None:
    for i in (1, 2):
        found = result(processed_session, "drop", "bounces", f"laser/drop_{i}.csv")
        known = truth(processed_session, f"drop_{i}")
        two_samples = 2 * 50e-6
        assert abs(float(found["first_contact_time"]) - known["first_contact_time"]) < two_samples
        count = min(found.sizes["impact"], len(known["restitution"]))
        assert count >= 3
        z = found["restitution"].values[:count] - np.array(known["restitution"][:count])
        assert np.all(np.abs(z) < 3.5 * found["u_restitution"].values[:count])


def test_the_model_made_with_the_right_material_agrees(processed_session: Path) -> None:
    assert float(result(processed_session, "drop", "comparison")["nrmse"]) < 0.03
    assert float(result(processed_session, "nbr", "comparison")["nrmse"].max()) < 0.03


def test_a_changed_setting_reruns_only_what_stands_behind_it(session_copy: Path) -> None:
    assert plan(session_copy).to_run == ()
    replaced(session_copy, 'radius = "9.525', 'radius = "9.526')
    to_run = {row.stage for row in plan(session_copy).to_run if row.experiment == "drop"}
    assert {"model", "comparison", "report"} <= to_run
    assert not {"readings", "displacement", "bounces", "velocity", "repeats"} & to_run
    outcome = process(session_copy, only=["drop"], jobs=0)
    done = {o.task.stage for o in outcome.outcomes if o.state == "done"}
    assert done == to_run  # the plan said so beforehand


def test_the_inclination_is_recovered_from_the_drop_height(session_copy: Path) -> None:
    path = session_copy / "session.toml"
    section = "\n[experiments.drop.analysis]\ninclination_from_height = true\n"
    path.write_text(path.read_text("utf-8") + section, "utf-8")
    process(session_copy, ["displacement"], ["drop"], jobs=0)
    for i in (1, 2):
        found = result(session_copy, "drop", "displacement", f"laser/drop_{i}.csv")
        known = truth(session_copy, f"drop_{i}")["inclination"]
        assert abs(float(found["inclination"]) - known) < 2.5 * float(found["u_inclination"])


@pytest.mark.slow
def test_two_workers_give_the_bytes_of_this_process(
    small_session: Path, pristine_session: Path, tmp_path: Path
) -> None:

    folder = tmp_path / "session"
    shutil.copytree(small_session, folder)
    assert process(folder, jobs=2).exit_code == 0
    here, by_two = (
        {p.name: p.read_bytes() for part in ("reports", "store") for p in files_in(root, part)}
        for root in (pristine_session, folder)
    )
    assert here == by_two
    assert any(name.endswith(".html") for name in by_two)


def files_in(session: Path, part: str) -> list[Path]:
    found = (session / "labpipe" / part).rglob("*")
    return [path for path in found if path.suffix in {".html", ".nc"}]


def test_raw_files_are_never_touched(small_session: Path, pristine_session: Path) -> None:
    for path in small_session.rglob("*"):
        if path.is_file():
            twin = pristine_session / path.relative_to(small_session)
            assert twin.read_bytes() == path.read_bytes()


def test_a_lost_recording_fails_its_experiment_alone(session_copy: Path) -> None:
    (session_copy / "laser/drop_2.csv").unlink()
    done = process(session_copy, jobs=0)
    assert done.exit_code == 1
    assert {o.experiment for o in done.failures} == {"drop"}
    assert re.fullmatch(r"missing: laser/drop_2.csv \(session.toml:\d+\)", done.failures[0].message)
    assert {v.experiment: v.believable for v in verdict(session_copy, jobs=0).experiments}["drop"] == "unknown"
    assert (session_copy / "labpipe/reports/nbr.html").is_file()
    rows = {row.experiment: row.state for row in plan(session_copy).rows}
    assert rows["nbr"] == "cached"
    assert "drop_2.csv" in compare(session_copy, jobs=0).failed["drop"]
    assert Store(session_copy).check() == []
    assert report(session_copy, "nbr").path.is_file()
    assert export(session_copy, only=["nbr"]).paths


@pytest.mark.parametrize(
    ("old", "unit", "filled", "place", "remedy"),
    [
        ("1.5 ± 0.005", "mm", "1.5", "session.toml", "fill in line"),
        ("12.00 ± 0.10", "deg", "12.0", "calibration/laser.toml", "of calibration/laser.toml"),
    ],
)
def test_what_waits_has_an_entry_of_its_own_in_every_outlet(
    session_copy: Path, old: str, unit: str, filled: str, place: str, remedy: str
) -> None:
    replaced(session_copy, f'"{old} {unit}"', f'"FILL {unit}"', place)
    planned = CliRunner().invoke(commands.plan, [str(session_copy)]).output
    assert "1 experiment waits" in planned.splitlines()[0]
    assert "waiting: drop\n" in planned
    others = CliRunner().invoke(commands.plan, [str(session_copy), "--only", "drop,nbr"]).output
    assert "\nnbr (harmonic)" in others
    with pytest.raises(InputError, match='"drop" waits for these lines'):
        plan(session_copy, only="drop")
    with pytest.raises(UsageError, match=r'no stage "nosuch"; there are .*, readings, '):
        plan(session_copy, "nosuch")
    done = CliRunner().invoke(commands.process, [str(session_copy), "-j", "0", "--json"])
    assert done.exit_code == 1
    found = json.loads(done.output)["experiments"]
    one = {entry["experiment"]: entry for entry in found}["drop"]
    assert (one["kind"], one["state"], one["believable"], one["model"]) == ("ball_drop", "waiting", "unknown", "none")
    assert len(found) == 2
    (finding,) = one["findings"]
    assert (finding["level"], finding["file"]) == ("note", place)
    assert "FILL" in (session_copy / place).read_text("utf-8").splitlines()[finding["line"] - 1]
    assert remedy in finding["cause"]
    assert verdict(session_copy, jobs=0)["experiments"] == found
    assert "waiting for settings: drop" in (session_copy / "labpipe/index.html").read_text("utf-8").lower()
    table = catalogue(session_copy).table.set_index("experiment")
    assert (table.loc["drop", "state"], table.loc["drop", "believable"]) == ("waiting", "unknown")
    assert f"{place}:{finding['line']}" in table.loc["drop", "findings"]
    replaced(session_copy, "FILL", filled, place)
    assert catalogue(session_copy).table.set_index("experiment").loc["drop", "state"] != "waiting"

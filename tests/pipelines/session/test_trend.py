"""Quantities over months: control charts, a sensor that drifts, groups, and the page."""

import json
import math
import shutil
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import labpipe as lp
from labpipe import files, materials
from labpipe.errors import InputError
from pipelines.commands.results import trend as command
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.samples import STATED_FLOOR
from pipelines.rig.session_text import drop_section, laser_record, session_head
from pipelines.session._trend import control_charts

MONTHS = 10


def made_up(owner: str, values: np.ndarray, *, operator: str = "A", specimen: str = "acrylic") -> pd.DataFrame:
    """One ratio of a sensor, a session a month."""
    days = [str(np.datetime64("2024-05-14") + 30 * month) for month in range(values.size)]
    given = {"owner": owner, "quantity": "free-fall acceleration", "chart": "", "unit": "1", "is_ratio": True}
    given |= {"operator": operator, "record": "laser-2024", "specimen": specimen, "u": 2.6e-3}
    return pd.DataFrame({"recorded": days, "session": days, "experiment": "drop", "value": values}).assign(**given)


def test_limits_follow_from_the_moving_range_and_the_stated_uncertainty() -> None:
    (chart,) = control_charts(made_up("laser", np.array([1.0, 1.002, 0.999, 1.001, 1.0])))
    assert chart.mean == pytest.approx(1.0004)
    assert chart.sigma == pytest.approx(np.mean([0.002, 0.003, 0.002, 0.001]) / 1.128, rel=1e-3)  # d2 of two
    assert chart.u == pytest.approx(2.6e-3)
    assert chart.state == "steady"


@pytest.mark.slow
def test_the_drifting_laser_of_two_is_found_and_no_chance() -> None:
    noise = np.random.default_rng(3).normal(0.0, 3e-4, (200, MONTHS))
    steady = [made_up(f"laser {i}", 1.0 + row) for i, row in enumerate(noise)]
    sagging = made_up("sagging laser", 1.0 - 1e-3 * np.arange(MONTHS) + noise[0])
    charts = control_charts(pd.concat([*steady, sagging], ignore_index=True))
    assert [chart.owner for chart in charts if chart.is_drifting] == ["sagging laser"]
    found = next(chart for chart in charts if chart.is_drifting)
    assert found.change == pytest.approx(-9e-3, abs=1e-3)
    by_chance = np.mean([chart.p < 0.05 for chart in charts if chart is not found])
    assert 0.02 < by_chance < 0.085  # binomial, 200 charts


def test_an_operator_who_reads_otherwise_is_named_by_the_comparison_of_groups() -> None:
    values = 1.0 + np.random.default_rng(1).normal(0.0, 3e-4, 12)
    points = made_up("laser", values)
    is_other = np.arange(12) % 3 == 0
    points.loc[is_other, "operator"] = "B"
    points.loc[is_other, "value"] += 2e-3
    (chart,) = control_charts(points)
    ((by, (p, means)),) = chart.groups.items()
    assert by == "operator"
    assert means["B"] - means["A"] == pytest.approx(2e-3, abs=4e-4)
    assert p < 1e-4


def test_the_command_writes_its_page_and_that_of_the_catalogue(pristine_session: Path, tmp_path: Path) -> None:
    for name in ("may", "june"):
        shutil.copytree(pristine_session, tmp_path / name)
    with pytest.raises(InputError, match="no quantity was measured on two days"):
        lp.trend(tmp_path)  # both copies are of one day
    kept = tmp_path / "june/labpipe/store/catalogue.json"
    rows = files.unseal(kept.read_bytes())
    for cells, _ in rows["experiments"]:
        cells["recorded"] = "2024-06-14"
    kept.write_bytes(files.seal(rows))
    ran = CliRunner().invoke(command, [str(tmp_path), "--json"])
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    charts = {(c["owner"], c["title"]): c for c in told["charts"]}
    g = charts["LK-G5001 laser", "free-fall acceleration"]
    assert [point["day"] for point in g["points"]] == ["2024-05-14", "2024-06-14"]
    assert g["mean"] == pytest.approx(1.0, abs=3.0 * g["u"])
    assert ("Ball drop", "first restitution, acrylic, 1.50 mm") in charts
    page = Path(told["page"]).read_text("utf-8")
    assert 'href="catalogue.html"' in page
    listed = (tmp_path / "catalogue.html").read_text("utf-8")
    assert 'href="june/labpipe/reports/drop.html"' in listed


@pytest.mark.slow
def test_a_laser_that_sags_in_its_mount_is_found_among_ten_sessions_of_the_rig(tmp_path: Path) -> None:
    """Both lasers keep their record; the line of sight of one turns by 0.35 degrees a month."""
    for month in range(MONTHS):
        day, folder = datetime(2024, 5, 14) + timedelta(days=30 * month), tmp_path / f"month {month}"
        text = session_head(f"Month {month} (synthetic)")
        for place, turned in (("left", 0.0), ("right", 0.35 * month)):
            rig = DropRig(duration=0.1)
            rig = replace(rig, sensor=replace(rig.sensor, inclination=math.radians(12.0 + turned)))
            of_place = 1000 * month + 100 * (place == "right")
            names = write_drops(folder, place, rig, materials.load("acrylic"), 1.5e-3, 1, of_place, day)
            record = f"calibration/laser_{place}.toml"
            files.write_text(folder / record, laser_record(place))
            section = drop_section(place, names, 1.5e-3, "acrylic", STATED_FLOOR)
            text += section.replace("calibration/laser.toml", record)
        files.write_text(folder / "session.toml", text)
        lp.process(folder, "judgement", jobs=0)
    assert set(lp.trend(tmp_path).drifts) == {"LK-G5001 laser_right"}

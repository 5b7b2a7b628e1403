"""Maps of the simulator: the points, the engines that compute them, and stops in between."""

import json
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from labpipe import contact, files, materials
from labpipe.errors import InputError, UsageError
from labpipe.workflow.engines import side_by_side
from pipelines.commands.simulate import sweep as command
from pipelines.sweeps import run as run_module, sweep
from pipelines.sweeps.run import Outcome, design
from pipelines.sweeps.simulators import SIMULATORS, Design, Parameter, Simulator, Value


def _toy(point: Mapping[str, Value]) -> dict[str, float]:
    x, y = float(point["x"] or 0.0), float(point["y"] or 0.0)
    if x < 0.0:
        raise InputError("x is negative")
    return {"sum": x + y, "product": x * y}


def _toys(points: Sequence[Mapping[str, Value]]) -> list[dict[str, float]]:
    return [_toy(point) for point in points]


TOY = Simulator(
    _toys,
    {
        "material": Parameter("", "acrylic"),
        "temperature": Parameter("degC"),
        "marker": Parameter("", ""),
        "x": Parameter("1", 1.0),
        "y": Parameter("1", 2.0),
    },
    {"sum": ("1", "Sum"), "product": ("1", "Product")},
)


def deadly(plan: Design, numbers: range) -> list[Outcome]:
    """Kill the worker: once at x = 7, always at x = 13."""
    for point in plan.points(numbers):
        marker = Path(str(point["marker"]))
        if point["x"] == 13.0 or (point["x"] == 7.0 and marker.exists()):
            marker.unlink(missing_ok=True)
            os.kill(os.getpid(), signal.SIGKILL)
    return [_toy(point) for point in plan.points(numbers)]


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SIMULATORS, "toy", TOY)


class Counting:
    """Stands in for ``side_by_side``, counts its points, and may stop."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, stop_after: int | None = None) -> None:
        self.points, self.stop_after = 0, stop_after
        monkeypatch.setattr(run_module, "side_by_side", self)

    def __call__(self, *arguments: Any, **options: Any) -> Iterator[tuple[str, list[Outcome]]]:
        for number, (key, outcome) in enumerate(side_by_side(*arguments, **options)):
            if number == self.stop_after:
                raise KeyboardInterrupt
            self.points += len(outcome)
            yield key, outcome


@pytest.mark.parametrize(
    ("name", "text", "values"),
    [
        ("height", "1 mm, 5 mm", (0.001, 0.005)),
        ("height", "1 mm : 10 mm : 4", (0.001, 0.004, 0.007, 0.01)),
        ("height", "1 mm : 4 mm : 3 : log", (0.001, 0.002, 0.004)),
        ("temperature", "20 degC : 40 degC : 3", (20.0, 30.0, 40.0)),
    ],
)
def test_values_of_an_axis_are_read(name: str, text: str, values: tuple[Value, ...]) -> None:
    assert design("drop", {name: text}).axes[name] == pytest.approx(values)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("heigth", "1 mm", 'did you mean "height"'),
        ("height", "1 kg", "is in kg; expected m"),
        ("height", "1 mm : 2 mm", "first : last : number"),
        ("height", "0 mm : 2 mm : 3 : log", "positive ends"),
        ("height", "1 ± 0.1 mm", "no uncertainty"),
        ("height", "1 mm, 2 mm, 1 mm", "a value is given twice"),
    ],
)
def test_a_wrong_axis_is_refused(name: str, text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        design("drop", {name: text})


def test_every_point_of_a_map_is_what_the_simulator_says(tmp_path: Path) -> None:
    vary = {"material": "acrylic, ptfe", "height": "1.5 mm, 5 mm"}
    swept = sweep("drop", tmp_path / "map.nc", vary=vary, fixed={"mass": "28.2 g"})
    assert swept.dataset.restitution.dims == ("material", "height")
    point = swept.dataset.sel(material="ptfe", height=5e-3)
    alone = contact.drop(materials.load("ptfe"), 9.525e-3, 28.2e-3, 5e-3, 0.052)
    assert float(point.restitution) == pytest.approx(float(alone.restitution[0]), abs=2e-5)
    assert float(point.peak_force) == pytest.approx(float(alone.peak_force[0]), rel=2e-5)
    assert swept.dataset.restitution.attrs["units"] == "1"
    assert (swept.computed, swept.reused, swept.failed) == (4, 0, 0)
    assert not (tmp_path / "map.parts").exists()
    worked = sweep("indent", tmp_path / "work.nc", vary={"amplitude": "2 um, 4 um"}, fixed={"hold": "10 s"}).dataset
    # quadratic while contact holds
    assert worked.dissipated_work.values[1] / worked.dissipated_work.values[0] == pytest.approx(4.0, rel=0.05)
    warm = sweep("drop", tmp_path / "warm.nc", vary={"temperature": "20 degC, 60 degC"}, fixed={"rtol": "1e-3"}).dataset
    assert np.diff(warm["peak_force"].values) < 0.0


def test_a_stopped_sweep_goes_on_and_gives_the_same_bytes(
    toy: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    vary = {"x": "1:40:40", "y": "1:3:3"}
    whole = sweep("toy", tmp_path / "whole.nc", vary=vary)
    Counting(monkeypatch, stop_after=2)
    with pytest.raises(KeyboardInterrupt):
        sweep("toy", tmp_path / "part.nc", vary=vary)
    assert not (tmp_path / "part.nc").exists()
    damaged = sorted((tmp_path / "part.parts").iterdir())[0]
    damaged.write_bytes(damaged.read_bytes()[:-9])
    counting = Counting(monkeypatch)
    rest = sweep("toy", tmp_path / "part.nc", vary=vary)
    assert (rest.reused, rest.computed, counting.points) == (25, 95, 95)
    assert (tmp_path / "part.nc").read_bytes() == (tmp_path / "whole.nc").read_bytes()
    np.testing.assert_array_equal(whole.dataset["product"].values, np.outer(np.arange(1, 41), [1.0, 2.0, 3.0]))


def test_failed_points_are_told_kept_apart_and_tried_again(
    toy: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "BLOCK", 2)
    swept = sweep("toy", tmp_path / "map.nc", vary={"x": "-1, 1, 2, 3"})
    assert swept.failed == 1
    assert np.isnan(swept.dataset["sum"].values[0])
    assert "x is negative" in str(swept.dataset["problem"].values[0])
    page = swept.page.read_text("utf-8")
    assert "1 points have no result" in page
    assert "x is negative" in page
    again = sweep("toy", tmp_path / "map.nc", vary={"x": "-1, 1, 2, 3"})
    assert (again.computed, again.reused) == (2, 2)  # the block of the failed point


def test_draws_are_the_same_at_every_point_of_the_grid(toy: None, tmp_path: Path) -> None:
    given: Any = {"vary": {"x": "1, 2"}, "fixed": {"y": "5 ± 0.5"}, "draws": 400, "seed": 3}
    found = sweep("toy", tmp_path / "map.nc", **given).dataset
    assert found["sum"].dims == ("x", "draw")
    np.testing.assert_allclose(found["sum"][1] - found["sum"][0], 1.0)
    assert float(found.y.mean()) == pytest.approx(5.0, abs=0.1)
    assert float(found.y.std()) == pytest.approx(0.5, rel=0.15)


def test_a_killed_worker_costs_nothing_and_a_deadly_block_only_itself(
    toy: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    marker = tmp_path / "alive"
    marker.touch()
    monkeypatch.setattr(run_module, "compute", deadly)
    monkeypatch.setattr(run_module, "BLOCK", 2)
    fixed = {"marker": str(marker)}
    found = sweep("toy", tmp_path / "map.nc", vary={"x": "1:20:20"}, fixed=fixed, jobs=2).dataset
    assert not marker.exists()
    lost = [number for number, text in enumerate(found["problem"].values) if "was the memory full" in str(text)]
    assert list(found["x"].values[lost]) == [13.0, 14.0]
    kept = np.delete(np.arange(20), lost)
    np.testing.assert_array_equal(found["sum"].values[kept], kept + 3.0)


@pytest.mark.slow
def test_a_cluster_gives_the_same_bytes_though_a_worker_is_killed(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    given: Any = {"vary": {"height": "1 mm : 3 mm : 200"}, "fixed": {"rtol": "0.001"}}
    sweep("drop", tmp_path / "one.nc", **given)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0"
    ) as cluster:

        def kill_one(done: float) -> None:
            if 0.1 < done < 0.3:
                worker = next(iter(cluster.workers.values()))
                os.kill(worker.pid, signal.SIGKILL)

        address = cluster.scheduler_address
        swept = sweep("drop", tmp_path / "many.nc", jobs=1, cluster=address, progress=kill_one, **given)
    assert swept.failed == 0
    assert (tmp_path / "one.nc").read_bytes() == (tmp_path / "many.nc").read_bytes()


def test_the_command_writes_a_page_and_goes_on_from_what_is_there(tmp_path: Path) -> None:
    out = tmp_path / "map.nc"
    swept = ("material=acrylic,ptfe", "height=1 mm:2 mm:3:log", "mass=100 g, 200 g")
    varied = [part for text in swept for part in ("--vary", text)]
    arguments = ["drop", *varied, "--set", "rtol=0.001", "--out", str(out), "--json"]
    run = CliRunner().invoke(command, arguments)
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    assert document["computed"] == 12
    page = Path(document["page"]).read_text("utf-8")
    assert "<h3>Restitution of the first impact</h3>" in page
    assert "curves: material, mass" in page
    assert "ptfe, 200 g" in page
    assert files.read_dataset(out).sizes == {"material": 2, "height": 3, "mass": 2}

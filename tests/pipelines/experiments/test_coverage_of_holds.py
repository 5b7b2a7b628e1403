"""Stated 95 % intervals of slow experiments against the truth, over seeds of the rig.

Everything that session.toml and the records state with an uncertainty is wrong by as much.
"""

import json
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labpipe import files, materials
from pipelines.process import process, result
from pipelines.rig.indentation_session import cell_record, oscillation_section, relaxation_section
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.laser_sensor import LaserSensor
from pipelines.rig.relaxations import TESTER, Relaxation, write_relaxation
from pipelines.rig.session_text import NOTE, laser_record, session_head
from pipelines.rig.static_loading import StaticRig, static_section, write_static
from tests.pipelines.small import START

SEEDS = 30
Hits = dict[str, list[bool]]


def note(hits: Hits, name: str, error: object, u: object) -> None:
    inside = np.abs(np.atleast_1d(np.asarray(error, float))) <= 1.96 * np.asarray(u, float)
    hits[name] += inside.tolist()


def processed(folder: Path, sections: str, targets: list[str]) -> None:
    files.write_text(folder / "session.toml", session_head("Coverage (synthetic)") + sections)
    outcome = process(folder, targets, jobs=0)
    assert outcome.exit_code == 0, [o.message for o in outcome.failures]


def truth(folder: Path, name: str) -> dict:
    return json.loads((folder / f"truth/{name}.json").read_text("utf-8"))


def load_once(folder: Path, seed: int, hits: Hits) -> None:
    """A static loading whose sensor and sphere differ from what is stated."""
    random, stated = np.random.default_rng(seed), StaticRig()
    angle = np.deg2rad(12 + random.normal(0.0, 0.1))
    sensor = LaserSensor(inclination=float(angle), noise=stated.sensor.noise)
    rig = replace(stated, radius=stated.radius + random.normal(0.0, 5e-6), sensor=sensor)
    file = write_static(folder, "s", rig, materials.load("ptfe"), seed, START)
    files.write_text(folder / "calibration/laser.toml", laser_record())
    processed(folder, static_section("s", file, stated, "ptfe"), ["approach"])
    found, steps, known = (
        result(folder, "s", "approach"),
        result(folder, "s", "steps"),
        truth(folder, "s"),
    )
    time, approach = np.array(known["time"]), np.array(known["approach"])
    radius = np.sqrt(stated.radius * approach)
    some = np.flatnonzero(np.isfinite(found["contact_radius"].values) & (time > 10.0))[::37]
    note(hits, "contact radius", (found["contact_radius"].values - radius)[some],
         found["u_contact_radius"].values[some])  # fmt: skip
    for load, end in enumerate(steps["end"].values):
        last = (time < end - rig.cycle) & (time >= end - rig.cycle - 60.0)
        note(hits, "approach at a load's end",
             found["level_approach"].values[load] - approach[last].mean(),
             found["u_level_approach"].values[load])  # fmt: skip


def press_once(folder: Path, seed: int, hits: Hits) -> None:
    """A relaxation and an oscillation with a punch, a cell and a surface not quite as stated."""
    random, stated = np.random.default_rng(seed), Specimen(materials.load("nbr"))
    specimen = replace(
        stated,
        tip_radius=stated.tip_radius + random.normal(0.0, 2e-6),
        depth=stated.depth + random.normal(0.0, 6e-6),
        surface=stated.surface + random.normal(0.0, 1e-5),
    )
    gain, offset = 1 / (1 + random.normal(0.0, 1e-3)), random.normal(0.0, 0.3)
    tester = replace(TESTER, force_gain=gain, force_offset=offset)
    held = Relaxation(depths=(0.1e-3,), hold=12.0)
    names = write_relaxation(folder, "r", specimen, held, tester, seed, START)
    wave = Harmonic(hold=5.0, frequencies=(1.0, 2.0), cycles=7)
    write_harmonic(folder, "h", specimen, wave, tester, seed + 1, START)
    files.write_text(folder / "calibration/load_cell.toml", cell_record(NOTE))
    sections = relaxation_section("r", names, stated) + oscillation_section("h", stated)
    processed(folder, sections, ["r/ramps", "h/oscillations"])
    compare_ramp(result(folder, "r", "ramps", names[0]), truth(folder, Path(names[0]).stem), hits)
    found = result(folder, "h", "oscillations")
    for i, known in enumerate(truth(folder, "h")["oscillations"]):
        for name in ("force_amplitude", "storage_stiffness", "loss_stiffness", "work_per_cycle"):
            note(hits, name, float(found[name][i]) - known[name], found[f"u_{name}"].values[i])


def compare_ramp(ramps: xr.Dataset, known: dict, hits: Hits) -> None:
    for name, true in (("plateau_force", known["plateau_force"]), ("depth", known["depth"])):
        note(hits, name, float(ramps[name][0]) - true, ramps[f"u_{name}"].values[0])
    note(hits, "first touch", float(ramps["contact_position"]) - known["surface"],
         ramps["u_contact_position"].values)  # fmt: skip


@pytest.mark.nightly
@pytest.mark.parametrize("once", [load_once, press_once])
def test_intervals_hold_the_truth_as_often_as_they_say(tmp_path: Path, once: object) -> None:
    hits: Hits = defaultdict(list)
    for seed in range(SEEDS):
        once(tmp_path / str(seed), 1000 + seed, hits)  # type: ignore[operator]
    share = {name: float(np.mean(inside)) for name, inside in hits.items()}
    assert min(share.values()) >= 0.90, share

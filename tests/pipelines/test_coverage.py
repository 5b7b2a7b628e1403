"""Stated uncertainties against the truth of many virtual drops, and runs that are killed."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labpipe import materials, signals
from pipelines.rig.drops import drop_once
from pipelines.rig.fall import DropRig

SEEDS = 200


@pytest.mark.slow
def test_intervals_of_restitution_and_contact_cover_the_truth_in_200_drops() -> None:
    """95 % intervals of restitution and touch time hold the truth in 90 to 99 % of the cases."""
    rig = DropRig(duration=0.12)
    acrylic = materials.load("acrylic")
    heights = (1.5e-3, 5e-3, 7e-3, 10e-3)
    covered: dict[str, list[bool]] = {"restitution": [], "touch_time": [], "first_contact": []}
    for seed in range(SEEDS):
        drop = drop_once(rig, acrylic, heights[seed % 4], 50_000 + seed)
        time_axis = np.arange(drop.readings.size) * rig.sensor.cycle
        record = xr.DataArray(
            drop.readings / np.cos(rig.sensor.inclination), dims="time",
            coords={"time": time_axis}, attrs={"units": "m", "long_name": "height"},
            name="displacement",
        )  # fmt: skip
        with pytest.warns(UserWarning, match="before the body is at rest"):
            found = signals.bounces(record, contact="polymer")
        motion = drop.trajectory
        count = min(found.sizes["impact"], motion.liftoff.size, 3)
        true_e = motion.outgoing_speed[:count] / motion.incoming_speed[:count]
        e, u = found["restitution"].values[:count], found["u_restitution"].values[:count]
        covered["restitution"] += list(np.abs(e - true_e) <= 1.96 * u)
        touch, u = found["touch_time"].values[:count], found["u_touch_time"].values[:count]
        gap = touch - drop.release - motion.touch[:count]
        covered["touch_time"] += list(np.abs(gap) <= 1.96 * u)
        first = float(found["first_contact_time"]) - drop.release - motion.touch[0]
        covered["first_contact"].append(abs(first) <= 2 * rig.sensor.cycle)
    assert 0.90 <= np.mean(covered["restitution"]) <= 0.99
    assert 0.90 <= np.mean(covered["touch_time"]) <= 0.99
    assert all(covered["first_contact"])


def stored(folder: Path) -> dict[str, bytes]:
    kept = [p for p in (folder / "labpipe").rglob("*") if p.suffix in {".nc", ".html"}]
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in kept}


@pytest.mark.slow
def test_a_run_killed_again_and_again_ends_as_an_undisturbed_one(
    small_session: Path,
    processed_session: Path,
    tmp_path: Path,
    amount: Callable[[int, int], int],
) -> None:
    folder = tmp_path / "session"
    shutil.copytree(small_session, folder)
    command = [sys.executable, "-m", "labpipe", "process", str(folder), "--jobs", "2"]
    generator = np.random.default_rng(4)
    for _ in range(amount(8, 40)):
        running = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        time.sleep(float(generator.uniform(0.3, 3.0)))
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert stored(folder) == stored(processed_session)
    assert not list(folder.rglob("*.part"))

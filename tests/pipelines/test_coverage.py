"""Stated uncertainties against the truth of every kind, and runs that are killed."""

import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.pipelines.coverage import KINDS, share, swept

FEW = {
    "ball_drop": 6,
    "plate_vibration": 8,
    "static_loading": 6,
    "relaxation": 5,
    "harmonic": 6,
    "dma": 8,
    "contact_area": 2,
    "dic_validation": 3,
}
"""Experiments of each kind in every run; those of the nightly run stand in ``KINDS``."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_stated_intervals_hold_the_truth_of_the_rig(kind: str, tmp_path: Path) -> None:
    """With few experiments errors of twice their uncertainty are no rule; with many, 5 %."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        scores = swept(kind, FEW[kind], tmp_path)
    everything = [z for part in scores.values() for z in part]
    assert share(everything) >= 0.88, kind
    for name, z in scores.items():
        assert np.sqrt(np.mean(np.square(z))) < 1.7, name
        assert abs(np.median(z)) < 1.6, name


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_coverage_of_whole_sweeps(kind: str, tmp_path: Path) -> None:
    """Nine in ten at least: three standard deviations of the count are left for chance."""
    seeds = KINDS[kind][1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        scores = swept(kind, seeds, tmp_path)
    for name, z in scores.items():
        # What one recording tells many times over counts as one.
        chance = 3 * np.sqrt(0.05 * 0.95 / min(len(z), 2 * seeds))
        assert share(z) >= 0.95 - max(chance, 0.05), name


def stored(folder: Path) -> dict[str, bytes]:
    kept = [p for p in (folder / "labpipe").rglob("*") if p.suffix in {".nc", ".html"}]
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in kept}


@pytest.mark.slow
def test_a_run_killed_again_and_again_ends_as_an_undisturbed_one(
    small_session: Path, pristine_session: Path, tmp_path: Path, amount: Callable[[int, int], int]
) -> None:
    folder = tmp_path / "session"
    shutil.copytree(small_session, folder)
    command = [sys.executable, "-m", "labpipe", "process", str(folder), "--jobs", "2"]
    generator = np.random.default_rng(4)
    for _ in range(amount(2, 40)):
        running = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        time.sleep(float(generator.uniform(0.3, 3.0)))
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert stored(folder) == stored(pristine_session)
    assert not list(folder.rglob("*.part"))

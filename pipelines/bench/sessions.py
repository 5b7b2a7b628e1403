"""Whole sessions: cold, side by side, and with nothing changed; the error is of restitution, in units of u."""

import json
import shutil
import tempfile
import time
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from labpipe import files, materials
from labpipe.workflow.engines import processors
from pipelines import process as verbs
from pipelines.bench.measure import Point, Suite, paired
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.rig.drops import write_drops
from pipelines.rig.fall import DropRig
from pipelines.rig.samples import write_sample
from pipelines.rig.session_text import drop_section, laser_record, session_head

_PROCESSOR = "processor time of the steps (s)"
_START = datetime(2024, 5, 14, 9, 30)
_IMPACTS = 5  # of every drop that are compared with the truth
_QUICK_MATERIALS = ("acrylic", "ptfe")
_QUICK_HEIGHT, _QUICK_DURATION, _QUICK_REPEATS = 1.5e-3, 0.1, 1


def run(quick: bool) -> Suite:
    """Process a session in every way; in full the whole campaign of the thesis."""
    with tempfile.TemporaryDirectory() as folder:
        original = Path(folder) / "original"
        if quick:
            write_quick(original)
        else:
            write_sample("thesis", original)
        ways: dict[str, dict[str, Any]] = {
            "one by one (--jobs 1)": {"jobs": 1},
            "two side by side (--jobs 2)": {"jobs": 2},
        }
        done = {name: _cold(original, Path(folder) / name, how) for name, how in ways.items()}
        settled = Path(folder) / next(iter(ways))
        again = paired({"again": lambda: _process(settled, jobs=1)}, 2 if quick else 5, clock=time.perf_counter)[
            "again"
        ]
        experiments = len(verbs.open_session(original).experiments)
        error = restitution_error(settled)
    one, two = done.values()
    points = [replace(point, extra={"speed-up": one.seconds / point.seconds, **point.extra}) for point in (one, two)]
    speed_up = one.seconds / again.seconds
    points.append(Point("nothing changed", error, again.seconds, extra={"speed-up": speed_up}))
    return Suite(
        "sessions",
        f"A session of {experiments} experiments with reports, every run in fresh processes",
        "RMS error of restitution over its uncertainty (1)",
        points,
        notes=[
            f"Two experiments side by side took {two.seconds:.0f} s, one after the other {one.seconds:.0f} s: "
            f"{one.seconds / two.seconds:.2f} times faster, on {processors()} processors. The steps themselves took "
            f"{two.extra[_PROCESSOR]:.0f} s and {one.extra[_PROCESSOR]:.0f} s of processor time.",
            "Each way of computing a whole session ran once, so a busy machine affects it. The "
            "part skipping measures each shortcut that --full switches off.",
        ],
    )


def _cold(original: Path, folder: Path, how: dict[str, Any]) -> Point:
    """Process a fresh copy."""
    shutil.copytree(original, folder)
    start = time.perf_counter()
    processor = _process(folder, **how)
    seconds = time.perf_counter() - start
    return Point(
        folder.name, restitution_error(folder), seconds, is_default=how == {"jobs": 1}, extra={_PROCESSOR: processor}
    )


def _process(folder: Path, *, jobs: int) -> float:
    """Process, and return the processor time of all steps; a failure is one of the benchmark."""
    outcome = verbs.process(folder, jobs=jobs)
    if outcome.exit_code:
        failed = outcome.failures[0]
        raise RuntimeError(f"{failed.experiment}: {failed.stage}: {failed.message}")
    return sum(step.processor_seconds for step in outcome.outcomes)


def write_quick(folder: Path) -> None:
    """Write two short experiments of two drops each."""
    rig = DropRig(duration=_QUICK_DURATION)
    text = session_head("Quick (synthetic)")
    for seed, name in enumerate(_QUICK_MATERIALS):
        names = write_drops(folder, name, rig, materials.load(name), _QUICK_HEIGHT, _QUICK_REPEATS, 10 * seed, _START)
        text += drop_section(name, names, _QUICK_HEIGHT, name)
    files.write_text(folder / "calibration/laser.toml", laser_record())
    files.write_text(folder / "session.toml", text)


def restitution_error(folder: Path) -> float:
    """Return the RMS error over uncertainty of the first restitutions of all drops."""
    wrong: list[float] = []
    for name, experiment in verbs.open_session(folder).experiments.items():
        settings = experiment.settings
        if not isinstance(settings, BallDrop):
            continue
        for recording in settings.laser:
            truth = json.loads((folder / f"truth/{Path(recording).stem}.json").read_text())
            found = verbs.result(folder, name, "bounces", recording)
            ours = found["restitution"].values[:_IMPACTS]
            true = np.array(truth["restitution"][: len(ours)])
            u = found["u_restitution"].values[: len(true)]
            wrong.extend((ours[: len(true)] - true) / u)
    return float(np.sqrt(np.nanmean(np.square(wrong))))

"""Clean sessions of the tester and the rheometer are believed: no check cries at chance.

What a session states lies off the truth by its stated uncertainty; noise, speeds, depths, materials
and temperatures differ from session to session. At most 2 % may be doubtful, none impossible.
"""

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from labpipe import files, materials
from pipelines.rig import mach1_tester
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.indentation_session import cell_record, oscillation_section, relaxation_section
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.relaxations import TESTER, Relaxation, write_relaxation
from pipelines.rig.samples import dma_section, session_head
from pipelines.rig.session_text import NOTE
from pipelines.rig.solids import SOLIDS
from tests.mistakes.rows import judged

START = datetime(2024, 5, 14, 9, 30)


def _session(folder: Path, section: str) -> None:
    files.write_text(folder / "calibration/load_cell.toml", cell_record(NOTE))
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + section)


def _drawn(dice: np.random.Generator) -> tuple[Specimen, Specimen, mach1_tester.Tester]:
    """Return what is stated of a punch, what it is, and a tester."""
    stated = Specimen(materials.load("nbr"), tips=int(dice.integers(1, 6)))
    size = {"tip_radius": 2e-6, "period": 2e-6, "depth": 6e-6}
    true = replace(stated, **{n: getattr(stated, n) + dice.normal(0.0, u) for n, u in size.items()})
    tester = replace(
        TESTER,
        force_gain=float(dice.normal(1.0, 1e-3)),
        force_noise=float(dice.uniform(0.003, 0.015)),
        force_offset=float(dice.uniform(-0.5, 0.5)),
        filter_cutoff=20.0 * (1 + float(dice.normal(0.0, 0.2 / 15.9))),
        frequency_error=float(dice.uniform(-0.006, 0.0)),
        amplitude_error=float(dice.uniform(0.0, 0.03)),
        second_harmonic=float(dice.uniform(0.0, 0.006)),
    )
    return stated, true, tester


def _oscillation(folder: Path, number: int) -> tuple[str, ...]:
    dice = np.random.default_rng(number)
    stated, true, tester = _drawn(dice)
    slow, fast = sorted(float(f) for f in dice.choice([0.5, 1.0, 2.0, 5.0], 2, replace=False))
    protocol = Harmonic(
        mean=float(dice.uniform(0.05e-3, 0.2e-3)), amplitude=float(dice.uniform(8e-6, 20e-6)), hold=5.0,
        frequencies=(slow, fast), cycles=7,
    )  # fmt: skip
    write_harmonic(folder, "nbr", true, protocol, tester, 900 + number, START)
    _session(folder, oscillation_section("nbr", stated))
    return ("hold", "oscillations")


def _holds(folder: Path, number: int) -> tuple[str, ...]:
    dice = np.random.default_rng(5000 + number)
    stated, true, tester = _drawn(dice)
    depths = tuple(sorted(float(d) for d in dice.choice([0.5e-4, 1e-4, 1.5e-4, 2e-4, 3e-4], 2, replace=False)))
    names = write_relaxation(folder, "nbr", true, Relaxation(depths=depths, hold=12.0), tester, 900 + number, START)
    _session(folder, relaxation_section("nbr", names, stated))
    return ("ramps",)


def _sweeps(folder: Path, number: int) -> tuple[str, ...]:
    dice = np.random.default_rng(9000 + number)
    name = str(dice.choice(sorted(SOLIDS)))
    cold = float(dice.choice([-60.0, -40.0, -20.0]))
    protocol = Protocol(
        temperatures=tuple(cold + float(dice.choice([10.0, 15.0, 20.0])) * np.arange(5)),
        frequencies=tuple(np.geomspace(10.0, 0.1, int(dice.integers(5, 12))).tolist()),
        ramp=(0.0, 5.0),
    )
    folder.mkdir(parents=True, exist_ok=True)
    export = write_dma(folder, name, SOLIDS[name], protocol, 900 + number)
    section = dma_section(name, export, SOLIDS[name]).replace("T_ref", "# T_ref")
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + section)
    return ("readings",)


@pytest.mark.parametrize("write", [_oscillation, _holds, _sweeps])
@pytest.mark.parametrize("sessions", [2, pytest.param(200, marks=pytest.mark.nightly)])
def test_clean_sessions_are_believed(
    write: Callable[[Path, int], tuple[str, ...]], sessions: int, tmp_path: Path
) -> None:
    found = {}
    for number in range(sessions):
        folder = tmp_path / str(number)
        found[number] = judged(folder, *write(folder, number))
    off = {n: [f.message for f in v.findings if f.level != "note"] for n, v in found.items() if v.believable != "yes"}
    assert [n for n in off if found[n].believable != "doubtful"] == [], off
    assert len(off) <= 0.02 * sessions, off

"""Mistakes of a laboratory with a ball drop are noticed and named; clean sessions are believed."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labpipe import files, materials
from pipelines.rig.drops import write_drops
from pipelines.rig.fall import DropRig
from pipelines.rig.plate import PLATE
from pipelines.rig.samples import drop_section, laser_record, session_head
from pipelines.session import Verdict
from tests.mistakes.drop_rows import RECORD, ROWS, START, write
from tests.mistakes.recordings import values
from tests.mistakes.rows import Mistake, by_day, hold, judged


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean session, processed."""
    folder = write(tmp_path_factory.mktemp("clean"))
    _judged(folder)
    return folder


def _judged(folder: Path) -> Verdict:
    return judged(folder, "bounces")


def test_clean_session_is_believed(clean: Path) -> None:
    found = _judged(clean)
    assert (found.believable, found.findings) == ("yes", ())
    assert 8 < found.checks <= 12


@pytest.mark.slow
def test_a_clean_session_agrees_with_its_model(clean: Path) -> None:
    assert judged(clean, "judgement").model == "agrees"


@pytest.mark.parametrize("mistake", by_day(ROWS, 6))
def test_mistake_is_noticed_and_named(clean: Path, tmp_path: Path, mistake: Mistake) -> None:
    hold(clean, tmp_path / "session", mistake, "bounces")


@pytest.mark.slow
@pytest.mark.parametrize(("material", "height", "mass"), [("ptfe", 3e-3, 30.0), ("acrylic", 5e-3, 100.0)])
def test_a_plate_that_nobody_stated_is_the_first_suspect(
    tmp_path: Path, material: str, height: float, mass: float
) -> None:
    """Its mass by momentum, to a tenth: it moves a little while it is struck."""
    rig = replace(DropRig(duration=0.12), floor=replace(PLATE, mass=mass))
    names = write_drops(tmp_path, "drop", rig, materials.load(material), height, 3, 300, START)
    files.write_text(tmp_path / RECORD, laser_record())
    section = drop_section("drop", names, height, material)
    files.write_text(tmp_path / "session.toml", session_head("Plate (synthetic)") + section)
    found = judged(tmp_path, "judgement")
    assert (found.believable, found.model) == ("yes", "differs")
    told = re.search(r"states no plate .* with about (\d+) kg", found.suspects[0])
    assert told is not None, found.suspects
    assert float(told[1]) == pytest.approx(mass, rel=0.1)


@pytest.mark.parametrize(
    "sessions", [pytest.param(8, marks=pytest.mark.slow), pytest.param(200, marks=pytest.mark.nightly)]
)
def test_clean_sessions_are_believed(tmp_path: Path, sessions: int) -> None:
    """What is stated is drawn from its uncertainty; at most 2 % of sessions may be doubtful."""
    said = {number: _judged(_drawn(tmp_path / str(number), number)) for number in range(sessions)}
    off = {n: [f.message for f in v.findings if f.level != "note"] for n, v in said.items() if v.believable != "yes"}
    assert [n for n in off if said[n].believable != "doubtful"] == [], off
    assert len(off) <= 0.02 * sessions, off


def _drawn(folder: Path, number: int) -> Path:
    """Write a session whose truth lies off what it states by the stated uncertainties."""
    dice = np.random.default_rng(number)
    angle = float(dice.uniform(8.0, 25.0))
    material = str(dice.choice(["acrylic", "peek", "nylon", "ptfe"]))
    height = float(dice.choice([1.5e-3, 3e-3, 5e-3, 10e-3]))
    stated_height = round((height + dice.normal(0.0, 5e-6)) * 1e3, 4)
    rig = DropRig(duration=0.2)
    sensor = replace(rig.sensor, inclination=float(np.deg2rad(angle)), noise=float(dice.uniform(0.3e-6, 2e-6)))
    rig = replace(rig, sensor=sensor, mass=0.505 + float(dice.normal(0.0, 5e-4)))
    names = write_drops(folder, "drop", rig, materials.load(material), height, 3, 7000 + 10 * number, START)
    hum, drift, phase = float(dice.uniform(0.0, 1e-3)), float(dice.normal(0.0, 1e-3)), float(dice.uniform(0.0, 6.0))
    gain = float(dice.normal(1.0, 5e-4))

    def disturbed(x: np.ndarray) -> np.ndarray:
        t = np.arange(x.size) * sensor.cycle
        return x * gain + hum * np.sin(2 * np.pi * 50 * t + phase) + drift * t

    values(disturbed, tuple(names))(folder)
    record = laser_record().replace('"12.00 ±', f'"{angle + dice.normal(0.0, 0.1):.2f} ±')
    files.write_text(folder / RECORD, record)
    section = drop_section("drop", names, height, material)
    section = section.replace(f'"{height * 1e3:g} ±', f'"{stated_height:g} ±')
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + section)
    return folder

"""A small synthetic session, written once and copied for every test that changes it."""

import shutil
from datetime import datetime
from pathlib import Path

import pytest

from labpipe import files, materials
from pipelines.rig.drops import write_drops
from pipelines.rig.fall import DropRig
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.mach1_tester import Tester
from pipelines.rig.samples import drop_section, harmonic_section, laser_record, session_head

START = datetime(2024, 5, 14, 9, 30)


@pytest.fixture(scope="session")
def small_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two drops of acrylic over 0.15 s and a short indentation of NBR; not processed."""
    folder = tmp_path_factory.mktemp("small")
    rig = DropRig(duration=0.15)
    names = write_drops(folder, "drop", rig, materials.load("acrylic"), 1.5e-3, 2, 11, START)
    specimen = Specimen(materials.load("nbr"))
    protocol = Harmonic(hold=5.0, frequencies=(1.0, 2.0), cycles=7)
    write_harmonic(folder, "nbr", specimen, protocol, Tester(), 5, START)
    files.write_text(folder / "calibration/laser.toml", laser_record())
    text = session_head("Small (synthetic)") + drop_section("drop", names, 1.5e-3, "acrylic")
    files.write_text(folder / "session.toml", text + harmonic_section("nbr", specimen, "nbr"))
    return folder


@pytest.fixture(scope="session")
def processed_session(small_session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small session, processed; tests must not change it."""
    from pipelines.process import process

    folder = tmp_path_factory.mktemp("processed") / "session"
    shutil.copytree(small_session, folder)
    outcome = process(folder, jobs=1)
    assert outcome.exit_code == 0, [o.message for o in outcome.failures]
    return folder


@pytest.fixture
def session_copy(processed_session: Path, tmp_path: Path) -> Path:
    """A processed session that a test may change."""
    folder = tmp_path / "session"
    shutil.copytree(processed_session, folder)
    return folder

"""The laboratory's file: spheres by name, records, patterns of file names and defaults, which a session may change."""

import shutil
from pathlib import Path

import pytest

import labpipe as lp
from labpipe.errors import ConfigError
from pipelines.session import open_session
from tests.pipelines.command import run

LABORATORY = """labpipe = 1

[sphere.A3]
radius = "9.525 ± 0.005 mm"
mass = "505 ± 0.5 g"
material = "acrylic"

[defaults.ball_drop]
calibration = "records/laser.toml"
laser = "laser/{name}_?.csv"
"""
SESSION = """labpipe = 1
laboratory = "../../laboratory.toml"

[experiments.drop]
kind = "ball_drop"
height = "1.5 ± 0.005 mm"
sphere = "A3"
counter_body = "sapphire"

[variants.heavy]
base = "drop"
sphere = { mass = "506 ± 0.5 g" }
"""


@pytest.fixture
def folder(small_session: Path, tmp_path: Path) -> Path:
    """A session two folders below the laboratory's file; its calibration record is the laboratory's."""
    folder = tmp_path / "sessions" / "small"
    shutil.copytree(small_session, folder)
    (tmp_path / "records").mkdir()
    shutil.move(folder / "calibration/laser.toml", tmp_path / "records/laser.toml")
    (tmp_path / "laboratory.toml").write_text(LABORATORY, "utf-8")
    (folder / "session.toml").write_text(SESSION, "utf-8")
    return folder


def test_a_session_takes_spheres_records_and_patterns_from_the_laboratory_and_may_change_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drop, heavy = open_session(folder).experiments.values()
    assert drop.settings.laser == ["laser/drop_1.csv", "laser/drop_2.csv"]
    assert drop.settings.sphere.mass.value == 0.505
    assert (folder / drop.settings.calibration).samefile(folder.parents[1] / "records/laser.toml")
    assert drop.lines["sphere.radius"] == 7  # where the session names the sphere
    assert dict(heavy.overrides) == {"sphere.mass": ("505 ± 0.5 g", "506 ± 0.5 g")}
    assert lp.process(folder, "displacement", jobs=0).failures == ()
    _, out, _ = run(capsys, "plan", str(folder), "--to", "displacement")
    assert "laboratory.toml has sphere.mass = 505 ± 0.5 g, the session 506 ± 0.5 g" in out


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('sphere = "A3"', 'sphere = "A33"', 'session.toml:7: experiments.drop.sphere: there is no sphere "A33"'),
        ("../../lab", "/etc/lab", "session.toml:2: laboratory: expected laboratory.toml in"),
        ("505 ± 0.5 g", "505 mm", "laboratory.toml:5: sphere.A3.mass: expected a mass"),
        ("records/laser", "records/lasre", "laboratory.toml:9: defaults.ball_drop.calibration: there is no file"),
        ("records/", "../../", "laboratory.toml:9: defaults.ball_drop.calibration: "),
        ("[sphere.A3]", "[spere.A3]", 'laboratory.toml:3: spere: unknown key; did you mean "sphere"?'),
    ],
)
def test_a_mistake_is_named_with_its_file_and_line(folder: Path, old: str, new: str, message: str) -> None:
    for path, text in ((folder / "session.toml", SESSION), (folder.parents[1] / "laboratory.toml", LABORATORY)):
        path.write_text(text.replace(old, new), "utf-8")
    with pytest.raises(ConfigError) as caught:
        open_session(folder)
    assert any(problem.startswith(message) for problem in caught.value.problems), caught.value.problems

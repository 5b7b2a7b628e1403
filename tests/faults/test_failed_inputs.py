"""Whatever inputs cannot be read: every experiment has its page, and the page says why."""

from pathlib import Path

import pytest

from labpipe.workflow.results import RunResult
from pipelines.rig.session_text import laser_record
from pipelines.session import SETTINGS, process

SPHERE = 'sphere = { radius = "9.5 mm", mass = "0.5 kg", material = "acrylic" }\n'
KINDS = {
    "ball_drop": 'laser = ["a.csv", "b.csv"]\ncalibration = "laser.toml"\nheight = "2 mm"\n' + SPHERE,
    "dma": 'rheometer = ["a.csv", "b.csv"]\nmode = "tension"\nnu = 0.4\n',
    "contact_area": 'film = "a.cine"\ncamera = "laser.toml"\nheight = "2 mm"\n' + SPHERE,
    "dic_validation": 'film = "a.cine"\ncamera = "laser.toml"\n',
    "relaxation": 'mach1 = ["a.txt", "b.txt"]\n',
    "plate_vibration": 'calibration = "laser.toml"\ndrops = [{ material = "acrylic", '
    'height = "2 mm", laser = ["a.csv", "b.csv"] }]\n',
    "static_loading": 'laser = "a.csv"\ncalibration = "laser.toml"\nloads = [{ mass = "0.1 kg" }, '
    '{ mass = "0.2 kg" }]\nsphere = { radius = "9.5 mm", material = "acrylic" }\n',
    "harmonic": 'mach1 = "a.txt"\n',
}
GARBAGE = {"nothing": b"", "text": b"this is no recording\n", "zeros": bytes(5000)}


def session(folder: Path, data: bytes) -> Path:
    folder.mkdir()
    for name in ("a.csv", "b.csv", "a.txt", "b.txt", "a.cine"):
        (folder / name).write_bytes(data)
    (folder / "laser.toml").write_text(laser_record(), "utf-8")
    tables = (f'[experiments.{kind}]\nkind = "{kind}"\n{text}' for kind, text in KINDS.items())
    (folder / "session.toml").write_text("labpipe = 1\n" + "\n".join(tables), "utf-8")
    return folder


def unexpected(result: RunResult) -> list[str]:
    return [f"{o.task}: {o.message}" for o in result.outcomes if "unexpected" in o.message]


def test_every_kind_of_experiment_is_tried() -> None:
    assert KINDS.keys() == SETTINGS.keys()


@pytest.mark.parametrize("what", GARBAGE)
def test_every_page_tells_why_there_are_no_results(tmp_path: Path, what: str) -> None:
    folder = session(tmp_path / "session", GARBAGE[what])
    result = process(folder, jobs=0)
    assert result.exit_code == 3
    assert unexpected(result) == []
    for kind in KINDS:
        page = (folder / f"labpipe/reports/{kind}.html").read_text("utf-8")
        assert any(name in page for name in ("a.csv", "a.txt", "a.cine", "laser.toml")), kind
        assert "Errors" in page, kind

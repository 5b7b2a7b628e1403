"""The campaign's plan: what it records, and that every figure finds what it needs in it."""

import tomllib
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from labpipe import files
from labpipe.errors import UsageError
from pipelines.figures import FIGURES, make
from pipelines.rig import campaign, dma, plate_session, session_text, static_loading
from pipelines.rig.indentation_session import oscillation_section, relaxation_section
from pipelines.rig.indentations import Specimen
from pipelines.rig.samples import write_sample
from pipelines.session import open_session

START = datetime(2024, 5, 14, 9, 30)


def touched(folder: Path, *names: str) -> list[str]:
    for name in names:
        files.write_text(folder / name, name)
    return list(names)


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The campaign's session.toml over empty recordings; nothing is simulated."""

    def drops(folder: Path, name: str, *rest: object) -> list[str]:
        count = rest[3]
        assert isinstance(count, int)
        return touched(folder, *(f"laser/{name}_{i}.csv" for i in range(count)))

    def ringing(folder: Path, stem: str, *rest: object) -> list[str]:
        return touched(folder, f"laser_plate/{stem}.csv")

    def one(pattern: str) -> object:
        return lambda folder, name, *rest: touched(folder, pattern.format(name))[0]

    def rubber(folder: Path, *rest: object) -> str:
        specimen = Specimen.__new__(Specimen)  # its sections need the shape alone
        for field, value in (("tip_radius", 2e-3), ("period", 8e-3), ("depth", 6e-3), ("tips", 3)):
            object.__setattr__(specimen, field, value)
        names = touched(folder, "mach1/nbr_relaxation.txt", "mach1/nbr_harmonic.txt")
        touched(folder, "calibration/load_cell.toml")
        text = relaxation_section("nbr_relaxation", names[:1], specimen)
        return text + oscillation_section("nbr_harmonic", specimen)

    monkeypatch.setattr(campaign, "write_drops", drops)
    monkeypatch.setattr(plate_session, "write_ringing", ringing)
    monkeypatch.setattr(campaign, "write_under", one("film/{}.cine"))
    monkeypatch.setattr(campaign, "write_front", one("film/{}_front.cine"))
    monkeypatch.setattr(static_loading, "write_static", one("laser/{}.csv"))
    monkeypatch.setattr(dma, "write_dma", one("dma/{}.csv"))
    monkeypatch.setattr(campaign, "write_indentations", rubber)
    monkeypatch.setattr(campaign, "burst_times", lambda *rest: None)
    parts = campaign._parts(tmp_path, START, campaign.THESIS)
    sections = [part.write() for part in parts]
    session_text.write_session(tmp_path, "Campaign", campaign.joined(sections))
    names = [name for part in parts for name in part.names]
    assert set(names) | {"plate"} == set(tomllib.loads((tmp_path / "session.toml").read_text("utf-8"))["experiments"])
    return tmp_path


def test_the_campaign_holds_what_the_thesis_did(session: Path) -> None:
    found = open_session(session)
    assert found.synthetic
    count: dict[str, int] = {}
    for experiment in found.experiments.values():
        count[experiment.kind] = count.get(experiment.kind, 0) + 1
    assert count == {
        "ball_drop": 17,
        "contact_area": 5,
        "dic_validation": 1,
        "dma": 5,
        "harmonic": 1,
        "plate_vibration": 1,
        "relaxation": 1,
        "static_loading": 1,
    }
    drops = [e for e in found.experiments.values() if e.kind == "ball_drop"]
    assert {len(e.settings.laser) for e in drops} == {5}
    assert len(found.experiments["plate"].settings.drops) == 16


def test_every_regenerable_figure_can_be_drawn_from_it(session: Path, tmp_path: Path) -> None:
    shelf = make.Shelf.of(tmp_path / "figures", session)
    states = {s.figure.id: s for s in make.states(shelf, FIGURES)}
    not_ready = {name for name, s in states.items() if s.state != make.READY}
    assert not_ready == {"2.1", "2.2", "3.1", "3.2", "B.1a"}
    heated = "acrylic_10mm_39C"
    assert heated not in states["3.10"].experiments
    assert f"{heated}_film" not in states["3.15"].experiments
    assert {f"{heated}_film", "acrylic_10mm_film"} <= set(states["3.16"].experiments)


def test_a_seed_draws_the_rig_within_what_the_session_states() -> None:
    one, again, other = (campaign.drawn(campaign.SMALL, seed) for seed in (1, 1, 2))
    assert one == again != other
    drawn = [campaign.drawn(campaign.SMALL, seed) for seed in range(400)]
    masses = np.array([extent.rig.mass for extent in drawn]) - 0.505
    sizes = np.array([extent.under.pixel_size for extent in drawn]) / campaign.SMALL.under.pixel_size - 1.0
    for errors, u in ((masses, 0.5e-3), (sizes, np.hypot(1 / 461, 0.0005 / 2))):
        assert np.std(errors) == pytest.approx(u, rel=0.15)  # its own scatter is u/√800, 3.5 %
        assert abs(np.mean(errors)) < 4.0 * u / 20.0


def test_a_sample_that_no_seed_draws_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="thesis-small"):
        write_sample("core", tmp_path, seed=1)

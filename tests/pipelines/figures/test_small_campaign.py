"""The committed small campaign: what it holds, and what is drawn again when a recording is lost."""

import shutil
from pathlib import Path

import pytest

from labpipe import files
from labpipe.workflow import events
from pipelines.figures import FIGURES, make
from pipelines.session import open_session

CAMPAIGN = Path(__file__).parents[3] / "sample_data/thesis-small"
MOST_BYTES = 2_500_000
TESTS = tuple(f"mach1/nbr_relaxation_{depth}um.txt" for depth in (100, 200, 300))


def without(folder: Path, recording: str) -> None:
    """Delete a recording, and its line in session.toml."""
    (folder / recording).unlink()
    path = folder / "session.toml"
    text = path.read_text("utf-8")
    assert f'  "{recording}",\n' in text
    files.write_text(path, text.replace(f'  "{recording}",\n', ""))


def drawn(folder: Path, figures: Path) -> dict[str, str]:
    shelf = make.Shelf.of(figures, folder)
    outcomes = make.make(shelf, make.chosen(["2.4", "3.4"]))
    return {outcome.id: f"{outcome.state}{outcome.detail}" for outcome in outcomes}


def computed(folder: Path) -> int:
    """Steps that have been computed so far."""
    return sum(e.get("state") == "done" for e in events(open_session(folder)))


def test_it_holds_every_kind_and_says_that_it_is_synthetic() -> None:
    session = open_session(CAMPAIGN)
    assert session.synthetic
    assert "SYNTHETIC" in session.notes
    assert {e.kind for e in session.experiments.values()} == {
        "ball_drop",
        "contact_area",
        "dic_validation",
        "dma",
        "harmonic",
        "plate_vibration",
        "relaxation",
        "static_loading",
    }
    sizes = [path.stat().st_size for path in CAMPAIGN.rglob("*") if path.is_file()]
    assert sum(sizes) < MOST_BYTES


def test_every_regenerable_figure_can_be_drawn_from_it(tmp_path: Path) -> None:
    states = make.states(make.Shelf.of(tmp_path / "figures", CAMPAIGN), FIGURES)
    assert {s.figure.id for s in states if s.state != make.READY} == {"2.1", "2.2", "3.1", "3.2", "B.1a"}


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    folder = tmp_path / "campaign"
    shutil.copytree(CAMPAIGN, folder)
    without(folder, TESTS[2])
    return folder


@pytest.mark.slow
def test_a_lost_recording_concerns_its_figure_alone_and_computes_nothing_again(campaign: Path, tmp_path: Path) -> None:
    figures = tmp_path / "figures"
    assert drawn(campaign, figures) == {"2.4": make.DRAWN, "3.4": make.DRAWN}
    first = computed(campaign)
    kinds = {e["experiment"] for e in events(open_session(campaign)) if e.get("state") == "done"}
    assert kinds == {"nbr_relaxation", "nbr_dma", "peek_dma"}  # of 17 experiments
    assert drawn(campaign, figures) == {"2.4": make.UP_TO_DATE, "3.4": make.UP_TO_DATE}
    without(campaign, TESTS[1])
    assert drawn(campaign, figures) == {"2.4": make.DRAWN, "3.4": make.UP_TO_DATE}
    assert computed(campaign) == first
    caption = (figures / "2.4.txt").read_text("utf-8")
    assert "0.1 mm" in caption
    assert "0.2 mm" not in caption

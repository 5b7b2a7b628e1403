"""The committed small campaign: its kinds, and the figures that can be drawn from it."""

from pathlib import Path

from pipelines.experiments import KINDS
from pipelines.figures import FIGURES, make
from pipelines.session import open_session

CAMPAIGN = Path(__file__).parents[3] / "sample_data/thesis-small"
MOST_BYTES = 2_500_000


def test_it_holds_every_kind_and_says_that_it_is_synthetic() -> None:
    session = open_session(CAMPAIGN)
    assert session.synthetic
    assert "SYNTHETIC" in session.notes
    assert {e.kind for e in session.experiments.values()} == set(KINDS)
    assert sum(path.stat().st_size for path in CAMPAIGN.rglob("*") if path.is_file()) < MOST_BYTES


def test_every_regenerable_figure_can_be_drawn_from_it(tmp_path: Path) -> None:
    states = {s.id: s for s in make.states(make.Shelf.of(tmp_path / "figures", CAMPAIGN), FIGURES)}
    assert {i for i, s in states.items() if s.state != make.READY} == {"2.1", "2.2", "3.1", "3.2", "B.1a"}
    heated = [name for name in open_session(CAMPAIGN).experiments if name.endswith("39C")]
    films = [f"{name}_film" for name in heated]
    assert heated
    assert not {*heated, *films} & {*states["3.10"].experiments, *states["3.15"].experiments}
    assert {*films, "acrylic_1p5mm_film"} <= set(states["3.16"].experiments)

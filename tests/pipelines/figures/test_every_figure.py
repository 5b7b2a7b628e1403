"""Each figure of the list is drawn once, coarsely: those of a session from the committed small campaign."""

import shutil
from io import BytesIO
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from pipelines import session as verbs
from pipelines.figures import FIGURES, Figure, make
from pipelines.figures.inputs import matching
from tests.pipelines import readme

CAMPAIGN = Path(__file__).parents[3] / "sample_data/thesis-small"
DRAWN = tuple(figure for figure in FIGURES if figure.function)
MESSAGES = {
    "2.3": "hollow where no sweep reaches",
    "2.6": "The material is the DMA experiment nbr_dma",
    "2.7": "of the cycle is without contact",
    "3.3": "drop simulation with the DMA experiment acrylic_dma",
    "3.16": "Here larger in I, ",
    "A.1": "GPa and c_v",
}
"""Parts of captions that say what a figure is for."""


@pytest.fixture(scope="module")
def of_campaign(tmp_path_factory: pytest.TempPathFactory) -> make.Shelf:
    """A folder of figures with the small campaign, of which is processed what they need."""
    folder = tmp_path_factory.mktemp("every")
    session = Path(shutil.copytree(CAMPAIGN, folder / "campaign"))
    opened = verbs.open_session(session)
    shown = {(name, stage) for f in DRAWN for n in f.needs for name in matching(opened, n) for stage in n.stages}
    targets, names = sorted(f"{name}/{stage}" for name, stage in shown), sorted({name for name, _ in shown})
    assert verbs.process(session, targets, names, jobs=0).exit_code == 0
    return make.Shelf.of(folder / "figures", session)


def rows_of(axes: Axes) -> range | None:
    """Rows of its figure's grid in which it stands; a colour bar stands in none."""
    place = axes.get_subplotspec()
    return None if place is None else place.rowspan


@pytest.mark.parametrize(
    "figure", [pytest.param(f, id=f.id, marks=[pytest.mark.slow] if f.needs else []) for f in DRAWN]
)
def test_it_is_drawn_with_all_that_a_caption_says(
    request: pytest.FixtureRequest, tmp_path: Path, figure: Figure
) -> None:
    shelf: make.Shelf = request.getfixturevalue("of_campaign") if figure.needs else make.Shelf(tmp_path)
    (state,) = make.states(shelf, [figure])
    assert state.state == make.READY
    assert bool(state.experiments) == bool(figure.needs)
    drawing = make.draw(shelf, figure, state.experiments)
    text = drawing.caption(figure.id, figure.title)
    assert "nan" not in text.split()
    assert "None" not in text
    assert MESSAGES.get(figure.id, "") in " ".join(text.split())
    if figure.id in readme.FIGURES:
        now, held = readme.of_figure(figure, drawing), readme.recorded()[figure.id]
        assert now.pop("caption") == held.pop("caption"), readme.ADVICE
        assert now == {name: pytest.approx(numbers, rel=0.02, abs=1e-3) for name, numbers in held.items()}, (
            readme.ADVICE
        )
    if drawing.figure is None:
        assert len(drawing.table.splitlines()) > 1
        return
    drawing.figure.set_dpi(40)
    canvas = FigureCanvasAgg(drawing.figure)
    canvas.print_png(BytesIO())
    for axes in drawing.figure.axes:
        # Curves over numbers say what these are, or stand beside or above others that do.
        alone = axes.get_shared_x_axes().get_siblings(axes) == [axes]
        if axes.axison and axes.lines and alone and axes.xaxis.get_converter() is None:
            row = [one for one in drawing.figure.axes if rows_of(one) == rows_of(axes)]
            assert axes.get_xlabel()
            assert any(one.get_ylabel() for one in row)

"""Which figures there are, what is drawn and what is not, and that it is the same every time."""

from importlib import import_module
from pathlib import Path

import pytest

from pipelines.experiments import KINDS
from pipelines.figures import FIGURES, make
from tests.pipelines.command import run

CHEAP = "1.2"


def drawn(folder: Path, *names: str) -> dict[str, str]:
    outcomes = make.make(make.Shelf.of(folder, None), make.chosen(names))
    return {outcome.id: outcome.state for outcome in outcomes}


def contents(folder: Path) -> dict[str, bytes]:
    """The files by name."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_no_number_twice_and_every_function_and_stage_exists() -> None:
    assert len({figure.id for figure in FIGURES}) == len(FIGURES)
    for figure in FIGURES:
        assert not (figure.function and figure.reason), figure.id
        if figure.function:
            module, name = figure.function.split(":")
            assert callable(getattr(import_module(module), name))
        for need in figure.needs:
            assert set(need.stages) <= {stage.name for stage in KINDS[need.kind].stages}, figure.id


def test_a_figure_has_three_formats_and_a_caption_and_the_same_bytes_each_time(tmp_path: Path) -> None:
    for name in ("first", "second"):
        assert drawn(tmp_path / name, CHEAP) == {CHEAP: make.DRAWN}
    first, second = contents(tmp_path / "first"), contents(tmp_path / "second")
    assert set(first) == {f"{CHEAP}.{kind}" for kind in ("pdf", "svg", "png", "txt", "tex")} | {make.RECORD}
    assert first == second


@pytest.mark.slow
def test_a_second_run_draws_nothing_and_a_changed_file_only_itself(tmp_path: Path) -> None:
    both = (CHEAP, "table-D.1")
    assert set(drawn(tmp_path, *both).values()) == {make.DRAWN}
    assert set(drawn(tmp_path, *both).values()) == {make.UP_TO_DATE}
    before = contents(tmp_path)
    (tmp_path / f"{CHEAP}.svg").write_text("damaged")
    assert drawn(tmp_path, *both) == {CHEAP: make.DRAWN, "table-D.1": make.UP_TO_DATE}
    assert contents(tmp_path) == before


@pytest.mark.slow
def test_figures_of_a_session_read_its_results_and_follow_its_keys(processed_session: Path, tmp_path: Path) -> None:
    shelf = make.Shelf.of(tmp_path, processed_session)
    outcomes = make.make(shelf, make.chosen(["2.8", "3.10", "3.11"]))
    states = {outcome.id: outcome.state for outcome in outcomes}
    assert states == {"2.8": make.DRAWN, "3.10": make.DRAWN, "3.11": make.NEEDS_SESSION}
    text = (tmp_path / "3.10.txt").read_text(encoding="utf-8")
    assert "Measured: nothing." in text
    assert "2 laser recordings per height" in text
    again = make.states(make.Shelf.of(tmp_path, processed_session), make.chosen(["3.10"]))
    assert again[0].state == make.UP_TO_DATE
    key = shelf.key(again[0].figure, again[0].experiments)
    assert key != shelf.key(again[0].figure, ())


def test_a_failed_experiment_is_named_with_its_reason(session_copy: Path, tmp_path: Path) -> None:
    laser = sorted((session_copy / "laser").iterdir())[0]
    laser.write_bytes(b"\x00damaged")
    shelf = make.Shelf.of(tmp_path / "figures", session_copy)
    (outcome,) = make.make(shelf, make.chosen(["3.10"]))
    assert outcome.state == make.FAILED
    assert laser.name in outcome.detail
    assert not list((tmp_path / "figures").glob("3.10*"))


def test_numbers_and_captions_are_written_for_a_thesis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, said = run(capsys, "figures", "3.10", "--out", str(tmp_path / "none"))
    assert (code, "name one by --session" in said) == (2, True)
    code, _, _ = run(capsys, "figures", "1.2", "--data", "--out", str(tmp_path))
    assert code == 0
    head, *rows = (tmp_path / "1.2-data.csv").read_text("utf-8").splitlines()
    assert head == "panel,curve,x_axis,y_axis,x,y"
    loss = [tuple(map(float, row.split(",")[-2:])) for row in rows if "loss" in row]
    where, largest = max(loss, key=lambda point: point[1])
    assert (where, largest) == pytest.approx((1.0, 0.45), rel=0.02)  # omega tau = 1, 0.9 of the step over two
    caption = (tmp_path / "1.2.tex").read_text("utf-8")
    assert caption.startswith("\\caption[Complex modulus with one relaxation time]{")
    assert caption.endswith("\\label{fig:1.2}\n")
    assert "printed" not in caption  # our comparison is no caption of a thesis
    without = make.states(make.Shelf.of(tmp_path, None), make.chosen(["1.2"]))
    assert [state.state for state in without] == [make.READY]  # what was asked for differs

"""The page of a session: states, numbers and pictures of all experiments, made again on change."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pipelines.cli import main
from pipelines.experiments import Picture
from pipelines.session import PAGE, STAGES, open_session, write_overview
from pipelines.session._overview import _chart


def page(folder: Path) -> str:
    return (folder / "labpipe" / PAGE).read_text("utf-8")


def test_every_experiment_is_there_with_link_state_and_picture(processed_session: Path) -> None:
    text = page(processed_session)
    for name in ("drop", "nbr"):
        assert f'<a href="reports/{name}.html">{name}</a>' in text
    assert len(re.findall(r'src="data:image/svg\+xml;base64,', text)) == 2
    assert "first restitution" in text
    assert "largest contact radius" not in text  # no experiment has one
    assert "synthetic data" in text


def test_the_page_is_written_again_only_after_a_change(session_copy: Path) -> None:
    path = session_copy / "labpipe" / PAGE
    before = path.stat().st_mtime_ns, path.read_bytes()
    write_overview(open_session(session_copy), STAGES)
    assert (path.stat().st_mtime_ns, path.read_bytes()) == before
    toml = session_copy / "session.toml"
    toml.write_text(toml.read_text("utf-8").replace('height = "1.5', 'height = "1.6'), "utf-8")
    write_overview(open_session(session_copy), STAGES)
    assert re.search(r"\d+ of \d+ steps to do(?! or failed)", page(session_copy))  # nothing has failed


def test_each_kind_has_a_table_with_its_own_numbers(session_copy: Path) -> None:
    toml = session_copy / "session.toml"
    text = toml.read_text("utf-8")
    film = 'film = "laser/drop_1.csv"\ncamera = "calibration/laser.toml"\n'
    table = 'rheometer = ["laser/drop_1.csv"]\nmode = "shear"\nnu = "0.35"\n'
    text += f'\n[experiments.front]\nkind = "dic_validation"\n{film}'
    text += '\n[experiments.melt]\nkind = "dma"\n' + table
    toml.write_text(text, "utf-8")
    write_overview(open_session(session_copy), STAGES)
    found = page(session_copy)
    titles = re.findall("<h2>(.*?)</h2>", found)
    assert titles[:5] == ["Answer", "Ball drop", "Harmonic", "Camera against laser", "DMA"]
    assert "2 of 4 experiments done" in found
    assert found.count('class="data index"') == 4  # of one row each: nothing to sort
    drop = found[found.index("<h2>Ball drop") : found.index("<h2>Harmonic")]
    assert "first restitution" in drop
    assert "storage stiffness" not in drop


def test_a_gap_in_a_curve_stays_a_gap_in_its_picture() -> None:
    y = [1.0, 2.0, np.nan, 3.0, 4.0]
    drawn = _chart(xr.Dataset({"a": ("x", y)}, coords={"x": np.arange(5.0)}), Picture("", "x", "a"))
    assert drawn is not None
    assert np.isnan(drawn.series[0].y).tolist() == [False, False, True, False, False]
    empty = xr.Dataset({"a": ("x", [1.0, np.nan])}, coords={"x": [0.0, 1.0]})
    assert _chart(empty, Picture("", "x", "a")) is None


def test_a_file_that_no_experiment_uses_is_a_note_of_the_session(
    session_copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Told by process, in its JSON and on the page; the exit code stays."""
    (session_copy / "laser/forgotten.csv").write_bytes((session_copy / "laser/drop_2.csv").read_bytes())
    assert _processed(session_copy, "--json") == 0
    (note,) = json.loads(capsys.readouterr().out)["findings"]
    assert (note["level"], note["file"]) == ("note", "laser/forgotten.csv")
    assert "same bytes as laser/drop_2.csv" in note["cause"]
    assert _processed(session_copy) == 0
    assert "note: no experiment uses laser/forgotten.csv" in capsys.readouterr().out
    assert "No experiment uses laser/forgotten.csv" in page(session_copy)
    (session_copy / "laser/forgotten.csv").unlink()
    assert _processed(session_copy) == 0
    assert "forgotten" not in page(session_copy)


def _processed(folder: Path, *options: str) -> object:
    with pytest.raises(SystemExit) as ended:
        main(["process", str(folder), *options])
    return ended.value.code

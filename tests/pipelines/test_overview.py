"""The page of a session: states, numbers and pictures of all experiments, made again on change."""

import re
from pathlib import Path

from pipelines.overview import PAGE, write_overview
from pipelines.process import STAGES, open_session, process


def page(folder: Path) -> str:
    return (folder / "labpipe" / PAGE).read_text("utf-8")


def test_every_experiment_is_there_with_link_state_and_picture(processed_session: Path) -> None:
    text = page(processed_session)
    for name in ("drop", "nbr"):
        assert f'<a href="reports/{name}.html">{name}</a>' in text
    assert len(re.findall(r'src="data:image/png;base64,', text)) == 2
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
    assert re.search(r"\d+ of \d+ steps to do or failed", page(session_copy))


def test_a_failed_experiment_is_marked_and_the_other_kept(session_copy: Path) -> None:
    path = session_copy / "laser/drop_2.csv"
    path.write_bytes(path.read_bytes()[:-200].replace(b"+", b"x", 1))
    assert process(session_copy, jobs=0).exit_code == 1
    text = page(session_copy)
    assert "steps to do or failed" in text
    assert '<a href="reports/drop.html">drop</a>' in text


def test_a_damaged_result_leaves_its_cell_empty(session_copy: Path) -> None:
    for victim in (session_copy / "labpipe/store").glob("??/*.nc"):
        data = bytearray(victim.read_bytes())
        data[len(data) // 2] ^= 0x10
        victim.write_bytes(bytes(data))
    (session_copy / "labpipe" / PAGE).unlink()
    write_overview(open_session(session_copy), STAGES)
    text = page(session_copy)
    assert "first restitution" not in text
    assert "data:image/png" not in text

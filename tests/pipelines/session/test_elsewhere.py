"""Results outside the session: a work folder of a read-only archive, and a bundle to be mailed."""

import shutil
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner

import labpipe as lp
from labpipe.errors import ConfigError, UsageError
from pipelines.commands.results import bundle as command


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_work_folder_takes_the_results_of_an_archive_and_stands_for_it(small_session: Path, tmp_path: Path) -> None:
    archive, other, work = (tmp_path / name for name in ("archive", "other", "work"))
    for folder in (archive, other):
        shutil.copytree(small_session, folder)
    lp.process(archive, "repeats", "drop", out=work, jobs=0)
    assert content(archive) == content(other)
    assert float(lp.result(work, "drop", "repeats")["restitution"][0]) == pytest.approx(0.94, abs=0.02)
    again = lp.process(archive, "repeats", "drop", out=work, jobs=0)
    assert {outcome.state for outcome in again.outcomes} == {"cached"}
    session = lp.open_session(work)
    assert "drop" in str(session)
    with pytest.raises(UsageError, match="name another folder"):
        lp.process(other, out=work)
    with pytest.raises(UsageError, match="lies in the session"):
        lp.process(other, out=other / "results")
    archive.rename(tmp_path / "unmounted")
    with pytest.raises(ConfigError, match=r"session.toml:\d+: .*there is no folder .*archive; correct the path"):
        lp.plan(work)


def test_a_bundle_holds_pages_that_lead_to_each_other_and_results(processed_session: Path, tmp_path: Path) -> None:
    made = CliRunner().invoke(command, [str(processed_session), "--out", str(tmp_path / "a.zip"), "--decimal", ","])
    assert made.exit_code == 0, made.output
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        archive.extractall(tmp_path)
    folder = tmp_path / processed_session.name
    assert 'href="reports/drop.html"' in (folder / "labpipe/index.html").read_text("utf-8")
    assert (folder / "labpipe/reports/drop.html").is_file()
    assert (folder / "calibration/laser.toml").is_file()
    assert (folder / "results/quantities.xlsx").is_file()
    table = (folder / "results/drop.repeats.impact.csv").read_text("utf-8").splitlines()
    head, _, first, *_ = (line.split(";") for line in table if not line.startswith("#"))
    shown = dict(zip(head, first, strict=True))["restitution"]
    expected = float(lp.result(processed_session, "drop", "repeats")["restitution"][0])
    assert float(shown.replace(",", ".")) == expected
    assert not list(folder.rglob("drop.displacement.*"))

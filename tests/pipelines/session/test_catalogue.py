"""Many sessions as one table: what is listed, what is read again, and what a query may do."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pytest

from labpipe.errors import SourceError, UsageError
from pipelines.session import catalogue, process, result
from pipelines.session._catalogue import CATALOGUE
from tests.pipelines.sessions import replaced


def query(database: Path, where: str = "", columns: Sequence[str] = (), *, table: str = "experiments") -> pd.DataFrame:
    return catalogue(database.parents[1], where=where, columns=columns, table=table).table


@pytest.fixture(scope="module")
def sessions(pristine_session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A processed session, the same one unprocessed under another name, and a broken one."""
    root = tmp_path_factory.mktemp("sessions")
    shutil.copytree(pristine_session, root / "monday")
    shutil.copytree(pristine_session, root / "2026" / "tuesday")
    shutil.rmtree(root / "2026" / "tuesday" / "labpipe")
    (root / "broken").mkdir()
    (root / "broken" / "session.toml").write_text("[session\n", "utf-8")
    catalogue([root])
    return root


def test_experiments_are_listed_with_parameters_and_numbers(sessions: Path) -> None:
    found = query(sessions / CATALOGUE, "kind = 'ball_drop'")
    assert list(found["session"]) == ["2026/tuesday", "monday"]
    assert found.attrs["units"]["height"] == "m"
    assert (found["height"] > 0.0).all()
    assert found["state"][1] == "done"
    assert "to do" in found["state"][0]
    expected = result(sessions / "monday", str(found["experiment"][1]), "repeats")["restitution"]
    assert found["first_restitution"][1] == float(expected[0])
    assert found["first_restitution"].isna()[0]
    of_itself = catalogue(sessions / "monday").table
    assert set(of_itself["session"]) == {"monday"}
    assert of_itself["storage_stiffness_at_1_Hz"].notna().sum() == 1
    assert "reports/drop.html" in (sessions / "monday/labpipe/catalogue.html").read_text("utf-8")


def test_verdicts_and_findings_are_columns(sessions: Path, tmp_path: Path) -> None:
    """Of what is processed; a mistake is found by its verdict, with the line to change."""
    found = query(sessions / CATALOGUE, "kind = 'ball_drop'")
    assert found["believable"][1] == "yes"
    assert found["checks"][1] > 8
    assert found["believable"].isna()[0]
    root = tmp_path / "copy"
    shutil.copytree(sessions / "monday", root / "monday")
    text = (root / "monday" / "session.toml").read_text("utf-8")
    (root / "monday" / "session.toml").write_text(text.replace('"1.5 ±', '"15 ±', 1), "utf-8")
    process(root / "monday", "judgement", "drop", jobs=0)
    (row,) = catalogue([root], where="believable = 'impossible'").table.to_dict("records")
    assert row["experiment"] == "drop"
    assert row["findings"].startswith("impossible: ")
    line = next(i for i, one in enumerate(text.splitlines(), 1) if '"1.5 ±' in one)
    assert f"session.toml:{line}" in row["findings"]
    assert "drop height" in row["cause"]


def test_only_what_changed_is_read_again(sessions: Path, tmp_path: Path) -> None:
    root = tmp_path / "copy"
    shutil.copytree(sessions, root)
    first = catalogue([root])
    assert (first.unchanged, first.renewed) == (("2026/tuesday", "monday"), ())
    (root / "broken" / "session.toml").unlink()
    replaced(root / "monday", "title = ", "title = 'x' #")
    shutil.rmtree(root / "2026")
    second = catalogue([root])
    assert second.renewed == ("monday",)
    assert set(query(root / CATALOGUE)["session"]) == {"monday"}
    kept = root / "monday/labpipe/store/catalogue.json"
    kept.write_bytes(kept.read_bytes()[:-9])
    assert catalogue([root]).renewed == ("monday",)  # damage is noticed


def test_a_session_that_cannot_be_read_is_named_and_its_rows_kept(sessions: Path, tmp_path: Path) -> None:
    root = tmp_path / "copy"
    shutil.copytree(sessions, root)
    before = query(root / CATALOGUE, "session = 'monday'")
    (root / "monday" / "session.toml").write_text("[session\n", "utf-8")
    done = catalogue([root])
    assert set(done.problems) == {"broken", "monday"}
    assert "session.toml:1" in done.problems["monday"]
    assert query(root / CATALOGUE, "session = 'monday'").equals(before)
    told = query(root / CATALOGUE, "problem is not null", table="sessions")
    assert set(told["session"]) == {"broken", "monday"}


@pytest.mark.parametrize(
    ("where", "words"),
    [("height >", ""), ("heigth > 1", r"; did you mean \"height\"\?"), ("1) ; DROP TABLE experiments; --", ""),
     ("load_extension('x')", "")],
)  # fmt: skip
def test_a_wrong_condition_is_refused_and_changes_nothing(sessions: Path, where: str, words: str) -> None:
    before = (sessions / CATALOGUE).read_bytes()
    with pytest.raises(UsageError, match=f"{words}; the columns are session, experiment, kind"):
        query(sessions / CATALOGUE, where)
    assert (sessions / CATALOGUE).read_bytes() == before


def test_a_foreign_file_is_left_alone(tmp_path: Path) -> None:
    content = b"some notes\n" * 100
    (tmp_path / CATALOGUE).parent.mkdir()
    (tmp_path / CATALOGUE).write_bytes(content)
    with pytest.raises(SourceError, match="not a catalogue of labpipe"):
        catalogue([tmp_path])
    assert (tmp_path / CATALOGUE).read_bytes() == content

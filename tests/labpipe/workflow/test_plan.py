"""A plan says what will run and why; nothing else runs."""

import os
from pathlib import Path

import pytest
import toy_laboratory as toy

from labpipe.errors import ConfigError, UsageError
from labpipe.workflow.graph import Stage
from labpipe.workflow.plan import Plan, plan
from labpipe.workflow.results import RunResult
from labpipe.workflow.runner import run
from labpipe.workflow.session import Session


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A session that has been run."""
    made = toy.make_session(tmp_path)
    assert run_here(made).exit_code == 0
    return made


def run_here(session: Session, stages: object = toy.STAGES, **options: object) -> RunResult:
    return run(session, stages, schemas=toy.SCHEMAS, jobs=0, **options)  # type: ignore[arg-type]


def not_cached(made: Plan) -> dict[str, str]:
    return {str(row.task): f"{row.state}: {row.reason}" for row in made.to_run}


def done(result: RunResult) -> set[str]:
    return {str(outcome.task) for outcome in result.outcomes if outcome.state == "done"}


def changed(session: Session, old: str, new: str) -> Session:
    assert old in toy.TOML
    return toy.reload_session(session.root, toy.TOML.replace(old, new))


def test_before_the_first_run_everything_will_run(tmp_path: Path) -> None:
    made = plan(toy.make_session(tmp_path), toy.STAGES)
    assert len(made.rows) == 11
    assert not_cached(made) == {
        "acrylic/read [laser/r1.txt]": "will run: never run",
        "acrylic/read [laser/r2.txt]": "will run: never run",
        "acrylic/scale [laser/r1.txt]": "waits: never run; upstream read will run",
        "acrylic/scale [laser/r2.txt]": "waits: never run; upstream read will run",
        "acrylic/mean": "waits: never run; upstream scale will run",
        "acrylic/page": "waits: never run; upstream mean will run; upstream scale will run",
        "rubber/curve": "will run: never run",
        "nbr/read [laser/r3.txt]": "will run: never run",
        "nbr/scale [laser/r3.txt]": "waits: never run; upstream read will run",
        "nbr/mean": "waits: never run; upstream rubber/curve will run; upstream scale will run",
        "nbr/page": "waits: never run; upstream mean will run; upstream scale will run",
    }
    with pytest.raises(UsageError, match='no stage "scael"; did you mean "scale"'):
        plan(made.session, toy.STAGES, targets=["scael"])
    with pytest.raises(UsageError, match='no experiment "acrilic"; did you mean "acrylic"'):
        plan(made.session, toy.STAGES, only=["acrilic"])
    assert made.rows[0].summary == "read the numbers"
    assert not (tmp_path / "labpipe").exists()


def test_a_changed_parameter_reruns_only_what_is_behind_it(session: Session) -> None:
    assert [row.state for row in plan(session, toy.STAGES).rows] == ["cached"] * 11
    assert done(run_here(session)) == set()
    now = changed(session, "9.5 mm", "9.525 mm")
    reason = "parameter sphere.radius changed 9.5 mm -> 9.525 mm"
    expected = {"acrylic/mean": f"will run: {reason}", "acrylic/page": f"waits: {reason}; upstream mean will run"}
    assert not_cached(plan(now, toy.STAGES)) == expected
    assert done(run_here(now)) == set(expected)
    # Back again: the old results are still there, and only the page is put back in its place.
    assert not_cached(plan(changed(session, "9.5 mm", "9.5 mm"), toy.STAGES)) == {
        "acrylic/page": "will run: reports/acrylic.html is missing or was changed"
    }


def test_a_changed_input_reruns_only_its_recording_and_what_is_behind(session: Session) -> None:
    (session.root / "laser" / "r1.txt").write_text("1 2 3 4 5")
    expected = {
        "acrylic/read [laser/r1.txt]": "will run: input laser/r1.txt changed",
        "acrylic/scale [laser/r1.txt]": "waits: upstream read will run",
        "acrylic/mean": "waits: upstream scale will run",
        "acrylic/page": "waits: upstream mean will run; upstream scale will run",
    }
    assert not_cached(plan(session, toy.STAGES)) == expected
    (session.root / "dma.txt").write_text("0.5")  # the result of another experiment is an input like any other
    expected |= {
        "rubber/curve": "will run: input dma.txt changed",
        "nbr/mean": "waits: upstream rubber/curve will run",
        "nbr/page": "waits: upstream mean will run",
    }
    assert not_cached(plan(session, toy.STAGES)) == expected
    assert done(run_here(session)) == set(expected)


def test_content_decides_not_time(session: Session) -> None:
    path = session.root / "laser" / "r1.txt"
    os.utime(path, (4e9, 4e9))
    assert not_cached(plan(session, toy.STAGES)) == {}
    text, status = path.read_text(), path.stat()
    path.unlink()
    path.write_text(text)
    assert not_cached(plan(session, toy.STAGES)) == {}
    path.write_text(text.replace("1", "2"))
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert "acrylic/read [laser/r1.txt]" in not_cached(plan(session, toy.STAGES))


def test_a_page_that_was_touched_is_put_back_without_work(session: Session) -> None:
    path = session.folder / "reports" / "nbr.html"
    before = path.read_bytes()
    for damage in (path.unlink, lambda: path.write_text("edited")):
        damage()
        reason = "will run: reports/nbr.html is missing or was changed"
        assert not_cached(plan(session, toy.STAGES)) == {"nbr/page": reason}
        run_here(session)
        assert path.read_bytes() == before


def test_targets_need_only_what_is_behind_them(tmp_path: Path) -> None:
    session = toy.make_session(tmp_path)
    found = plan(session, toy.STAGES, targets=["scale"], only=["nbr"])
    assert [str(r.task) for r in found.rows] == ["nbr/read [laser/r3.txt]", "nbr/scale [laser/r3.txt]"]
    found = plan(session, toy.STAGES, targets=["nbr/mean"])
    assert {r.experiment for r in found.rows} == {"nbr", "rubber"}
    result = run_here(session, targets=["scale"])
    files = ("acrylic/{} [laser/r1.txt]", "acrylic/{} [laser/r2.txt]", "nbr/{} [laser/r3.txt]")
    assert done(result) == {name.format(s) for name in files for s in ("read", "scale")}


def test_an_unreadable_input_is_the_reason_of_its_row(tmp_path: Path) -> None:
    session = toy.make_session(tmp_path)
    (tmp_path / "laser" / "r1.txt").unlink()
    found = not_cached(plan(session, toy.STAGES))
    assert found["acrylic/read [laser/r1.txt]"] == "will run: missing: laser/r1.txt (session.toml:6)"
    assert found["acrylic/read [laser/r2.txt]"] == "will run: never run"
    failed = {str(o.task): o.exit_code for o in run_here(session).failures}
    assert failed == {"acrylic/read [laser/r1.txt]": 3}
    assert (session.folder / "reports" / "acrylic.html").exists()


def test_experiments_in_a_circle_are_refused_at_their_line(tmp_path: Path) -> None:
    curve = Stage("curve", "toy_laboratory:mean", ("other:material/mean",))
    stages = {"drop": (*toy.DROP, curve)}
    text = toy.TOML.replace("[experiments.nbr]", 'material = "nbr"\n[experiments.nbr]')
    text = text.replace('material = "rubber"', 'material = "acrylic"')
    session = toy.make_session(tmp_path, text.split("[experiments.rubber]")[0])
    with pytest.raises(ConfigError, match=r"session.toml:(8|13): experiments\.\w+\.mat.*circle"):
        plan(session, stages)

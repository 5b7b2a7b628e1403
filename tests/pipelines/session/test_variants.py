"""Variants: the recordings of another experiment with other settings, next to it; nothing is computed twice."""

from pathlib import Path

import pytest

import labpipe as lp
from labpipe.workflow import session as sessions
from pipelines.session import SETTINGS, open_session

VARIANT = '\n[variants.wide]\nbase = "drop"\nsphere = { radius = "12 ± 0.005 mm" }\n'


@pytest.fixture
def session(session_copy: Path) -> Path:
    path = session_copy / "session.toml"
    path.write_text(path.read_text("utf-8") + VARIANT, "utf-8")
    return session_copy


def test_a_variant_shares_results_with_its_base_and_is_shown_next_to_it(session: Path) -> None:
    opened = open_session(session)
    assert list(opened.experiments)[:2] == ["drop", "wide"]
    assert opened.experiments["wide"].changed == {"sphere.radius": ("9.525 ± 0.005 mm", "12 ± 0.005 mm")}
    rows = {row.stage: row.state for row in lp.plan(session, only="wide").rows if row.experiment == "wide"}
    shared = {"readings", "displacement", "bounces", "velocity", "repeats"}
    assert {stage for stage, state in rows.items() if state == "cached"} == shared
    assert lp.process(session, jobs=0).failures == ()
    page = lp.report(session, "wide").html
    assert "Variant of drop, with the same recordings" in page
    assert "sphere.radius 9.525 ± 0.005 mm → 12 ± 0.005 mm" in page
    found = lp.compare(session, jobs=0).rows
    base, own = (
        next(r for r in found if (r.experiment, r.quantity) == (n, "restitution, impact 1")) for n in ("drop", "wide")
    )
    assert base.measured == own.measured
    assert base.model != own.model
    beside = (session / "labpipe/beside-drop--wide.html").read_text("utf-8")
    assert "wide is a variant of drop" in beside
    assert "sphere.radius</td>" in beside
    assert 'href="beside-drop--wide.html"' in (session / "labpipe/compare.html").read_text("utf-8")


def test_a_recording_counts_once(session: Path) -> None:
    judged = {one.experiment: one for one in lp.verdict(session, jobs=0).experiments}
    assert not any("same bytes" in str(finding) or "two values" in str(finding) for finding in judged["drop"].findings)
    assert "All 2 experiments are believable" in (session / "labpipe/index.html").read_text("utf-8")
    assert {row.experiment for row in lp.sensitivity(session, "ball_drop")} == {"drop"}


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ('base = "dorp"', 1, '.base: there is no experiment "dorp"; did you mean "drop"?'),
        ('height = "1 mm"', 0, ".base: missing"),
        ('base = "drop"', 0, ": differs in no setting from drop"),
        ('kind = "dma"\nbase = "drop"', 1, ".kind: a variant is of the kind of its base"),
        ('base = "drop"\nheigth = "1 mm"', 2, '.heigth: unknown key; did you mean "height"?'),
        ('base = "drop"\nlaser = [\n"laser/drop_1.csv",\n"a.csv"]', 4, ".laser no. 2: there is no file"),
        ('base = "drop"\nsphere.material_file = "a.toml"', 2, ".sphere.material_file: there is no file"),
    ],
)
def test_a_wrong_variant_waits_alone_with_its_line(small_session: Path, text: str, line: int, message: str) -> None:
    before = (small_session / "session.toml").read_text("utf-8")
    found = sessions.load(small_session, SETTINGS, text=f"{before}\n[variants.a]\n{text}\n")
    assert set(found.experiments) == {"drop", "nbr"}
    first = before.count("\n") + 2
    assert any(one.startswith(f"session.toml:{first + line}: variants.a{message}") for one in found.waiting["a"])

"""The benchmark of the simulator: what is better must come out better; the peer is optional."""

import importlib.util

import pytest

from pipelines.bench import contact_peers, drop, impact_peer, indentation
from pipelines.bench.measure import OURS, THESIS, Suite


def by_name(suite: Suite) -> dict[str, float]:
    return {point.setting: point.error for point in suite.points}


@pytest.fixture(scope="module")
def drops() -> list[Suite]:
    return drop.run(True)


def test_drop_follows_its_tolerance_and_beats_the_thesis(drops: list[Suite]) -> None:
    first = by_name(drops[0])
    assert first["springs, rtol 1e-05"] < first["springs, rtol 1e-04"] < first["springs, rtol 1e-03"]
    assert first["springs, rtol 1e-04"] < 2e-5
    assert first["rings, rtol 1e-04"] < 5e-5
    theirs = [p.error for p in drops[0].points if p.group == THESIS]
    assert theirs == sorted(theirs, reverse=True)
    assert min(theirs) > 1e-3


def test_tings_equations_as_a_peer_follow_their_tolerance(drops: list[Suite]) -> None:
    coarse, fine = (p for p in drops[0].points if p.group == impact_peer.NAME)
    assert fine.error < 1e-7 < coarse.error < 5e-5


def test_the_train_is_right_by_default_and_wrong_by_the_thesis(drops: list[Suite]) -> None:
    ours = [p.error for p in drops[1].points if p.group == OURS]
    assert max(ours) < 3e-3
    assert min(p.error for p in drops[1].points if p.group == THESIS) == 1.0
    assert [p.setting for p in drops[1].points if p.is_default] == ["springs, rtol 1e-04"]


def test_indentation_converges_and_names_a_missing_peer() -> None:
    line, one, many = indentation.run(True)
    errors = by_name(line)
    assert errors["springs, 1024 strips"] < errors["springs, 256 strips"] < 2e-3
    for suite in (one, many):
        assert by_name(suite)["adaptive, rtol 1e-05"] < 3e-5
    has_peer = importlib.util.find_spec("tamaas") is not None
    assert has_peer != any("tamaas" in note for note in line.notes)


def test_the_peer_finds_westergaard() -> None:
    pytest.importorskip("tamaas", reason="the optional peer tamaas is not installed")
    assert indentation._line_error(contact_peers.line(256)) < 3e-3

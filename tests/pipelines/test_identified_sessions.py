"""Sessions of random truths: what is compared is what was recorded, and a wrong truth shows."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from labpipe.errors import InputError
from pipelines.rig.relaxations import Relaxation
from tests.pipelines import random_sessions
from tests.pipelines.identified_points import points
from tests.pipelines.identified_trial import Trial, session_trial, true_value
from tests.pipelines.random_sessions import KINDS, drawn


@pytest.fixture(scope="module")
def hold(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Trial]:
    """One short hold, recorded, processed and identified."""
    folder = tmp_path_factory.mktemp("random") / "session"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(random_sessions, "_HELD", Relaxation(depths=(0.1e-3,), hold=30.0))
        return folder, session_trial(drawn("hold", 0), folder)


@pytest.mark.slow
def test_everything_that_a_hold_leaves_unknown_is_compared(hold: tuple[Path, Trial]) -> None:
    trial = hold[1]
    assert trial.failure is None
    own = {"relaxation first touch", "relaxation tare"}
    roles = {"punch", "load cell", "filter", *own}
    assert set(trial.unknowns) == roles
    for role in roles:  # stated as uncertain as they are wrong
        assert abs(trial.unknowns[role].truth or 0.0) < 4
    known = [score for score in trial.moduli.values() if score is not None]
    assert len(known) >= 4
    assert max(abs(score.error) for score in known) < 4
    assert all(0 < score.bound < score.prior and score.u < score.prior for score in known)


@pytest.mark.slow
def test_a_hold_knows_its_forces_as_well_as_it_says(hold: tuple[Path, Trial]) -> None:
    """Chi square at the truth is 1 per number: no delay of the filter and no fall is noise."""
    (forces,) = hold[1].evidence.values()
    assert len(forces) >= 20
    assert 0.4 < float(np.mean(np.square(forces))) < 1.8
    assert np.abs(forces).max() < 4


@pytest.mark.slow
def test_a_wrong_truth_is_noticed(hold: tuple[Path, Trial]) -> None:
    """The same answer against a solid that is 10 % stiffer than what was recorded."""
    truth = drawn("hold", 0)
    harder = tuple(replace(e, strength=1.1 * e.strength) for e in truth.solid.elements)
    stiffer = replace(truth.solid, elements=harder, relaxed=1.1 * truth.solid.relaxed)
    trial = session_trial(replace(truth, solid=stiffer), hold[0])
    for name, score in trial.moduli.items():
        if score is not None and name.startswith("storage"):
            assert score.error < -3
    (forces,) = trial.evidence.values()
    assert np.median(forces) < -50


@pytest.mark.slow
def test_trials_are_counted_and_survive_a_file(hold: tuple[Path, Trial]) -> None:
    trial = hold[1]
    read = msgspec.json.decode(msgspec.json.encode(trial), type=Trial)
    failed = Trial("hold", 1, "skewed", False, failure="SourceError: lost")
    found = {p.setting: p for p in points([read, failed])}
    last = found["hold: verdict on E_relaxed"]
    assert (last.extra["truths"], last.extra["failed"]) == (2, 1)
    stiffness = found["hold, symmetric: storage modulus at 50%"]
    score = trial.moduli["storage modulus at 50%"]
    assert score is not None
    assert stiffness.error == pytest.approx(abs(score.error))
    assert stiffness.extra["uncertainty over bound, median"] == pytest.approx(score.u / score.bound)


@pytest.mark.nightly
def test_a_drop_is_compared_with_all_that_it_leaves_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(random_sessions, "_FALLS", 5.5)  # three touches
    monkeypatch.setattr(random_sessions, "_REPEATS", 1)
    trial = session_trial(drawn("drop", 0), tmp_path / "session")
    roles = {"mass", "radius", "drop height", "drop trigger"}
    assert set(trial.unknowns) == roles
    assert max(abs(s.truth or 0.0) for s in trial.unknowns.values()) < 4
    known = [score for score in trial.moduli.values() if score is not None]
    assert len(known) >= 4
    assert max(abs(score.error) for score in known) < 4
    assert set(trial.evidence) == {"drop: time of touch", "drop: contact duration"}
    assert max(abs(z) for values in trial.evidence.values() for z in values) < 5


def test_kinds_and_seeds_give_truths_of_their_own() -> None:
    truths = [drawn(kind, number) for kind in KINDS for number in range(8)]
    assert len({t.solid.relaxed for t in truths}) == len({t.seed for t in truths}) == 24
    drops = [t for t in truths if t.kind == "drop"]
    assert [t.seed % 2 for t in drops if t.is_on_plate] == [1, 0]
    assert all(1.4e-3 < t.mean_height < 10.1e-3 for t in drops)
    assert np.isinf(random_sessions.RIGID.mass)
    with pytest.raises(InputError, match='no kind "steel"'):
        drawn("steel", 0)


def test_an_unknown_without_a_truth_is_refused() -> None:
    with pytest.raises(InputError, match="truth of the unknown colour is not known"):
        true_value("colour", drawn("drop", 0), None, [])  # type: ignore[arg-type]


def test_a_plate_is_another_one_than_stated() -> None:
    truth = drawn("drop", 3)
    assert truth.is_on_plate
    mass = true_value("mass of the plate", truth, None, ["drop"])  # type: ignore[arg-type]
    assert mass == truth.rig.floor.mass != 30.0

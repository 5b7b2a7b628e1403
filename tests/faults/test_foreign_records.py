"""Sound records in the wrong place."""

import sys
from pathlib import Path

import pytest

from labpipe import files
from labpipe.workflow import provenance, runner
from tests.labpipe.workflow import toy_laboratory as toy


@pytest.fixture
def processed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> toy.Session:
    monkeypatch.setitem(sys.modules, "toy_laboratory", toy)
    monkeypatch.setattr(provenance, "git_state", lambda folder: None)
    session = toy.make_session(tmp_path / "session", toy.SMALL)
    run(session)
    return session


def run(session: toy.Session) -> None:
    result = runner.run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0)
    assert result.exit_code == 0, [o.message for o in result.failures]


FOREIGN = {"a list of lists": files.seal([["a", "b"], ["c"]]), "deep": b"[" * 100_000}


@pytest.mark.parametrize("what", [*FOREIGN, "another record"])
def test_a_sealed_record_in_the_wrong_place_is_not_believed(processed: toy.Session, what: str) -> None:
    """Copied over the index, the last keys, and a result's record: all are made again."""
    before = toy.contents(processed)
    store = processed.folder / "store"
    records = sorted(store.glob("??/*.json"))
    data = FOREIGN.get(what) or records[0].read_bytes()
    for place in (store / "index.json", *store.glob("latest/*.json"), *records[1:]):
        place.write_bytes(data)
    run(processed)
    after = {n: d for n, d in toy.contents(processed).items() if "quarantine" not in n}
    assert after == before

"""A stored result is whole or is made again; nothing damaged is ever returned."""

from pathlib import Path

import numpy as np
import pytest
import toy_laboratory as toy
import xarray as xr

from labpipe import files
from labpipe.errors import StoreError
from labpipe.files import HashIndex
from labpipe.workflow.graph import TaskId
from labpipe.workflow.plan import plan
from labpipe.workflow.runner import run
from labpipe.workflow.store import Caught, Store, key_of

INGREDIENTS = {"stage": "read", "version": 1, "parameters": {"gain": 1.5, "name": "é"}}
KEY = key_of(INGREDIENTS)


def dataset(value: float = 1.0) -> xr.Dataset:
    variable = ("time", np.full(500, value), {"units": "m", "long_name": "z"})
    return xr.Dataset({"z": variable})


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """A store with one result in it."""
    made = Store(tmp_path)
    made.write(INGREDIENTS, dataset(), warnings=(Caught("UserWarning", "short", 2),), work={"n": 3})
    return made


def object_path(store: Store, ending: str) -> Path:
    return store.root / KEY[:2] / f"{KEY}{ending}"


def test_a_result_comes_back_with_its_record(store: Store) -> None:
    assert store.state(KEY) == "stored"
    found = store.read(KEY)
    assert isinstance(found, xr.Dataset)
    assert found.identical(dataset())
    record = store.record(KEY)
    assert record is not None
    assert record.ingredients == INGREDIENTS
    assert record.warnings == (Caught("UserWarning", "short", 2),)
    assert record.work == {"n": 3}
    assert record.size == object_path(store, ".nc").stat().st_size
    object_path(store, ".json").unlink()
    assert store.state(KEY) == "absent"


def test_a_result_that_is_written_while_it_is_looked_for_is_not_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = Store(tmp_path)

    def too_early(key: str) -> None:
        made.write(INGREDIENTS, dataset())

    with monkeypatch.context() as change:
        change.setattr(made, "record", too_early)
        assert made.state(KEY) == "absent"
        made.quarantine(KEY)
        with pytest.raises(StoreError, match="no whole result"):
            made.read(KEY)
    assert made.state(KEY) == "stored"


DAMAGES = {
    "truncated": (".nc", lambda data: data[: len(data) // 2]),
    "last bit": (".nc", lambda data: data[:-1] + bytes([data[-1] ^ 1])),
    "truncated record": (".json", lambda data: data[:-5]),
    "unsealed record": (".json", lambda data: b'{"format": 1}'),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_noticed_set_aside_and_repaired(store: Store, damage: str) -> None:
    ending, change = DAMAGES[damage]
    path = object_path(store, ending)
    path.write_bytes(change(path.read_bytes()))
    assert store.state(KEY) == "damaged"
    with pytest.raises(StoreError, match="run again"):
        store.read(KEY)
    assert store.state(KEY) == "absent"
    names = {p.suffix for p in (store.root / "quarantine").iterdir()}
    assert names == {".nc", ".json"}
    store.write(INGREDIENTS, dataset())
    assert store.state(KEY) == "stored"


def test_damage_that_no_time_stamp_shows_is_found_when_the_result_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = toy.make_session(tmp_path)
    run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0)
    before = toy.contents(session)
    made = plan(session, toy.STAGES)
    key = made.keys[TaskId("nbr", "scale", "laser/r3.txt")].value
    assert key is not None
    path = session.folder / "store" / key[:2] / f"{key}.nc"
    index_digest, good = HashIndex.digest, files.digest(path)
    path.write_bytes(path.read_bytes()[:-1] + bytes([path.read_bytes()[-1] ^ 1]))
    # A disk that loses bits does not change a time stamp: the index still says what it knew.
    monkeypatch.setattr(HashIndex, "digest", lambda s, p: good if Path(p) == path else index_digest(s, p))
    (session.folder / "reports" / "nbr.html").unlink()
    page = made.keys[TaskId("nbr", "page")].value
    assert page is not None
    Store(session.folder).quarantine(page)
    assert [str(row.task) for row in plan(session, toy.STAGES).to_run] == ["nbr/page"]
    # The page needs the damaged result: it is set aside, and made again by the next run.
    result = run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0)
    assert [(str(o.task), o.exit_code) for o in result.failures] == [("nbr/page", 4)]
    result = run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0)
    assert {str(o.task) for o in result.outcomes if o.state == "done"} == {"nbr/scale [laser/r3.txt]", "nbr/page"}
    after = toy.contents(session)
    assert {n: d for n, d in after.items() if "quarantine" not in n} == before

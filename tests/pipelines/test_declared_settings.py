"""A stage reads no setting that is not part of its key: another value would not be computed anew."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

import labpipe as lp
from labpipe.workflow import _worker

pytestmark = pytest.mark.slow


class _Watched:
    """Settings that tell which of their fields are read beside those that a stage declares."""

    def __init__(self, settings: msgspec.Struct, declared: set[str], read: set[str], at: str = "") -> None:
        self.__dict__.update(_settings=settings, _declared=declared, _read=read, _at=at)

    def __getattr__(self, name: str) -> Any:
        value, place = getattr(self._settings, name), f"{self._at}{name}"
        if name not in type(self._settings).__struct_fields__ or place in self._declared:
            return value
        if isinstance(value, msgspec.Struct) and not hasattr(value, "si"):
            return _Watched(value, self._declared, self._read, f"{place}.")
        self._read.add(place)
        return value


@pytest.mark.parametrize("sample", ["demo", "films", "indentation", "plate", "static"])
def test_stages_read_only_what_they_declare(sample: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    undeclared: dict[str, set[str]] = {}
    called = _worker._import

    def watched(task: Any) -> Callable[..., Any]:
        function, stage = called(task), task.stage
        if "*" in stage.parameters:
            return function
        files = {text.partition(":")[2].partition("/")[0] for text in stage.inputs if ":" in text}
        read = undeclared.setdefault(stage.function, set())

        def call(*results: Any, settings: msgspec.Struct, **others: Any) -> Any:
            return function(*results, settings=_Watched(settings, {*stage.parameters, *files}, read), **others)

        return call

    monkeypatch.setattr(_worker, "_import", watched)
    lp.sample(sample, tmp_path / sample)
    done = lp.process(tmp_path / sample, jobs=0)
    assert done.failures == ()
    assert undeclared
    assert {name: read for name, read in undeclared.items() if read} == {}

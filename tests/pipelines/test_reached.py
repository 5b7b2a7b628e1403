"""Whatever of ours runs in a stage is among the code by which its result is keyed."""

import shutil
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

from labpipe.workflow import _worker, code
from labpipe.workflow._definitions import OURS
from labpipe.workflow.tasks import Task
from pipelines import process

ROOT = Path(code.__file__).parents[2]
_IMPORTING = {"lazily"}
"""The way in which a face imports its names on first use; where a name leads to is followed."""


def ran_in_stages(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, set[tuple[str, str]]]:
    """Process a session and return module and name of every function of ours, by stage."""
    codes: dict[str, set[CodeType]] = defaultdict(set)
    imported = _worker._import

    def watched(task: Task) -> Callable[..., Any]:
        function = imported(task)

        def look(frame: FrameType, event: str, argument: object) -> None:
            if event == "call":
                codes[task.stage.function].add(frame.f_code)

        def call(*arguments: Any, **keywords: Any) -> Any:
            sys.setprofile(look)
            try:
                return function(*arguments, **keywords)
            finally:
                sys.setprofile(None)

        return call

    monkeypatch.setattr(_worker, "_import", watched)
    assert process.process(folder, jobs=0).exit_code == 0
    return {
        function: {(_module(found), found.co_qualname) for found in ours if _module(found)}
        for function, ours in codes.items()
    }


def _module(found: CodeType) -> str:
    place = Path(found.co_filename)
    if place.suffix != ".py" or not place.is_relative_to(ROOT):
        return ""
    parts = place.relative_to(ROOT).with_suffix("").parts
    if parts[0] not in OURS:  # an environment within the checkout
        return ""
    return ".".join(parts).removesuffix(".__init__")


@pytest.mark.slow
def test_what_runs_is_what_is_reached(small_session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(small_session, tmp_path / "session")
    ran = ran_in_stages(tmp_path / "session", monkeypatch)
    assert len(ran) > 10
    for function, calls in ran.items():
        reached = code.Reached(code.Code(), set(OURS))
        reached.follow([function])
        for module, called in calls:
            names = reached.found.get(module, {})
            name = called.partition(".")[0]
            # The body of a module or class runs when it is imported.
            is_body = isinstance(getattr(sys.modules.get(module), called, None), type)
            is_read = is_body or name.startswith("<") or name in _IMPORTING
            assert is_read or {name, f"{name}()"} & names.keys(), (function, module, called)

"""Results of earlier code: made again, or kept and marked as such; and how long that takes."""

import importlib
import json
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import msgspec
import pytest

from labpipe.workflow import code
from labpipe.workflow.fields import File
from labpipe.workflow.graph import Stage, TaskId
from labpipe.workflow.plan import Plan, plan
from labpipe.workflow.results import Results, RunResult
from labpipe.workflow.runner import run
from labpipe.workflow.session import Session, load
from labpipe.workflow.store import LOG
from tests.labpipe.workflow.sources import forget

MODULE = """
from pathlib import Path

import numpy as np
import xarray as xr

from {name}.helper import factor


def dataset(value):
    return xr.Dataset({{"z": ((), value, {{"units": "m", "long_name": "position"}})}})


def read(path, *, settings):
    return dataset(factor() * float(path.read_text()))


def double(found, *, settings):
    return dataset(2 * float(found["z"]))


def page(found, doubled, *, settings, context):
    kept = [f"{{stage}}: {{reason}}" for stage, reason in context.kept.items()]
    return f"<!doctype html>{{float(found.z)}} {{float(doubled.z)}} kept {{kept}}"
"""


class Weight(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    file: File


class Laboratory:
    """A package of stages whose code can change, and a session of them."""

    def __init__(self, folder: Path, name: str, forget: Callable[[], None]) -> None:
        self.forget = forget
        self.name, self.package = name, folder / name
        self.package.mkdir()
        (self.package / "__init__.py").write_text("")
        (self.package / "steps.py").write_text(MODULE.format(name=name))
        self.write(1)
        home = f"{name}.steps"
        self.stages = {
            "weight": (
                Stage("read", f"{home}:read", ("file:file",)),
                Stage("double", f"{home}:double", ("read",)),
                Stage("report", f"{home}:page", ("read", "double"), output="page", context=True),
            )
        }
        root = folder / "session"
        root.mkdir()
        (root / "w.txt").write_text("3")
        (root / "session.toml").write_text('labpipe = 1\n[experiments.a]\nkind = "weight"\nfile = "w.txt"\n')
        self.session: Session = load(root, {"weight": Weight})

    def write(self, factor: object) -> None:
        """Change the code, and forget what is loaded of it as a new process would."""
        (self.package / "helper.py").write_text(f"def factor():\n    return {factor}\n")
        for name in [n for n in sys.modules if n.partition(".")[0] == self.name]:
            del sys.modules[name]
        importlib.invalidate_caches()
        self.forget()

    def run(self, keep: bool | None = False) -> dict[str, str]:
        return {o.stage: o.state for o in self.result(keep).outcomes}

    def result(self, keep: bool | None = False) -> RunResult:
        found = run(self.session, self.stages, jobs=0, keep=keep)
        assert found.exit_code == 0, [o.message for o in found.failures]
        return found

    def plan(self, keep: bool | None = False) -> dict[str, tuple[str, str]]:
        made = plan(self.session, self.stages, keep=keep)
        return {row.stage: (row.state, row.reason) for row in made.rows}

    def value(self, stage: str = "double") -> float:
        return float(Results(plan(self.session, self.stages, keep=None)).result("a", stage)["z"])

    @property
    def page(self) -> str:
        return (self.session.folder / "reports/a.html").read_text()


@pytest.fixture
def laboratory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Laboratory]:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # the code changes within a second
    monkeypatch.syspath_prepend(tmp_path)
    name = f"laboratory_{abs(hash(request.node.name))}"
    made = Laboratory(tmp_path, name, partial(forget, monkeypatch))
    made.run()
    yield made
    made.write(1)


def test_changed_code_is_named_and_runs_again(laboratory: Laboratory) -> None:
    assert laboratory.value() == 6.0
    laboratory.write(10)
    found = laboratory.plan()
    assert found["read"] == ("will run", f"code changed: {laboratory.name}")
    assert found["double"] == ("waits", f"code changed: {laboratory.name}; upstream read will run")
    laboratory.run()
    assert laboratory.value() == 60.0
    assert {state for state, _ in laboratory.plan().values()} == {"cached"}


def test_a_kept_result_is_marked_on_every_page_and_keeps_its_key(laboratory: Laboratory) -> None:
    def made(keep: bool) -> Plan:
        return plan(laboratory.session, laboratory.stages, keep=keep)

    read, double = TaskId("a", "read"), TaskId("a", "double")
    assert laboratory.page.endswith("kept []")
    before = made(keep=False).keys[read].value
    laboratory.write(10)
    why = f"code changed: {laboratory.name}"
    found = laboratory.plan(keep=True)
    assert found["read"] == found["double"] == ("kept", why)
    assert found["report"] == ("will run", f"{why}; kept results of earlier code changed")
    assert laboratory.run(keep=True) == {"read": "kept", "double": "kept", "report": "done"}
    assert laboratory.page.endswith(f"3.0 6.0 kept ['read: {why}', 'double: {why}']")
    assert laboratory.run(keep=True) == {"read": "kept", "double": "kept", "report": "cached"}
    assert made(keep=True).keys[read].value == before
    assert {task for task, key in made(keep=True).of("a").keys.items() if key.kept} == {read, double}
    assert not any(key.kept for key in made(keep=False).keys.values())


def test_what_was_kept_is_read_by_others_until_the_code_changes_again(laboratory: Laboratory) -> None:
    laboratory.write(10)
    assert laboratory.plan(keep=None)["read"][0] == "will run"
    laboratory.run(keep=True)
    assert laboratory.plan(keep=None)["read"][0] == "kept"
    assert laboratory.value("read") == 3.0
    laboratory.write(100)
    assert laboratory.plan(keep=None)["read"][0] == laboratory.plan()["read"][0] == "will run"
    assert laboratory.run() == {"read": "done", "double": "done", "report": "done"}
    assert laboratory.page.endswith("300.0 600.0 kept []")
    laboratory.write(10)
    (laboratory.session.root / "w.txt").write_text("4")  # more than the code has changed: nothing is kept
    assert set(laboratory.run(keep=True).values()) == {"done"}
    assert laboratory.value() == 80.0


def test_a_syntax_error_fails_the_stages_that_reach_it(laboratory: Laboratory) -> None:
    laboratory.write("(")
    failed = {o.stage: o.message for o in run(laboratory.session, laboratory.stages, jobs=0).failures}
    assert "cannot be imported" in failed["read"]
    assert "helper.py, line 2" in failed["read"]


def test_a_process_with_other_files_of_the_program_computes_nothing(
    laboratory: Laboratory, monkeypatch: pytest.MonkeyPatch
) -> None:
    laboratory.write(10)
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(code, "behind", lambda name: {laboratory.name: "another"})
        failed = {o.stage: o.message for o in run(laboratory.session, laboratory.stages, jobs=0).failures}
    assert "or are others on this machine; start it again" in failed["read"]


def test_the_time_of_the_last_run_is_the_estimate(laboratory: Laboratory) -> None:
    laboratory.write(10)
    log = laboratory.session.folder / LOG
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    lines = [line | {"seconds": 60.0} if line.get("state") == "done" else line for line in lines]
    log.write_text("\n".join(map(json.dumps, lines)) + "\n")
    assert plan(laboratory.session, laboratory.stages).summary == "3 of 3 steps would run, about 3 min (last time)"
    log.write_text("\n".join(json.dumps(line) for line in lines if line.get("stage") != "read"))
    assert plan(laboratory.session, laboratory.stages).estimate == "about 2 min (last time, without 1 that never ran)"
    log.unlink()
    assert plan(laboratory.session, laboratory.stages).estimate == ""

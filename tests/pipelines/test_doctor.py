"""What `doctor` finds: names that clash, versions that are too old, broken sessions."""

import importlib.metadata
import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from pipelines.commands import system
from pipelines.session import _doctor


def run(folder: Path, *options: str) -> tuple[int, str]:
    done = CliRunner().invoke(system.doctor, [str(folder), *options])
    return done.exit_code, done.output


def test_another_distribution_with_a_package_of_our_name_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    owners = {"instruments": ["labpipe", "instrumentkit"], "numpy": ["numpy"]}
    monkeypatch.setattr(importlib.metadata, "packages_distributions", lambda: owners)
    code, text = run(tmp_path)
    assert code == 5
    assert "the distribution instrumentkit also installs the package `instruments`" in text


def test_a_library_that_is_too_old_or_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_doctor, "_versions", lambda: {"numpy": "1.26.4", "scipy": "missing"})
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: ["numpy>=2.1", "scipy>=1.15"])
    code, text = run(tmp_path, "--json")
    assert code == 5
    problems = json.loads(text)["problems"]
    assert "scipy is not installed; pip install scipy" in problems
    assert any("numpy is 1.26.4, needed is 2.1 or newer" in p for p in problems)


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(_doctor.files, "write_bytes", refuse)
    code, text = run(tmp_path)
    assert code == 5
    assert "cannot write here" in text


def test_a_broken_session_is_exit_3_and_its_store_is_read_all_the_same(session_copy: Path) -> None:
    path = session_copy / "session.toml"
    path.write_text(path.read_text("utf-8").replace("[experiments.drop]", "[experiments.drop]\nx=1"))
    code, text = run(session_copy)
    assert code == 3
    assert "unknown key" in text
    victim = next((session_copy / "labpipe/store").glob("??/*.nc"))
    victim.write_bytes(victim.read_bytes()[:-10])
    code, text = run(session_copy)
    assert code == 4
    assert "the next `labpipe process` makes it again" in text

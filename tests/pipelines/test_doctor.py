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


def test_clashes_old_and_missing_libraries_and_a_folder_without_permission_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    owners = {"instruments": ["labpipe", "instrumentkit"], "numpy": ["numpy"]}

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(importlib.metadata, "packages_distributions", lambda: owners)

    def version(name: str) -> str:
        if name == "numpy":
            return "1.26.4"
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: ["numpy>=2.1", "scipy>=1.15"])
    monkeypatch.setattr(_doctor.files, "write_bytes", refuse)
    code, text = run(tmp_path, "--json")
    assert code == 5
    told = "\n".join(json.loads(text)["problems"])
    for words in (
        "the distribution instrumentkit also installs the package `instruments`",
        "scipy is not installed; pip install scipy",
        "numpy is 1.26.4, needed is 2.1 or newer",
        "cannot write here",
    ):
        assert words in told


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

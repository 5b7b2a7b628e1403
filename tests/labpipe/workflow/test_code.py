"""Code behind a result: the files of the packages that a stage belongs to, whole, and nothing else of ours."""

import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from labpipe.errors import InstallationError
from labpipe.workflow import code
from pipelines.experiments import KINDS
from tests.labpipe.workflow.sources import forget

ROOT = Path(__file__).parents[3]
DROP = "toys.kinds.drop.steps:page"
FILES = (
    "toys/__init__.py",
    "toys/kinds/__init__.py",
    "toys/kinds/shared/inside/words.py",
    "toys/kinds/drop/steps.py",
    "toys/kinds/drop/style.css",
    "toys/kinds/drop/notes.md",
    "toys/documentation/guide.txt",
    "toys/kinds/plate/steps.py",
)


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("a = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    forget(monkeypatch)
    yield tmp_path
    forget(monkeypatch)


@pytest.mark.parametrize(
    ("name", "package"),
    [
        ("toys/kinds/drop/style.css", "toys.kinds.drop"),
        ("toys/kinds/drop/notes.md", ""),
        ("toys/documentation/guide.txt", ""),
        ("toys/kinds/shared/inside/words.py", "toys.kinds.shared.inside"),
        ("toys/__init__.py", "toys"),
        ("toys/kinds/plate/steps.py", ""),
    ],
)
def test_a_changed_file_counts_for_the_functions_of_its_package(
    toys: Path, monkeypatch: pytest.MonkeyPatch, name: str, package: str
) -> None:
    before = code.behind(DROP)
    (toys / name).write_text("a = 1  # as before\n")
    forget(monkeypatch)
    after = code.behind(DROP)
    assert {name for name in after if after[name] != before[name]} == {package} - {""}


def test_every_kind_has_the_foundations_itself_and_what_is_shared() -> None:
    for kind in KINDS.values():
        for stage in kind.stages:
            packages = code.behind(stage.function)
            assert {"labpipe", "labpipe.contact", "instruments.keyence", "calibration"} <= set(packages)
            assert "pipelines.experiments.shared" in packages
            others = {f"pipelines.experiments.{other}" for other in KINDS} & set(packages)
            assert others <= {f"pipelines.experiments.{kind.name}"}


def test_a_plug_in_that_reads_files_counts_for_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    forget(monkeypatch)
    assert "toy_vibrometer" not in code.behind(DROP)
    monkeypatch.syspath_prepend(ROOT / "tests/plugins/toy_instrument")
    forget(monkeypatch)
    assert "toy_vibrometer" in code.behind(DROP)
    monkeypatch.undo()
    forget(monkeypatch)


def test_a_file_changed_under_a_running_program_is_refused(toys: Path) -> None:
    known = code.behind(DROP)
    code.refuse_changed(DROP, known)
    (toys / "toys/kinds/drop/steps.py").write_text("a = 2\n")
    with pytest.raises(InstallationError, match="was changed while this program ran"):
        code.refuse_changed(DROP, known)

"""Machine code of kernels: kept for the present source, and no run fails where it cannot be kept."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from labpipe import installation

INNER = "from numba import njit\n\n\n@njit\ndef twice(x):\n    return 2.0 * x\n"
OUTER = (
    "from numba import njit\n"
    "from labpipe.inner import twice\n"
    "from labpipe.constants import FACTOR\n\n\n"
    "@njit(cache=True)\ndef found(x):\n    return FACTOR * twice(x)\n"
)
RUN = (
    "import sys; from pathlib import Path; sys.path.insert(0, {source!r})\n"
    "from labpipe.installation import keep_compiled_code\n"
    "keep_compiled_code(Path({folder!r}))\n"
    "import importlib.util, types\n"
    "import labpipe\n"
    "labpipe.__path__.append({folder!r})\n"
    "from labpipe.outer import found\n"
    "print(found(1.0), sum(found.stats.cache_hits.values()))"
)


@pytest.fixture
def kernels(tmp_path: Path) -> Path:
    folder = tmp_path / "labpipe"
    folder.mkdir()
    files = {"inner": INNER, "outer": OUTER, "constants": "FACTOR = 1.0\n", "other": "A = 1\n"}
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def found(folder: Path) -> list[str]:
    """The value of the kernel in a new process, and the hits of its cache."""
    source = str(Path(installation.__file__).parents[1])
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder.parent / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    script = RUN.format(source=source, folder=str(folder))
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_a_kernel_is_compiled_again_when_another_module_in_it_has_changed(kernels: Path) -> None:
    assert [found(kernels), found(kernels)] == [["2.0", "0"], ["2.0", "1"]]
    (kernels / "other.py").write_text("A = 2\n")
    assert found(kernels) == ["2.0", "1"]
    (kernels / "inner.py").write_text(INNER.replace("2.0", "3.0"))
    assert found(kernels) == ["3.0", "0"]
    (kernels / "constants.py").write_text("FACTOR = 10.0\n")
    assert found(kernels) == ["30.0", "0"]


def placed(monkeypatch: pytest.MonkeyPatch, kernels: Path) -> Path:
    """Where numba would keep the code."""
    installation.keep_compiled_code(kernels)
    monkeypatch.setitem(os.environ, "NUMBA_CACHE_DIR", chosen := os.environ["NUMBA_CACHE_DIR"])
    return Path(chosen)


def test_the_folder_belongs_to_the_user_and_is_inherited(
    kernels: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)  # type: ignore[arg-type]
    monkeypatch.delitem(sys.modules, "numba")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(installation, "cache_folder", lambda: tmp_path / "user")
    first = placed(monkeypatch, kernels)
    assert first.parent == tmp_path / "user"
    assert placed(monkeypatch, kernels) == first
    (kernels / "inner.py").write_text("# njit\n")
    assert placed(monkeypatch, kernels).parent == first.parent
    assert placed(monkeypatch, kernels) != first


@pytest.mark.parametrize("how", ["a file", "no permission", "full"])
def test_where_nothing_can_be_kept_a_temporary_folder_is_taken(
    kernels: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)  # type: ignore[arg-type]
    monkeypatch.delitem(sys.modules, "numba")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "stated"))
    if how == "a file":
        (tmp_path / "stated").write_text("no folder")
    elif how == "no permission":
        monkeypatch.setattr(os, "access", lambda *_: False)
    else:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(1, 1, 0))
    assert placed(monkeypatch, kernels).parent.name.startswith("labpipe-")

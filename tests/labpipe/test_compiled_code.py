"""Machine code of kernels: kept for the present source, and no run fails where it cannot be kept."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from labpipe import compilation

INNER = "from labpipe.compilation import inner\n\n\n@inner()\ndef twice(x):\n    return 2.0 * x\n"
OUTER = (
    "from labpipe.compilation import compiled\n"
    "from kernels.inner import twice\n"
    "from kernels.constants import FACTOR\n\n\n"
    "@compiled()\ndef found(x):\n    return FACTOR * twice(x)\n"
)
RUN = "from kernels.outer import found; print(found(1.0), sum(found.stats.cache_hits.values()))"


@pytest.fixture
def kernels(tmp_path: Path) -> Path:
    folder = tmp_path / "kernels"
    folder.mkdir()
    files = {"inner": INNER, "outer": OUTER, "constants": "FACTOR = 1.0\n", "other": "A = 1\n"}
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def found(folder: Path) -> list[str]:
    """The value of the kernel in a new process, and the hits of its cache."""
    source = str(Path(compilation.__file__).parents[1])
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(folder.parent / "cache"),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONPATH": os.pathsep.join([source, str(folder.parent)]),
    }
    done = subprocess.run([sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.slow
def test_a_kernel_is_compiled_again_when_another_module_in_it_has_changed(kernels: Path) -> None:
    assert found(kernels) == ["2.0", "0"]
    (kernels / "other.py").write_text("A = 2\n")
    assert found(kernels) == ["2.0", "1"]
    (kernels / "inner.py").write_text(INNER.replace("2.0", "3.0"))
    assert found(kernels) == ["3.0", "0"]
    (kernels / "constants.py").write_text("FACTOR = 10.0\n")
    assert found(kernels) == ["30.0", "0"]


@pytest.mark.parametrize("how", ["stated", "a file", "no permission", "full"])
def test_where_nothing_can_be_kept_a_temporary_folder_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    stated = tmp_path / "stated"
    if how == "a file":
        stated.write_text("no folder")
    elif how == "no permission":
        monkeypatch.setattr(os, "access", lambda *_: False)
    elif how == "full":
        monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(1, 1, 0))
    found = compilation.place_for_code(str(stated))
    assert found == stated if how == "stated" else found.name.startswith("labpipe-")

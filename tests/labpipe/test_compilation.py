"""Where numba cannot keep its code: compiled again, said once, and the same answer."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from labpipe.compilation import _warn, compiled
from labpipe.imaging.dic._spline import prefilter


def _with_kernels_of(folder: Path) -> dict[str, str]:
    """Return the environment of a Python that finds modules in a folder and keeps compiled code there alone."""
    search = os.pathsep.join([str(folder), *sys.path])
    return os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": search}


@pytest.mark.slow
def test_no_place_for_compiled_code_is_said_once_and_survived(tmp_path: Path) -> None:
    """The folder of the cache would have to be made below a file: impossible for any user."""
    (tmp_path / "cache").write_text("no folder")
    (tmp_path / "labpipe_kernel.py").write_text(
        "from labpipe.compilation import compiled, part\n"
        "@part()\ndef half(x):\n    return x / 2.0\n"
        "@compiled()\ndef found(x):\n    return half(x) + 1.0\n"
    )
    program = (
        "import json, warnings\n"
        "import numpy as np\n"
        "with warnings.catch_warnings(record=True) as caught:\n"
        "    warnings.simplefilter('always')\n"
        "    from labpipe_kernel import found\n"
        "    from labpipe.imaging.dic._spline import prefilter\n"
        "image = np.random.default_rng(1).uniform(size=(12, 9)).astype(np.float32)\n"
        "print(json.dumps([found(3.0), prefilter(image, 3).tolist(), [str(w.message) for w in caught]]))\n"
    )
    environment = _with_kernels_of(tmp_path) | {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"}
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    found, coefficients, (said,) = json.loads(run.stdout)
    image = np.random.default_rng(1).uniform(size=(12, 9)).astype(np.float32)
    assert found == 2.5
    np.testing.assert_array_equal(np.array(coefficients, np.float32), prefilter(image, 3))
    assert said.startswith("compiled code cannot be kept")
    assert "no locator available" in said
    assert "NUMBA_CACHE_DIR" in said


@pytest.mark.parametrize("decorator", ["compiled", "part"])
def test_a_kernel_is_compiled_again_when_one_that_it_calls_has_changed(tmp_path: Path, decorator: str) -> None:
    folder = tmp_path / "labpipe_kernels"
    folder.mkdir()
    head = f"from labpipe.compilation import {', '.join({'compiled', decorator})}\n"
    outer = (
        "from labpipe_kernels.within import FACTOR, twice\n@compiled()\ndef found(x):\n    return FACTOR * twice(x)\n"
    )
    (folder / "outer.py").write_text(head + outer)
    program = (
        "from labpipe.compilation import is_missing; from labpipe_kernels.outer import found;"
        "print(is_missing(found), found(1.0), sum(found.stats.cache_hits.values()))"
    )
    environment = _with_kernels_of(tmp_path) | {"PYTHONDONTWRITEBYTECODE": "1"}
    run = [sys.executable, "-c", program]
    printed = []
    for factor in (1.0, None, 10.0):
        if factor is not None:
            within = f"FACTOR = {factor}\n@{decorator}()\ndef twice(x):\n    return {2 * factor} * x\n"
            (folder / "within.py").write_text(head + within)
        done = subprocess.run(run, env=environment, capture_output=True, text=True, check=True)
        printed.append(done.stdout.split())
    assert printed == [["True", "2.0", "0"], ["False", "2.0", "1"], ["True", "200.0", "0"]]
    stored = {path.name.split(".")[1].partition("-")[0] for path in (tmp_path / "cache").rglob("*.nbc")}
    assert stored == ({"found", "twice"} if decorator == "compiled" else {"found"})


def test_a_release_of_numba_with_unknown_insides_compiles_each_function_by_itself(tmp_path: Path) -> None:
    (tmp_path / "labpipe_kernel.py").write_text(
        "from labpipe.compilation import compiled, inner\n"
        "@inner()\ndef half(x):\n    return x / 2.0\n"
        "@compiled()\ndef found(x):\n    return half(x) + 1.0\n"
    )
    program = (
        "import sys, numba; numba.version_info = numba.version_info._replace(short=(99, 0));"
        "from labpipe_kernel import found; print(found(3.0), 'labpipe._linked' in sys.modules)"
    )
    environment = _with_kernels_of(tmp_path)
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["2.5", "False"]


def test_of_processes_that_need_a_kernel_at_once_one_compiles_it(tmp_path: Path) -> None:
    (tmp_path / "labpipe_kernel.py").write_text(
        "from labpipe.compilation import compiled\n"
        "@compiled()\n"
        "def found(x):\n"
        "    total = 0.0\n"
        "    for i in range(int(x)):\n"
        "        total += (x - i) ** 3 if i % 2 else i / (x + i)\n"
        "    return total\n"
    )
    program = (
        "import sys; from labpipe_kernel import found; print(flush=True); sys.stdin.readline();"
        "found(3.0); print(sum(found.stats.cache_misses.values()))"
    )
    environment = _with_kernels_of(tmp_path)
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    running = [subprocess.Popen([sys.executable, "-c", program], env=environment, **pipes) for _ in range(3)]
    for one in running:
        one.stdout.readline()  # all have loaded the compiler
    for one in running:
        one.stdin.write("\n")
        one.stdin.flush()
    assert sorted(one.communicate()[0] for one in running) == ["0\n", "0\n", "1\n"]


def test_a_full_disk_is_said_and_survived(monkeypatch: pytest.MonkeyPatch) -> None:
    """Code is stored at the first call, and that may fail after the import did not."""

    def full(*_: object) -> None:
        raise OSError(28, "no space left on device")

    monkeypatch.setattr(numba.core.caching.Cache, "save_overload", full)
    _warn.cache_clear()

    @compiled()
    def doubled(x: float) -> float:
        return 2.0 * x

    with pytest.warns(UserWarning, match="no space left on device") as caught:
        assert doubled(3.0) == 6.0
    assert len(caught) == 1

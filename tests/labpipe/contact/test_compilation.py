"""Where numba cannot keep or load its code: slower, said, and the same answer."""

import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labpipe.contact import drop
from labpipe.contact.impact import _bounce_compiled
from labpipe.materials import Prony
from tests.labpipe.without_cache import printed_without_cache

SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
BODY: dict[str, Any] = {"radius": 9.525e-3, "mass": 0.505, "height": 1.5e-3, "duration": 0.022}
_PROGRAM = """
import warnings
from labpipe.contact import drop
from labpipe.materials import Prony
solid = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    found = drop(solid, 9.525e-3, 0.505, 1.5e-3, 0.022)
print(f"{float(found.restitution[0]):.12f}")
print(*(str(w.message) for w in caught), sep="|")
"""


@pytest.fixture(scope="module")
def expected() -> float:
    return float(drop(SLS, **BODY).restitution[0])


@pytest.mark.slow
def test_no_place_for_compiled_code_is_said_and_survived(tmp_path: Path, expected: float) -> None:
    restitution, said = printed_without_cache(_PROGRAM, tmp_path).splitlines()
    assert float(restitution) == pytest.approx(expected, abs=1e-9)
    assert "no locator available" in said
    assert "NUMBA_CACHE_DIR" in said
    assert said.count("compiled steps cannot be had") == 1


def test_a_full_disk_is_said_and_survived(monkeypatch: pytest.MonkeyPatch, expected: float) -> None:
    """Code is stored at the first call, and that may fail after the import did not."""

    def full(*_: object) -> None:
        raise OSError(28, "no space left on device")

    monkeypatch.setattr(_bounce_compiled, "plain_steps", full)
    with pytest.warns(UserWarning, match="no space left on device") as caught:
        found = drop(SLS, **BODY)
    assert len(caught) == 1
    assert float(found.restitution[0]) == pytest.approx(expected, abs=1e-9)


def test_asking_for_numpy_does_not_load_numba() -> None:
    program = _PROGRAM.replace("0.022)", "0.022, compiled=False)")
    program += "\nimport sys; print('numba' in sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.splitlines()[-1] == "False"


def test_compiled_and_numpy_steps_agree(expected: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain = drop(SLS, **BODY, compiled=False)
    assert np.abs(float(plain.restitution[0]) - expected) < 1e-9

"""Where numba can keep its code nowhere, the kernels are compiled again: said once, same answer."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from labpipe.imaging.spline import prefilter

_PROGRAM = """
import json, warnings
import numpy as np
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from labpipe.imaging.spline import prefilter
image = np.random.default_rng(1).uniform(size=(12, 9)).astype(np.float32)
print(json.dumps({"found": prefilter(image, 3).tolist(), "said": [str(w.message) for w in caught]}))
"""


def test_no_place_for_compiled_kernels_is_said_once_and_survived(tmp_path: Path) -> None:
    """The cache folder would have to be made below a file: impossible for any user."""
    (tmp_path / "file").write_text("no folder")
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path / "file" / "cache"),
        "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator",
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    run = subprocess.run(
        [sys.executable, "-c", _PROGRAM],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    printed = json.loads(run.stdout)
    image = np.random.default_rng(1).uniform(size=(12, 9)).astype(np.float32)
    np.testing.assert_array_equal(np.array(printed["found"], np.float32), prefilter(image, 3))
    assert len(printed["said"]) == 1
    assert "compiled image kernels cannot be kept" in printed["said"][0]
    assert "NUMBA_CACHE_DIR" in printed["said"][0]

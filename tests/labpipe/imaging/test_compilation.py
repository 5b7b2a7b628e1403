"""Where numba can keep its code nowhere, the kernels are compiled again: said once, same answer."""

import json
from pathlib import Path

import numpy as np
import pytest

from labpipe.imaging.dic._spline import prefilter
from tests.labpipe.without_cache import printed_without_cache

_PROGRAM = """
import json, warnings
import numpy as np
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from labpipe.imaging.dic._spline import prefilter
image = np.random.default_rng(1).uniform(size=(12, 9)).astype(np.float32)
print(json.dumps({"found": prefilter(image, 3).tolist(), "said": [str(w.message) for w in caught]}))
"""


@pytest.mark.slow
def test_no_place_for_compiled_kernels_is_said_once_and_survived(tmp_path: Path) -> None:
    printed = json.loads(printed_without_cache(_PROGRAM, tmp_path))
    image = np.random.default_rng(1).uniform(size=(12, 9)).astype(np.float32)
    np.testing.assert_array_equal(np.array(printed["found"], np.float32), prefilter(image, 3))
    assert len(printed["said"]) == 1
    assert "compiled code cannot be kept" in printed["said"][0]
    assert "NUMBA_CACHE_DIR" in printed["said"][0]

"""A mapped file: nothing beyond its end, and its pages are given back."""

from pathlib import Path

import numpy as np
import pytest

from labpipe.binary import Window
from labpipe.errors import SourceError

_STATUS = Path("/proc/self/status")
_SIZE = 32 * 2**20


def mapped_bytes() -> int:
    """Bytes of mapped files that this process holds in memory."""
    text = _STATUS.read_text()
    return 1024 * int(text.split("RssFile:")[1].split()[0])


@pytest.fixture
def large(tmp_path: Path) -> Path:
    path = tmp_path / "large"
    path.write_bytes(np.arange(_SIZE // 4, dtype="<u4").tobytes())
    return path


@pytest.mark.skipif(not _STATUS.exists(), reason="only Linux tells how much of a file is held")
def test_going_through_a_large_file_does_not_fill_the_memory(large: Path) -> None:
    window = Window(large, kept=2**20)
    before, peak, step = mapped_bytes(), 0, 2**19
    for start in range(0, _SIZE, step):
        assert window.bytes[start : start + step].any()
        window.note_use(step)
        peak = max(peak, mapped_bytes() - before)
    assert peak < _SIZE / 4
    part = window.array("<u4", 4000, 1000, "numbers")  # arrays stay valid when their pages are given back
    window.note_use(_SIZE)
    np.testing.assert_array_equal(part, np.arange(1000, 2000))


def test_a_field_beyond_the_end_and_a_file_without_content_are_named(large: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    for name, says in (("empty", "the file is empty"), ("missing", "cannot be opened")):
        with pytest.raises(SourceError, match=says):
            Window(tmp_path / name)
    with pytest.raises(SourceError, match="the count would need bytes"):
        Window(large).field("I", _SIZE - 3, "the count")

"""Source files that change within a test."""

import time

import pytest

from labpipe.workflow import code


def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look at the source files again, as a new process does."""
    time.sleep(0.005)  # the next change has another time
    monkeypatch.setattr(code, "_LOADED", time.time_ns())
    code._seen.clear()
    for known in (code.behind, code._digests, code.readers):
        known.cache_clear()

"""Killed while a recording is written: what came before is kept."""

import os
import random
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import instruments
from instruments.keyence import Setup, record
from tests.faults.crashes import killed_after
from tests.instruments.keyence_emulator import Counting

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

Amount = Callable[[int, int], int]
SETUP = Setup((1,), (4,), ("mm",), 1e-3)


def test_a_recording_killed_at_any_time_is_readable_but_for_the_last_rows(tmp_path: Path, amount: Amount) -> None:
    rng = random.Random(9)
    found = 0
    for n in range(amount(3, 60)):
        target = tmp_path / f"{n}.csv"
        seconds = rng.uniform(0.2, 1.5)
        begun = time.monotonic()
        assert killed_after(
            seconds,
            lambda target=target: record(target, SETUP, Counting, 60.0),  # type: ignore[arg-type]
        )
        assert time.monotonic() - begun >= seconds
        if not target.exists():
            continue  # a busy machine did not come as far as the first rows
        readings = instruments.read(target)["out1"].values
        counted = np.round(readings[np.isfinite(readings)] * 1e7)
        assert counted.tolist() == list(range(1, counted.size + 1))
        found += counted.size
    assert found > 20

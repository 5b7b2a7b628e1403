"""Fx and Fy of a six-axis cell as a check of alignment."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import instruments
from pipelines.experiments.shared import mach1_checks

FILE = Path(__file__).parents[5] / "shared/samples/mach1/stress_relaxation_3_ramps.txt"


def lateral(readings: xr.Dataset) -> list[tuple[str | None, str]]:
    found = mach1_checks.of_file("x.txt", readings)
    return [(check.level, check.cause) for check in found if check.name == mach1_checks.ALIGNMENT]


@pytest.mark.skipif(not FILE.is_file(), reason="the public sample of a six-axis cell is not there")
def test_a_tilted_punch_is_doubted_an_aligned_one_is_not_and_a_cell_of_one_axis_not_asked() -> None:
    readings = instruments.read(FILE)
    assert [level for level, _ in lateral(readings)] == [None]
    tilted = readings.assign(force_x=readings["force_x"] + np.tan(np.radians(15.0)) * readings["force_z"])
    ((level, cause),) = lateral(tilted)
    assert level == "doubtful"
    assert "tilted" in cause
    assert lateral(readings.drop_vars(["force_x", "force_y"])) == []

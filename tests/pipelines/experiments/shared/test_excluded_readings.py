"""Readings that a session excludes have one form for all instruments: NaN, and a flag of their own."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from labpipe.workflow.exclusions import Exclusion
from pipelines.experiments.shared.exclusions import EXCLUDED, without_readings

ONE = Exclusion(file="a.csv", reason="a door", readings=[2, "4-5"])


@pytest.mark.parametrize(
    ("dim", "columns", "kept"), [("time", ("out1", "out2"), "status1"), ("sample", ("position_z", "force_z"), "block")]
)
def test_excluded_readings_are_missing_and_flagged(dim: str, columns: tuple[str, ...], kept: str) -> None:
    read = xr.Dataset({name: (dim, np.arange(6.0)) for name in (*columns, kept)})
    made = without_readings(read, SimpleNamespace(exclude=[ONE]), *columns)
    assert made[EXCLUDED].values.tolist() == [0, 1, 0, 1, 1, 0]
    assert [np.flatnonzero(np.isnan(made[name])).tolist() for name in columns] == [[1, 3, 4]] * 2
    assert made[kept].equals(read[kept])
    assert without_readings(read, SimpleNamespace(exclude=[]), *columns) is read

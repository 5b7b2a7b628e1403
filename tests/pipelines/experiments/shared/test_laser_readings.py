"""What a laser export leaves unsaid is taken from the settings; what contradicts it is refused."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from instruments import keyence
from labpipe.errors import SourceError
from labpipe.units import quantity
from pipelines.experiments.shared.laser_readings import read_laser
from pipelines.experiments.shared.settings import Keyence


@pytest.fixture
def export(tmp_path: Path) -> Path:
    """Ten points of 50 us each; the file states its cycle but no storage factor."""
    data = keyence.encode({1: np.linspace(0, 1e-3, 10)}, cycle="50 us", start=datetime(2024, 5, 14))
    lines = [line for line in data.split(b"\r\n") if not line.startswith(b"Storage cycle")]
    (tmp_path / "drop.csv").write_bytes(b"\r\n".join(lines))
    return tmp_path / "drop.csv"


def test_a_storage_factor_that_the_file_omits_is_asked_for_and_used(export: Path) -> None:
    with pytest.raises(SourceError, match="storage_factor=1"):
        read_laser(export, Keyence())
    found = read_laser(export, Keyence(storage_factor=20))
    assert found.attrs["sampling_interval"] == pytest.approx(20 * 50e-6)


def test_a_contradiction_to_the_file_is_refused(tmp_path: Path) -> None:
    settings = {"cycle": "50 us", "start": datetime(2024, 5, 14), "storage_factor": 2}
    keyence.write(tmp_path / "a.csv", {1: np.zeros(3)}, **settings)
    with pytest.raises(SourceError, match="says 2, the option storage_factor says 5"):
        read_laser(tmp_path / "a.csv", Keyence(storage_factor=5))
    with pytest.raises(SourceError, match=r"the option cycle says 0\.0001 s"):
        read_laser(tmp_path / "a.csv", Keyence(cycle=quantity("100 us")))

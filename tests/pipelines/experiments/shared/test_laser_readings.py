"""What a laser export leaves unsaid is taken from the settings; what contradicts it is refused."""

from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np
import pytest

from instruments import keyence
from labpipe.errors import ConfigError, SourceError
from labpipe.units import quantity
from labpipe.workflow import config
from pipelines.experiments.shared.laser_readings import read_laser
from pipelines.experiments.shared.settings import Keyence, Table


class Holder(Table, frozen=True, kw_only=True):
    keyence: Keyence


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


@pytest.mark.parametrize(("value", "words"), [("0", "must be"), ('"two"', "expected")])
def test_a_wrong_storage_factor_is_a_mistake_of_its_line(tmp_path: Path, value: str, words: str) -> None:
    (tmp_path / "a.toml").write_text(f"[keyence]\nstorage_factor = {value}\n")
    with pytest.raises(ConfigError, match=rf"a.toml:2: keyence.storage_factor: {words}"):
        config.read(tmp_path / "a.toml", Holder)
    assert msgspec.to_builtins(Keyence(storage_factor=3))["storage_factor"] == 3

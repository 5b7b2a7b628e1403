"""The day that session.toml states is held against the one that the recording itself says."""

import json
from datetime import date
from pathlib import Path

import pytest
import xarray as xr

from calibration.record import load_record, require
from labpipe import files
from pipelines.experiments.shared.judgements import day_known
from pipelines.rig.session_text import laser_record

STATED = date(2024, 5, 14)
RECORD = "calibration/laser.toml"  # valid from 2024-05-01 until 2025-04-30


def calibrated(folder: Path, start: str, stated: date | None) -> xr.Dataset:
    files.write_text(folder / "laser.toml", laser_record())
    checked = require(load_record(folder / "laser.toml"), "laser", {"start": start}, measured=stated)
    return xr.Dataset(attrs={"calibration": json.dumps(checked)})


@pytest.mark.parametrize(
    ("start", "level"),
    [
        ("2024-05-14T09:30:00", None),
        ("2024-05-13T23:59:00", None),  # a clock in UTC
        ("2024-07-01T09:30:00", "note"),
        ("2022-05-14T09:30:00", "doubtful"),  # the record was not valid then
        ("1999-12-31T09:30:00", None),  # a clock that tells no day is why one states it
        ("", None),
    ],
)
def test_a_stated_day_that_the_file_contradicts_is_told(tmp_path: Path, start: str, level: str | None) -> None:
    found = day_known(calibrated(tmp_path, start, STATED), RECORD, "laser/a.csv")
    assert found.level == level
    if level:
        assert f"laser/a.csv: session.toml says measured_on = {STATED}, which is used" in found.message
        assert f"the file itself says {start[:10]}" in found.message
        assert found.setting == "measured_on"
        assert ("was not valid" in found.message) == (level == "doubtful")


@pytest.mark.parametrize(("start", "why"), [("", "state it as measured_on"), ("1970-01-01", "never set")])
def test_a_recording_of_an_unknown_day_is_a_note(tmp_path: Path, start: str, why: str) -> None:
    assert day_known(calibrated(tmp_path, "2024-07-01T09:30:00", None), RECORD).level is None
    found = day_known(calibrated(tmp_path, start, None), RECORD)
    assert found.level == "note"
    assert "whether calibration/laser.toml was valid is not known" in found.message
    assert why in found.cause

"""Calibration records: typed, versioned, all mistakes at once; the wrong one is refused."""

from datetime import date, datetime

import pytest

from calibration.record import UNDATED, WRONG_CLOCK, load_record, require
from labpipe.errors import CalibrationError, ConfigError
from labpipe.units import Quantity

LASER = """\
version = 1
kind = "laser"
id = "laser-2024-05"
instrument = "LK-G5001"
serial = "1234567"
valid_from = 2024-05-01
valid_until = 2025-04-30
who = "A. Person"
when = 2024-05-01
how = "height gauge, twelve steps of 1 mm"

[values]
inclination = "12.00 ± 0.05 deg"
scale = "1.0010 ± 0.0002"
linearity = "0 ± 0.5 um"
volt_scale = "0.5 ± 0.0005 mm/V"
measuring_range = "8 mm"
time_base = "1e-5 ± 2e-6"
"""


def load(tmp_path, text):
    path = tmp_path / "record.toml"
    path.write_text(text, encoding="utf-8")
    return load_record(path)


def test_laser_record_is_read_in_si(tmp_path):
    record = load(tmp_path, LASER)
    assert record.kind == "laser"
    assert record.values.inclination.value == pytest.approx(0.20943951)
    assert record.values.inclination.u == pytest.approx(8.7266e-4, rel=1e-4)
    assert record.values.inclination.si == "rad"
    assert record.values.volt_scale == Quantity(0.5e-3, 0.5e-6, "m/V")
    assert record.values.linearity.u == pytest.approx(0.5e-6, rel=1e-6, abs=0.0)
    assert record.valid_until == date(2025, 4, 30)


def line_of(needle):
    return LASER[: LASER.index(needle)].count("\n") + 1


def test_all_mistakes_are_listed_with_their_lines(tmp_path):
    text = LASER.replace("who =", "wo =").replace("0.05 deg", "0.05 mm").replace("scale", "scal")
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    problems = "\n".join(caught.value.problems)
    for key, needle in (("wo", "who ="), ("inclination", "inclination"), ("scal", "scale")):
        assert f"record.toml:{line_of(needle)}: " in problems
        assert key in problems
    assert len(caught.value.problems) >= 4


VALID = {"start": "2024-05-14T10:00:00", "serial": "1234567"}


def test_fitting_record_says_what_was_checked(tmp_path):
    checked = require(load(tmp_path, LASER), "laser", VALID)
    assert checked["id"] == "laser-2024-05"
    assert "agrees" in checked["sensor_check"]
    assert checked["validity_check"] == "valid on 2024-05-14"
    with pytest.raises(CalibrationError, match="calibrates a laser, expected a record of a load cell"):
        require(load(tmp_path, LASER), "load_cell", VALID)
    with pytest.raises(CalibrationError, match="has version 2"):
        load(tmp_path, LASER.replace("version = 1", "version = 2"))
    with pytest.raises(ConfigError, match="expected a value"):
        load(tmp_path, "a = [")


def test_the_sensor_of_the_readings_is_compared_as_far_as_it_is_known(tmp_path):
    record = load(tmp_path, LASER)
    for same in ({"serial": "1234567"}, {"model": "lk g5001"}, {"model": "LK-G5001V"}, {"sensor": "head 1234567"}, {}):
        require(record, "laser", {"start": "2024-05-14"} | same)
    for other in ({"serial": "7654321"}, {"model": "CL-3000"}, {"sensor": "IL-100 no. 9"}):
        with pytest.raises(CalibrationError, match="take the record of that sensor"):
            require(record, "laser", {"start": "2024-05-14"} | other)


def test_both_ends_of_the_period_belong_to_it(tmp_path):
    record = load(tmp_path, LASER)
    for day in ("2024-05-01", "2025-04-30", date(2024, 8, 1), datetime(2024, 8, 1)):
        require(record, "laser", {}, measured=day)
    for day, word in (("2025-05-01", "expired on"), ("2024-04-30", "was not yet valid on")):
        with pytest.raises(CalibrationError, match=f"{word} {day}"):
            require(record, "laser", {}, measured=day)


def test_a_clock_that_was_never_set_tells_no_day(tmp_path):
    record = load(tmp_path, LASER)
    for day in ("2000-01-01", "2099-05-14"):
        assert require(record, "laser", {"start": f"{day}T00:00:12"})["no_day"] == WRONG_CLOCK
        with pytest.raises(CalibrationError):  # a person wrote it
            require(record, "laser", {}, measured=date.fromisoformat(day))
    assert require(record, "laser", {"start": ""})["no_day"] == UNDATED
    with pytest.raises(CalibrationError, match="must read like"):
        require(record, "laser", {}, measured="14.5.2024")

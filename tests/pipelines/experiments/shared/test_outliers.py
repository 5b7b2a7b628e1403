"""Wild readings of laser and tester: left out with a status, named with their numbers, and bridged for the analysis."""

import json
from datetime import datetime

import numpy as np
import pytest
import xarray as xr

from instruments import mach1
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_checks, mach1_readings
from pipelines.experiments.shared.laser_readings import OUTLIER, without_outliers
from pipelines.experiments.shared.record_checks import Trace, of_readings
from tests.faults import seeds

START = datetime(2024, 5, 14)


def bouncing(count: int = 3000) -> np.ndarray:
    """Heights [m] every 50 us of a body that is released at 10 ms and bounces with a restitution of 0.8."""
    time, height, speed, heights = 0.0, 2e-3, 0.0, []
    for _ in range(count):
        heights.append(height)
        if time >= 0.01:
            speed -= 9.81 * 50e-6
            height += speed * 50e-6
            if height < 0.0 and speed < 0.0:
                height, speed = -0.8 * height, -0.8 * speed
        time += 50e-6
    return np.array(heights) + 0.3e-6 * np.random.default_rng(1).standard_normal(count)


def laser(heights: np.ndarray) -> xr.Dataset:
    return seeds.keyence_readings(heights)


def spikes(readings: xr.Dataset) -> tuple[str | None, str]:
    trace = Trace.of("drop.csv", readings, "out1")
    assert trace is not None
    found = next(c for c in of_readings(trace, 9.81) if c.name == "jumps and spikes")
    return found.level, found.message + (found.cause or "")


@pytest.mark.parametrize("place", [60, 900, 2990])
@pytest.mark.parametrize("count", [1, 2, 10])
def test_a_run_of_wild_laser_readings_has_a_status_and_is_named(place: int, count: int) -> None:
    heights = bouncing()
    heights[place : place + count] += 1e-3
    readings = without_outliers(laser(heights))
    assert np.flatnonzero(readings["status1"].values == OUTLIER).tolist() == list(range(place, place + count))
    assert np.isnan(readings["out1"].values[place : place + count]).all()
    level, text = spikes(readings)
    assert level == "note"
    assert f"readings {place + 1}" in text


def test_a_longer_disturbance_is_kept_and_found() -> None:
    heights = bouncing()
    heights[900:940] += 1e-3
    readings = without_outliers(laser(heights))
    assert "outliers" not in readings.attrs
    assert spikes(readings)[0] == "impossible"


def test_a_clean_record_loses_no_reading() -> None:
    readings = laser(bouncing())
    assert without_outliers(readings) is readings


def test_wild_readings_of_the_tester_are_named_by_line_and_bridged() -> None:
    time = np.arange(2000) * 0.01
    position = 1e-3 + 5e-5 * np.sin(2 * np.pi * 0.5 * time)
    force = -2.0 - 0.5 * np.sin(2 * np.pi * 0.5 * time)

    def recorded(position: np.ndarray, force: np.ndarray) -> xr.Dataset:
        columns = {"Time, s": time, "Position (z), mm": position, "Fz, N": force}
        cell = mach1.LOAD_CELLS["17N"]
        return mach1.assemble((mach1.make_block("Sinusoid", START, columns, {"Frequency, Hz": "0.5"}, load_cell=cell),))

    clean = recorded(position, force)
    wild_position, wild_force = position.copy(), force.copy()
    wild_position[700] += 2e-3
    wild_force[[900, 901, 902]] += [5.0, -4.0, 5.0]
    readings = mach1_readings.without_outliers(recorded(wild_position, wild_force))
    assert mach1_readings.without_outliers(clean) is clean
    assert np.flatnonzero(np.isnan(readings["position_z"].values)).tolist() == [700]
    assert np.flatnonzero(np.isnan(readings["force_z"].values)).tolist() == [900, 901, 902]
    runs = {(run["column"], run["first"], run["last"]) for run in json.loads(readings.attrs["outliers"])}
    assert runs == {("position_z", 700, 700), ("force_z", 900, 902)}
    check = next(c for c in mach1_checks.of_file("a.txt", readings) if c.name == "outliers")
    assert check.level == "note"
    assert "4 readings left out" in check.message
    settings = Harmonic(kind="harmonic", mach1="a.txt")
    with pytest.warns(UserWarning, match="not tared"):
        loads = mach1_readings.loads(readings, None, settings=settings)
    with pytest.warns(UserWarning, match="not tared"):
        expected = mach1_readings.loads(clean, None, settings=settings)
    np.testing.assert_allclose(loads["force"].values, expected["force"].values, atol=0.005)
    np.testing.assert_allclose(loads["position_z"].values, expected["position_z"].values, atol=2e-7)

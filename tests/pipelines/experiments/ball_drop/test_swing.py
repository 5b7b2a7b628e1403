"""What slopes miss of a bounce that meets the plate elsewhere in its swing."""

import numpy as np
import pytest
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from pipelines.experiments.ball_drop.model import with_swing

HEIGHT, PLATE = 5e-3, contact.Plate(mass=40.0, frequency=200.0, damping_ratio=0.0)
LATER = np.array([0.0, 6.0, 12.0])  # s of a touch per metre of height
SWING = 0.01


def falls(heights: Floats, count: int) -> dict[str, Floats]:
    """Bounces whose restitution follows the plate's swing at their touch."""
    time = np.array([0.0, 0.06, 0.115]) + LATER * (heights[:, None] - HEIGHT)
    swing = SWING * np.cos(2 * np.pi * PLATE.frequency * (time - [0.0, 0.06, 0.115])) * [0.0, 1.0, 1.0]
    found = {"impact_time": time, "restitution": 0.9 + swing, "contact_duration": 1e-3 + 0.0 * time}
    return {name: values[:, :count] for name, values in found.items()}


def swing(late: list[float], plate: contact.Plate | None = PLATE) -> xr.Dataset:
    at_once = falls(np.array([HEIGHT]), 3)
    units = {"impact_time": "s", "restitution": "1", "contact_duration": "s"}
    made = xr.Dataset({n: ("impact", at_once[n][0] + (n == "impact_time"), {"units": units[n]}) for n in units})
    repeats = xr.Dataset({"touch_time": ("impact", at_once["impact_time"][0] + late)})
    return with_swing(made, repeats, plate, HEIGHT, falls, 3)


def test_it_is_what_the_swing_bends_by_until_the_measured_touch() -> None:
    late = np.array([0.0, 1e-4, -5e-4])
    expected = SWING * (1 - np.cos(2 * np.pi * PLATE.frequency * late))
    found = swing(late.tolist())["swing_restitution"].values
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    assert found[2] == pytest.approx(0.191 * SWING, rel=1e-3)  # 1 - cos 36 degrees


def test_a_touch_on_time_has_none_and_a_delay_of_periods_no_more_than_a_swing() -> None:
    np.testing.assert_allclose(swing([0.0, 0.0, 0.0])["swing_restitution"], 0.0, atol=1e-12)
    assert swing([0.0, 1.0, 1.0])["swing_restitution"].max() < 2.2 * SWING


def test_a_rigid_floor_does_not_swing() -> None:
    assert "swing_restitution" not in swing([0.0, 1e-4, 5e-4], None)

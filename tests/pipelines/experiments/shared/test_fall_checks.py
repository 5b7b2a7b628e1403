"""Bounces against their order: what gains height after bounces that lose it was moved."""

import numpy as np
import pytest
import xarray as xr

from labpipe.signals import Floor
from pipelines.experiments.shared import fall_checks
from pipelines.experiments.shared.fall_checks import Fall, Repeated


def _fall(restitution: list[float]) -> Fall:
    e = np.array(restitution)
    into = 0.2 * np.cumprod(np.concatenate([[1.0], e[:-1]]))
    table = {
        "restitution": ("impact", e),
        "u_restitution": ("impact", np.full(e.size, 1e-3)),
        "incoming_speed": ("impact", into),
        "drop_height": 0.2**2 / 19.62,
        "u_drop_height": 1e-6,
    }
    return Fall("laser/a.csv", xr.Dataset(table), 1e-3)


@pytest.mark.parametrize(("restitution", "is_moved"), [([0.9, 0.9, 0.9, 3.0], True), ([1.2, 1.1, 0.98, 1.2], False)])
def test_a_body_that_is_lifted_after_its_bounces_is_told_from_a_reversed_record(restitution, is_moved):
    found = fall_checks.restitution(_fall(restitution))
    assert found.level == "impossible"
    assert ("another drop follows" in found.cause) == is_moved
    assert ("runs backwards in time" in found.cause) != is_moved
    assert fall_checks.restitution(_fall([0.9, 0.9, 0.9])).level is None


@pytest.mark.parametrize(
    ("second", "level"),
    [([0.9, 0.9], None), ([0.93, 0.91], None), ([0.84, 0.86], "doubtful"), ([0.6, 0.6], "impossible")],
)
def test_two_repeats_whose_first_restitution_differs_are_of_two_bodies(second, level):
    found = fall_checks.repeats_agree(
        [_fall([0.9, 0.9]), _fall(second)],
        [Repeated("restitution", "first restitution", "1", of_two=0.05), Repeated("drop_height", "height", "m")],
        "another body",
    )
    assert [c.level for c in found] == [level, None]
    assert ("another body" in found[0].cause) == (level is not None)


@pytest.mark.parametrize(("fallen", "level"), [(8e-6, None), (30e-6, "doubtful"), (118e-6, "impossible")])
def test_a_body_touches_at_one_level_or_rolls_away(fallen: float, level: str | None) -> None:
    depth, u = np.array([60e-6, 40e-6, 25e-6, 15e-6]), np.full(4, 1e-6)
    columns = {"touch_level": -fallen * np.linspace(0.0, 1.0, 4) ** 2, "u_touch_level": u, "penetration": depth}
    columns |= {"incoming_speed": 3e3 * depth, "outgoing_speed": 2e3 * depth}
    table = {name: ("impact", values) for name, values in columns.items()} | {"rest_level": np.nan, "u_rest_level": 0.0}
    fall = Fall("laser/a.csv", xr.Dataset(table), 1e-3)
    found = fall_checks.levels(fall, Floor(0.01, 180.0))
    assert found.level == level
    assert fall_checks.levels(fall).level == (level if fallen > 60e-6 else None)
    assert ("touch 4 is" in found.message, "rolled" in found.otherwise) == (True, True)

"""Temperatures of isotherms by themselves: those that go on from the others in another unit."""

import numpy as np
import pytest

from pipelines.experiments.dma._temperature_checks import _part_in_kelvin

EVERY_20_K = np.arange(-60.0, 61.0, 20.0)


@pytest.mark.parametrize("first", [1, 3, 6])
def test_isotherms_in_kelvin_begin_where_they_go_on_from_the_others(first: int) -> None:
    mixed = EVERY_20_K.copy()
    mixed[first:] += 273.15
    assert _part_in_kelvin(mixed) == pytest.approx(EVERY_20_K[first] + 273.15)
    assert _part_in_kelvin(mixed[::-1]) == pytest.approx(EVERY_20_K[first] + 273.15)


@pytest.mark.parametrize(
    "T",
    [EVERY_20_K, EVERY_20_K + 273.15, np.append(EVERY_20_K, 250.0), np.append(EVERY_20_K, 460.0), [0.0, 20.0, 313.15]],
    ids=["degrees", "all in kelvin", "a gap that is too short", "a gap that is too long", "too few to tell"],
)
def test_other_steps_are_no_change_of_the_unit(T: list[float]) -> None:
    assert _part_in_kelvin(np.asarray(T)) is None

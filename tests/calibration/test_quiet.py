"""The level of quiet readings."""

import numpy as np
import pytest

from calibration._quiet import from_start
from labpipe.errors import CalibrationError


def test_the_median_of_rounded_readings_lies_inside_its_step() -> None:
    plain = np.random.default_rng(0).normal(0.37, 1.0, 20_000)
    found = from_start(np.arange(20_000.0), np.round(plain), resolution=1.0)
    assert found.level == pytest.approx(0.37, abs=0.03)


def test_a_slope_by_chance_is_no_motion_where_the_level_comes_back() -> None:
    """One beginning of 20,000 has it; a drift as steep goes on, and is refused."""
    time, noise = np.arange(400.0), np.random.default_rng(19_501).standard_normal(400)
    assert np.polyfit(time[:32], noise[:32], 1)[0] > 0.05  # 32 readings at rest climb by 2 standard deviations
    found = from_start(time, noise)
    assert abs(found.level) < 0.2
    with pytest.raises(CalibrationError, match="begins in motion"):
        from_start(time, noise + 0.1 * np.arange(400.0))
    with pytest.raises(CalibrationError, match="begins in motion"):
        from_start(time[:40], noise[:40])  # nothing follows that could tell

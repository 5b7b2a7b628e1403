"""Spring beds: identities that need no table."""

import numpy as np
import pytest

from labpipe.contact._springs import balance, press, sphere_bed
from labpipe.contact.line._surface import line_kernel, strip_bed, tip_height

PERIOD, RADIUS, ELEMENTS = 8e-3, 2e-3, 256


@pytest.mark.parametrize("thickness", [np.inf, 1e-3])
@pytest.mark.parametrize("profile", ["parabola", "circle", "cosine"])
def test_pressure_of_the_springs_solves_the_contact_problem(thickness, profile) -> None:
    kernel, centre = line_kernel(PERIOD, ELEMENTS, thickness, 0.35), ELEMENTS // 2
    heights = tip_height(profile, kernel.position, RADIUS, PERIOD, kernel.spacing)
    half = np.append(heights[centre:], heights[0])
    strips = strip_bed(kernel, half[np.isfinite(half)], 4e-4)
    bed = strips.springs
    load = np.empty(bed.size)
    press(bed, bed.gap, 1.0, 2e-4, False, load)
    pressure = strips.pressure(kernel, load)
    reached = slice(centre, centre + bed.size)
    gap = kernel.displacement(pressure)[reached] + half[: bed.size] - 2e-4
    inside = pressure[reached] > 0.0
    assert np.abs(gap[inside]).max() < 1e-15
    assert gap[~inside].min() > 0.0
    assert pressure.min() == 0.0
    assert pressure == pytest.approx(np.roll(pressure[::-1], 1), abs=1e-12)


@pytest.mark.parametrize("springs", [10, 50, 400])
def test_hertz_at_any_edge(springs) -> None:
    bed = sphere_bed(1.0, 0.1, springs)
    for width in np.linspace(0.06, 0.1, 23):
        _, force, radius = press(bed, bed.gap, 1.0, width**2, False, np.empty(bed.size))
        assert force == pytest.approx(4 / 3 * width**3, rel=0.07 / springs**2)
        assert radius == pytest.approx(width, rel=1e-12)

    _, force, _ = press(bed, bed.gap, 1.0, 0.0617**2, False, np.empty(bed.size))
    assert balance(bed, bed.gap, 0.0, 0.0, force) == pytest.approx((0.0617**2, force), rel=1e-12)
    assert balance(bed, bed.gap, 1.0, 0.0617**2 + force, 0.0) == pytest.approx((0.0617**2, force), rel=1e-12)

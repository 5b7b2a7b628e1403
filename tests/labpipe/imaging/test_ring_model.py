import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from labpipe.imaging.fringes._ring_fit import Parameter, tabulate
from labpipe.imaging.fringes._ring_model import (
    SAMPLES_PER_PIXEL,
    Optics,
    distance_at_phase,
    make_optics,
    phase_of_gap,
    ring_limits,
)
from tests.labpipe.imaging.fringe_film import gap_of_hertz, surface_gap

PIXEL, SPHERE, WAVELENGTH = 2.17e-6, 9.525e-3, 633e-9
OPTICS = make_optics(PIXEL, SPHERE, WAVELENGTH)


def test_fringes_stand_where_they_were_tabulated() -> None:
    """Distances from the contact edge in µm: half intensity, first bright, first dark, third dark."""
    published = {434: (9.7, 15.4, 24.4, 50.9), 800: (7.9, 12.5, 19.9, 41.5), 1194: (6.9, 11, 17.4, 36.3)}
    phases = (0.5 * math.pi, math.pi, 2.0 * math.pi, 6.0 * math.pi)
    for micrometres, known in published.items():
        a = micrometres * 1e-6 / PIXEL
        found = [(distance_at_phase(phase, a, OPTICS) - a) * PIXEL * 1e6 for phase in phases]
        assert found == pytest.approx(known, abs=0.06)


@given(st.floats(5.0, 900.0), st.floats(2.0, 8.0))
def test_ring_ends_where_fringes_become_too_fine(a: float, spacing: float) -> None:
    inner, outer = ring_limits(a, OPTICS, 20.0, spacing)
    assert 0.0 <= inner < a < outer
    assert phase_of_gap(outer, a, OPTICS)[1] <= 2.0 * math.pi / spacing * (1.0 + 1e-9)
    assert outer <= distance_at_phase(40.0 * math.pi, a, OPTICS) + 1e-6


def parameters(radius: float, travel: float = 0.0, phase: float = math.pi, bend: float = 0.0) -> np.ndarray:
    values = np.zeros(len(Parameter))
    values[[Parameter.RADIUS, Parameter.SMEAR, Parameter.PHASE, Parameter.BEND]] = radius, travel**2, phase, bend
    return values


def test_table_is_the_mean_over_square_pixels() -> None:
    a = 98.2
    inner, outer = ring_limits(a, OPTICS, 3.0, 3.0)
    start, table = tabulate((inner, outer), parameters(a), OPTICS)
    rng = np.random.default_rng(0)
    r, angle = rng.uniform(inner + 1.0, outer - 1.0, 200), rng.uniform(0.0, 2.0 * math.pi, 200)
    steps = (np.arange(41) + 0.5) / 41 - 0.5
    x = r[:, None, None] * np.cos(angle)[:, None, None] + steps[:, None]
    y = r[:, None, None] * np.sin(angle)[:, None, None] + steps
    gap = gap_of_hertz(np.hypot(x, y), a, 1.0)
    expected = np.cos(OPTICS.phase_scale * gap + math.pi).mean(axis=(1, 2))
    found = np.interp((r - start) * SAMPLES_PER_PIXEL, np.arange(table.shape[1]), table[0])
    assert np.abs(found - expected).max() < 0.012
    assert abs((found - expected).mean()) < 3e-4


@pytest.mark.parametrize("optics", [
    OPTICS, Optics(OPTICS.phase_scale, blur=0.8), Optics(OPTICS.phase_scale, beams=-0.2),
    Optics(OPTICS.phase_scale, spread=1e-3), Optics(OPTICS.phase_scale, flat=120.0),
])  # fmt: skip
def test_derivatives_of_the_table_follow_from_differences(optics: Optics) -> None:
    a, travel, step = 200.0, 4.0, 1e-4
    limits = ring_limits(a, optics, 3.0, 3.0)

    def values(radius: float, moved: float, phase: float) -> np.ndarray:
        return tabulate(limits, parameters(radius, moved, phase), optics)[1][0]

    table = tabulate(limits, parameters(a, travel), optics)[1]
    for line, unit, (one, other) in (
        (2, 1.0, ((a + step, travel, math.pi), (a - step, travel, math.pi))),
        (3, 1.0, ((a, travel, math.pi + step), (a, travel, math.pi - step))),
        (4, 2.0 * travel, ((a, travel + step, math.pi), (a, travel - step, math.pi))),
    ):
        expected = (values(*one) - values(*other)) / (2.0 * step)
        assert unit * table[line] == pytest.approx(expected, abs=2e-6)
    by_distance = np.gradient(table[0], 1.0 / SAMPLES_PER_PIXEL)[2:-2]
    assert np.abs(table[1][2:-2] - by_distance).max() < 0.02


def test_a_flat_has_the_gap_of_its_springs() -> None:
    a, flat = 150.0, 100.0
    limits = ring_limits(a, OPTICS, 2.0, 3.0)
    start, table = tabulate(limits, parameters(a), Optics(OPTICS.phase_scale, flat=flat))
    r = np.linspace(a + 3.0, limits[1] - 2.0, 20)
    gap = surface_gap(r, a, 1.0, flat)
    found = np.interp((r - start) * SAMPLES_PER_PIXEL, np.arange(table.shape[1]), table[0])
    assert found == pytest.approx(np.cos(OPTICS.phase_scale * gap + math.pi), abs=0.05)

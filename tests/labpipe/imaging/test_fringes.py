import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.imaging import hertz_gap
from labpipe.imaging.fringes._interference import (
    SAMPLES_PER_PIXEL,
    Optics,
    beyond_third,
    distance_at_phase,
    exposure_nodes,
    make_optics,
    outer_distance,
    phase_slope,
    pixel_weights,
    ring_limits,
    scaled_gap,
    table_distances,
)
from labpipe.imaging.fringes._table_kernel import fill_table
from tests.labpipe.imaging.contact_scenes import gap_of_worn_flat
from tests.labpipe.imaging.fringe_film import gap_of_hertz, gap_of_pressure
from tests.labpipe.imaging.oracles import radial_table, scaled_slopes

PIXEL, SPHERE, WAVELENGTH = 2.17e-6, 9.525e-3, 633e-9
OPTICS = make_optics(PIXEL, SPHERE, WAVELENGTH)


def test_gap_is_that_of_hertz_pressure_on_an_elastic_body() -> None:
    for a in (213e-6, 1194e-6):
        r, gap = gap_of_pressure(a, SPHERE)
        assert np.abs(hertz_gap(r, a, SPHERE) - gap).max() < 2e-11  # 0.02 nm of 100 um


def test_gap_agrees_with_the_closed_form_written_anew() -> None:
    r = np.linspace(0.0, 2e-3, 4001)
    for a in (0.0, 60e-6, 800e-6):
        assert hertz_gap(r, a, SPHERE) == pytest.approx(gap_of_hertz(r, a, SPHERE), abs=1e-15)


def test_gap_opens_with_the_power_three_halves() -> None:
    a, beyond = 800e-6, np.array([1e-8, 1e-7])
    expected = 8.0 * math.sqrt(2.0) / (3.0 * math.pi) * a**2 / SPHERE * (beyond / a) ** 1.5
    assert hertz_gap(a + beyond, a, SPHERE) == pytest.approx(expected, rel=2e-3, abs=0.0)


@pytest.mark.parametrize(("a", "R"), [(-1e-6, 1e-2), (1e-4, 0.0), (1e-4, -1.0)])
def test_gap_refuses_lengths_that_cannot_be(a: float, R: float) -> None:
    with pytest.raises(InputError, match="found"):
        hertz_gap([0.0], a, R)


# Distances from the contact edge in um: half intensity, first bright, first dark, third dark.
PUBLISHED = {434: (9.7, 15.4, 24.4, 50.9), 800: (7.9, 12.5, 19.9, 41.5), 1194: (6.9, 11, 17.4, 36.3)}


@pytest.mark.parametrize("micrometres", sorted(PUBLISHED))
def test_fringes_stand_where_they_were_tabulated(micrometres: int) -> None:
    a = micrometres * 1e-6 / PIXEL
    phases = (0.5 * math.pi, math.pi, 2.0 * math.pi, 6.0 * math.pi)
    found = [(distance_at_phase(phase, a, OPTICS) - a) * PIXEL * 1e6 for phase in phases]
    assert found == pytest.approx(PUBLISHED[micrometres], abs=0.06)


@given(st.floats(0.0, 900.0), st.floats(0.01, 60.0))
def test_distance_at_phase_inverts_the_gap(a: float, phase: float) -> None:
    r = distance_at_phase(phase, a, OPTICS)
    assert OPTICS.phase_scale * float(scaled_gap(np.float64(r), a)) == pytest.approx(phase, rel=1e-6)


@given(st.floats(5.0, 900.0), st.floats(2.0, 8.0))
def test_ring_ends_where_fringes_become_too_fine(a: float, spacing: float) -> None:
    inner, outer = ring_limits(a, OPTICS, 20.0, spacing)
    assert 0.0 <= inner < a < outer
    assert phase_slope(outer, a, OPTICS) <= 2.0 * math.pi / spacing * (1.0 + 1e-9)
    assert outer <= distance_at_phase(40.0 * math.pi, a, OPTICS) + 1e-6
    assert outer_distance(a, OPTICS, 0.5, spacing) <= outer + 1e-6


@pytest.mark.parametrize("share", [0.3, 0.7, 0.95])
def test_gap_beside_a_flat_is_that_of_the_springs(share: float) -> None:
    a = 200e-6
    r = np.linspace(1.001 * a, 3.0 * a, 400)
    expected = gap_of_worn_flat(r, a, SPHERE, share * a)
    assert scaled_gap(r, a, share * a) / SPHERE == pytest.approx(expected, abs=2e-12)
    by_r, by_a = scaled_slopes(r, a, share * a)
    step = 1e-5 * a
    assert by_r == pytest.approx(
        (scaled_gap(r + step, a, share * a) - scaled_gap(r - step, a, share * a)) / (2.0 * step), rel=1e-3
    )
    assert by_a == pytest.approx(
        (scaled_gap(r, a + step, share * a) - scaled_gap(r, a - step, share * a)) / (2.0 * step), rel=1e-3
    )


def test_a_point_contact_beside_a_flat_is_no_error() -> None:
    """An iteration may pass through a radius of 0, where no flat fits into the contact."""
    rest = (OPTICS.phase_scale, 2.9, pixel_weights(0.0), 0.0, 0.0, 0.0, 5, 30.0, 0.0, 0.5, 0.0)
    distance, (nodes, weights) = table_distances(0.5, 40.0, 0.0, 0)[1], exposure_nodes(0.3, 1.0)
    table = fill_table(distance, 0.0, 0.3, nodes, weights, *rest)
    assert np.isfinite(table).all()
    assert all(np.isfinite(slope).all() for slope in scaled_slopes(np.linspace(0.5, 40.0, 9), 0.0, 30.0))


@settings(max_examples=50)
@given(st.floats(3.0, 700.0), st.floats(1e-3, 2.0))
def test_slopes_are_the_derivatives_of_the_gap(a: float, beyond: float) -> None:
    r, step = a * (1.0 + beyond), 1e-5 * a
    by_r, by_a = scaled_slopes(np.float64(r), a)
    assert float(by_r) == pytest.approx(
        float(scaled_gap(np.float64(r + step), a) - scaled_gap(np.float64(r - step), a)) / (2.0 * step), rel=1e-4
    )
    assert float(by_a) == pytest.approx(
        float(scaled_gap(np.float64(r), a + step) - scaled_gap(np.float64(r), a - step)) / (2.0 * step), rel=1e-4
    )


@pytest.mark.parametrize(
    ("blur", "flat", "disc", "spread", "focus"),
    [(0.0, 0.0, 0.0, 0.0, 0.0), (0.8, 0.0, 0.0, 0.0, 4e-3), (0.8, 70.0, 0.0, 4e-3, -6e-3), (2.5, 0.0, 0.7, 1e-3, 0.0)],
)
@pytest.mark.parametrize(("travel", "turned"), [(0.0, 0.15), (1.5, 0.0), (12.0, 0.15)])
def test_compiled_table_equals_the_plain_one(
    travel: float, turned: float, blur: float, flat: float, disc: float, spread: float, focus: float
) -> None:
    a, optics = 120.3, Optics(OPTICS.phase_scale, 2.9, blur, flat, disc, spread=spread, focus=focus)
    inner, outer = ring_limits(a, optics, 3.0, 3.0)
    kernel = pixel_weights(blur, disc, 0.5 * (a + outer))
    start, distance = table_distances(inner, outer, blur, len(kernel) // 2)
    spacing = 2.0 * math.pi / phase_slope(outer, a, optics)
    nodes, weights = exposure_nodes(travel, spacing)
    for part in (nodes, weights):  # as those of a contact that moves: of others the kernel is compiled again
        part.setflags(write=False)
    rest = (weights, optics.phase_scale, 2.9, kernel, 0.2, turned, -0.1, 11, flat, spread, 0.5, focus)
    compiled = fill_table(distance, a, travel, nodes, *rest)
    plain = radial_table(inner, outer, a, travel, optics, (0.2, turned, -0.1))
    assert start == plain.start
    # Where a blur leaves nothing sharp, every fourth sample tells the others; the second derivative less well.
    error = np.abs(compiled - plain.values).max(axis=1) / np.maximum(np.abs(plain.values).max(axis=1), 1e-2)
    assert error.max() < (1e-12 if blur < 1.0 else 2e-3)
    assert np.delete(error, 5).max() < (1e-12 if blur < 1.0 else 5e-4)


@pytest.mark.parametrize("power", [-1.0, 0.45, 0.7, 2.2])
def test_harmonics_of_a_power_of_the_light_follow_from_two(power: float) -> None:
    """Many beams are the power -1, which has none beyond its own."""
    light = 1.0 + 0.8 * np.cos(2.0 * np.pi * np.arange(256) / 256)
    first, *true = np.fft.rfft(light**power).real[1:7]
    second, third, *further = np.array(true) / first
    beside = third - second**2
    found = beyond_third(second, beside)
    assert np.abs(found[:, 0] + second ** np.arange(3, 6) - further).max() < 2e-4
    step = 1e-5
    for place, (one, other) in enumerate([((step, 0.0), (-step, 0.0)), ((0.0, step), (0.0, -step))]):
        ends = [beyond_third(second + by[0], beside + by[1])[:, 0] for by in (one, other)]
        assert found[:, 1 + place] == pytest.approx((ends[0] - ends[1]) / (2.0 * step), abs=1e-6)


@pytest.mark.parametrize(("flat", "second"), [(0.0, 0.0), (60.0, 0.0), (0.0, -0.05)])
def test_slopes_out_of_focus_are_the_derivatives_of_the_light(flat: float, second: float) -> None:
    """By radius and by the distance from focus; what turns harmonics follows the radius less exactly."""
    a, optics = 120.3, Optics(OPTICS.phase_scale, 2.9, 0.3, flat, focus=-5e-3)
    inner, outer = ring_limits(a, optics, 3.0, 3.0)

    def light(radius: float, focus: float) -> Floats:
        changed = replace(optics, focus=focus)
        return radial_table(inner, outer, radius, 1.0, changed, (second, 0.0, 0.0)).values

    table = light(a, optics.focus)
    by_radius = (light(a + 1e-4, optics.focus)[0] - light(a - 1e-4, optics.focus)[0]) / 2e-4
    by_focus = (light(a, optics.focus + 1e-7)[0] - light(a, optics.focus - 1e-7)[0]) / 2e-7
    share = 0.02 if second else 1e-6
    assert np.abs(table[2] - by_radius).max() < share * np.abs(by_radius).max()
    assert np.abs(table[10] - by_focus).max() < 5.0 * share * np.abs(by_focus).max()


def test_a_band_of_colours_is_the_mean_over_its_wavelengths() -> None:
    """Of wavelengths in a bell, as of wavenumbers; the slopes by radius and by the spread are those of the light."""
    a, spread = 120.3, 4e-3
    inner, outer = ring_limits(a, OPTICS, 3.0, 3.0)
    x = np.linspace(-6.0, 6.0, 241)
    weights = np.exp(-0.5 * x**2) / np.exp(-0.5 * x**2).sum()

    def table(radius: float, variance: float, skew: float) -> Floats:
        optics = replace(OPTICS, spread=variance, skew=skew)
        return radial_table(inner, outer, radius, 0.0, optics).values

    for skew in (0.0, 1.0):
        shift = np.sqrt(spread) * x
        scales = OPTICS.phase_scale * (1.0 - shift + skew * shift**2)
        each = [radial_table(inner, outer, a, 0.0, replace(OPTICS, phase_scale=s)).values[0] for s in scales]
        assert table(a, spread, skew)[0] == pytest.approx(weights @ np.array(each), abs=1e-8)
        by_radius = (table(a + 1e-4, spread, skew) - table(a - 1e-4, spread, skew))[0] / 2e-4
        assert table(a, spread, skew)[2] == pytest.approx(by_radius, abs=1e-5)
        by_spread = (table(a, spread + 1e-7, skew) - table(a, spread - 1e-7, skew))[0] / 2e-7
        assert table(a, spread, skew)[9] == pytest.approx(by_spread, abs=1e-3)


def test_table_is_the_mean_over_square_pixels() -> None:
    a = 98.2
    inner, outer = ring_limits(a, OPTICS, 3.0, 3.0)
    table = radial_table(inner, outer, a, 0.0, OPTICS)
    rng = np.random.default_rng(0)
    r = rng.uniform(inner + 1.0, outer - 1.0, 200)
    angle = rng.uniform(0.0, 2.0 * math.pi, 200)
    steps = (np.arange(41) + 0.5) / 41 - 0.5
    x = r[:, None, None] * np.cos(angle)[:, None, None] + steps[:, None]
    y = r[:, None, None] * np.sin(angle)[:, None, None] + steps
    phase = OPTICS.phase_scale * scaled_gap(np.hypot(x, y), a) + OPTICS.phase
    expected = np.cos(phase).mean(axis=(1, 2))
    places = (r - table.start) * SAMPLES_PER_PIXEL
    found = np.interp(places, np.arange(table.values.shape[1]), table.values[0])
    assert np.abs(found - expected).max() < 0.012
    assert abs((found - expected).mean()) < 3e-4


def test_table_out_of_focus_is_the_mean_over_a_disc() -> None:
    """A disc of 4 px around fringes of 98 to 130 px; without its skew the table is off by ten times as much."""
    a, radius = 98.2, 4.0
    optics = Optics(OPTICS.phase_scale, 2.9, 0.5 * radius, 0.0, 1.0)
    inner, outer = ring_limits(a, optics, 3.0, 3.0)
    table = radial_table(inner, outer, a, 0.0, optics)
    r = np.linspace(a - 2.0, outer - 1.0, 80)
    share, turn = np.sqrt((np.arange(200) + 0.5) / 200), 2.0 * math.pi * (np.arange(160) + 0.5) / 160
    x, y = radius * share[:, None] * np.cos(turn), radius * share[:, None] * np.sin(turn)
    steps = (np.arange(8) + 0.5) / 8 - 0.5
    places = np.hypot(r[:, None, None] + x, y)
    # a pixel is as wide along a row through the centre
    expected = np.mean(
        [np.cos(optics.phase_scale * scaled_gap(places + s, a) + 2.9).mean(axis=(1, 2)) for s in steps], axis=0
    )
    found = np.interp((r - table.start) * SAMPLES_PER_PIXEL, np.arange(table.values.shape[1]), table.values[0])
    assert np.abs(found - expected).max() < 0.003


def test_derivatives_of_the_table_follow_from_differences() -> None:
    a, travel, step = 200.0, 4.0, 1e-4
    limits = ring_limits(a, OPTICS, 3.0, 3.0)

    def values(radius: float, moved: float, phase: float) -> np.ndarray:
        optics = Optics(OPTICS.phase_scale, phase)
        return radial_table(*limits, radius, moved, optics).values[0]

    table = radial_table(*limits, a, travel, OPTICS).values
    for line, (one, other) in {
        2: ((a + step, travel, math.pi), (a - step, travel, math.pi)),
        3: ((a, travel, math.pi + step), (a, travel, math.pi - step)),
        4: ((a, travel + step, math.pi), (a, travel - step, math.pi)),
    }.items():
        expected = (values(*one) - values(*other)) / (2.0 * step)
        assert table[line] == pytest.approx(expected, abs=1e-7)

"""The general solver: complementarity, agreement with the springs, and the automatic switch."""

import json

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from labpipe.contact import indent, indent_load
from labpipe.contact.line._conjugate_gradients import GeneralContact
from labpipe.contact.line._kernels import line_kernel
from labpipe.errors import InputError
from labpipe.materials import Prony

PERIOD, RADIUS, N = 8e-3, 2e-3, 256
SLS = Prony.from_creep(2e9, [0.25e-9], [0.05], nu=0.35)
X = PERIOD / N * np.arange(-(N // 2), N // 2)
TIME = np.linspace(0.0, 1.0, 61)
DEPTH = 2e-4 * (0.2 - 0.8 * np.cos(2 * np.pi * TIME))

PROFILES = {
    "two tips": np.minimum((X - 1.5e-3) ** 2, (X + 1.5e-3) ** 2) / (2 * RADIUS),
    "off centre": np.roll(X**2 / (2 * RADIUS), 37),
    "rough": X**2 / (2 * RADIUS) + 2e-6 * np.random.default_rng(3).standard_normal(N),
    "flat punch": np.where(np.abs(X) < 1e-3, 0.0, np.inf),
    "two punches": np.where(np.abs(np.abs(X) - 1.5e-3) < 4e-4, 0.0, np.inf),
}
RING = X**2 / (2 * RADIUS) - 1.2e-4 * np.exp(-(((np.abs(X) - 1.2e-3) / 2e-4) ** 2))


@pytest.mark.parametrize("thickness", [np.inf, 1e-3])
@pytest.mark.parametrize("name", PROFILES)
def test_surface_and_pressure_are_complementary_at_every_step(name, thickness) -> None:
    profile = PROFILES[name]
    found = indent(
        SLS, RADIUS, PERIOD, 1.0, TIME, DEPTH, profile, thickness, rtol=None, outputs=["pressure", "surface"]
    )
    pressure, surface = found.pressure.values, found.surface.values
    gap = surface + profile - DEPTH[:, None]
    contact = pressure > 0.0
    assert pressure.min() >= 0.0
    assert np.abs(gap[contact]).max() < 1e-9 * 2e-4
    assert gap.min() > -1e-9 * 2e-4
    assert found.force.values == pytest.approx(pressure.sum(axis=1) * PERIOD / N, rel=1e-9)


@pytest.mark.parametrize("thickness", [np.inf, 1e-3])
@pytest.mark.parametrize("rtol", [None, 1e-3])
def test_both_solvers_agree_where_the_contact_is_nested(thickness, rtol) -> None:
    outputs = ["pressure", "surface", "energy"]
    runs = {
        solver: indent(
            SLS,
            RADIUS,
            PERIOD,
            1.0,
            TIME,
            DEPTH,
            X**2 / (2 * RADIUS),
            thickness,
            solver=solver,
            outputs=outputs,
            rtol=rtol,
        )
        for solver in ("springs", "general")
    }
    springs, general = runs["springs"], runs["general"]
    # Controlled steps differ between the two, and with them the pressure at the very edge.
    bound = 1e-7 if rtol is None else 1e-3
    names = ["force", "stored_energy", "dissipated_energy"]
    for name in [*names, "pressure", "surface"] if rtol is None else names:
        scale = float(np.abs(springs[name]).max())
        assert float(np.abs(springs[name] - general[name]).max()) < bound * scale
    assert springs.attrs["solver"] == "springs"
    assert json.loads(springs.attrs["work"])["kernel_products"] == 0
    assert json.loads(general.attrs["work"])["kernel_products"] > 0


@pytest.mark.parametrize(
    ("profile", "solver", "reason"),
    [
        (X**2 / (2 * RADIUS), "springs", "nested"),
        (PROFILES["flat punch"], "springs", "nested"),
        (PROFILES["two tips"], "general", "lowest at its centre"),
        (PROFILES["off centre"], "general", "symmetric"),
        (RING, "general", "stops being one growing and shrinking strip at"),
    ],
)
def test_the_switch_is_automatic_and_says_why(profile, solver, reason) -> None:
    found = indent(SLS, RADIUS, PERIOD, 1.0, TIME, 1.4 * DEPTH, profile, rtol=None)
    assert found.attrs["solver"] == solver
    assert reason in found.attrs["solver_reason"]


def test_the_switch_does_not_depend_on_the_step_control() -> None:
    found = indent(SLS, RADIUS, PERIOD, 1.0, TIME[:35], 1.4 * DEPTH[:35], RING, rtol=1e-3)
    assert found.attrs["solver"] == "general"


def test_springs_refuse_what_they_cannot_do() -> None:
    with pytest.raises(InputError, match="stops being one"):
        indent(SLS, RADIUS, PERIOD, 1.0, TIME, 1.4 * DEPTH, RING, rtol=None, solver="springs")


def test_two_tips_far_apart_on_a_thin_layer_are_two_single_tips() -> None:
    """On a thin layer tips do not feel each other."""
    single = indent(SLS, RADIUS, PERIOD / 2, 1.0, TIME, DEPTH / 10, thickness=1e-4, elements=256)
    x = PERIOD / 512 * np.arange(-256, 256)
    two = np.minimum((x - 2e-3) ** 2, (x + 2e-3) ** 2) / (2 * RADIUS)
    double = indent(SLS, RADIUS, PERIOD, 1.0, TIME, DEPTH / 10, two, thickness=1e-4)
    assert double.force.values == pytest.approx(2 * single.force.values, abs=3e-3 * 2 * float(single.force.max()))


@pytest.mark.parametrize("name", ["two tips", "rough"])
def test_load_control_inverts_displacement_control(name) -> None:
    depth = 1.5e-4 * np.sin(np.pi * TIME)
    profile = PROFILES[name]
    pressed = indent(SLS, RADIUS, PERIOD, 1.0, TIME, depth, profile, rtol=None)
    load = np.where(TIME <= 0.5, pressed.force.values, pressed.force.values[30])
    upto = slice(0, 31)
    pushed = indent_load(SLS, RADIUS, PERIOD, 1.0, TIME[upto], load[upto], profile, rtol=None)
    assert pushed.displacement.values[1:] == pytest.approx(depth[1:31], rel=1e-6)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    depth=st.floats(0.05, 0.95),
    roughness=st.floats(0.0, 1.0),
    thickness=st.sampled_from([np.inf, 1e-3, 1e-4]),
)
def test_any_profile_is_solved_or_refused(seed, depth, roughness, thickness) -> None:
    rng = np.random.default_rng(seed)
    n = 64
    heights = 1e-4 * ((1 - roughness) * np.cos(2 * np.pi * np.arange(n) / n) + roughness * rng.random(n))
    heights -= heights.min()
    contact = GeneralContact(line_kernel(PERIOD, n, thickness, 0.3), heights, "closed")
    approach = depth * heights.mean()
    answer = contact.press(np.zeros(n), 1.0, approach)
    gap = contact.kernel.displacement(answer.load) + heights - approach
    assert answer.load.min() >= 0.0
    assert gap.min() > -1e-9 * np.ptp(heights)
    assert np.abs(gap[answer.load > 0.0]).max(initial=0.0) < 1e-9 * np.ptp(heights)


def test_full_contact_of_a_half_plane_is_refused_and_of_a_layer_is_linear() -> None:
    half_plane = GeneralContact(line_kernel(PERIOD, N), X**2 / (2 * RADIUS), "closed")
    with pytest.raises(InputError, match="closed"):
        half_plane.press(np.zeros(N), 1.0, 1.4e-3)
    wavy = 1e-6 * (1 - np.cos(2 * np.pi * X / PERIOD))
    layer = GeneralContact(line_kernel(PERIOD, N, 1e-3, 0.3), wavy, "closed")
    low, high = (layer.press(np.zeros(N), 1.0, d) for d in (5e-5, 1e-4))
    slope = (high.force - low.force) / 5e-5
    assert slope == pytest.approx(PERIOD / layer.kernel.mean_compliance, rel=1e-9)
    assert high.half_width == pytest.approx(PERIOD / 2)


@pytest.mark.parametrize(
    "profile", [np.full(64, np.inf), np.full(64, np.nan), np.zeros((8, 8)), np.zeros(63), [0.0, -np.inf] * 32]
)
def test_profiles_that_are_none_are_refused(profile) -> None:
    with pytest.raises(InputError):
        indent(SLS, RADIUS, PERIOD, 1.0, [0.0, 1.0], [0.0, 1e-5], profile)


@pytest.mark.parametrize("begin", ["nothing", "everything that is pressed", "every third strip"])
def test_pivoting_ends_at_the_answer_of_the_iteration_wherever_it_begins(begin) -> None:
    elements, period = 96, 2e-3
    kernel = line_kernel(period, elements)
    x = np.arange(elements) / elements
    profile = 1e-5 * (1.0 - np.cos(4 * np.pi * x) + 0.4 * np.cos(14 * np.pi * x + 1.0))
    contact = GeneralContact(kernel, profile, "full contact")
    approach = 2e-6 - profile
    expected = contact._solve(approach, 1e-16)
    start = {
        "nothing": np.zeros(elements, bool),
        "everything that is pressed": approach > 0.0,
        "every third strip": np.arange(elements) % 3 == 0,
    }[begin]
    found = contact._pivot(start, approach, 1e-14)
    np.testing.assert_allclose(found, expected, atol=1e-6 * expected.max())
    assert 0 < np.count_nonzero(found) < elements
    assert contact.pivots > 0

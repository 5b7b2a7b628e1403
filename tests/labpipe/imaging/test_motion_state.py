"""The compiled state of the tracked points against the same rules in numpy."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from labpipe.imaging.dic._motion_state import STRETCH, converged_nearby, extent, predicted, remember
from labpipe.imaging.dic._motion_uncertainty import one_way

COUNT = 40
Arrays = dict[str, NDArray[np.generic]]


@pytest.fixture
def state() -> Arrays:
    rng = np.random.default_rng(3)
    return {
        "motion": rng.standard_normal((COUNT, 6)),
        "velocity": rng.standard_normal((COUNT, 2)),
        "seen": rng.integers(-1, 20, COUNT),
        "step": rng.integers(1, 4, COUNT).astype(float),
        "zncc": rng.uniform(0, 1, COUNT),
        "is_tracked": rng.random(COUNT) < 0.7,
        "misses": rng.integers(0, 9, COUNT),
    }


def test_motion_goes_on_with_constant_velocity_for_a_while(state: Arrays) -> None:
    index = 22
    gap = index - state["seen"]
    goes_on = (state["seen"] >= 0) & state["is_tracked"] & (gap <= STRETCH * state["step"])
    expected = state["motion"].copy()
    expected[:, [0, 3]] += np.where(goes_on[:, None], state["velocity"] * gap[:, None], 0.0)
    names = ("motion", "velocity", "seen", "step", "is_tracked")
    found = predicted(*(state[name] for name in names), index)
    assert 0 < goes_on.sum() < COUNT
    np.testing.assert_allclose(found, expected)


def test_the_rectangle_holds_the_turned_subsets(state: Arrays) -> None:
    rng = np.random.default_rng(4)
    places, half = rng.uniform(0, 500, (COUNT, 2)), rng.integers(5, 100, COUNT)
    motion, chosen = state["motion"], state["is_tracked"]
    found = extent(places, half, motion, chosen)
    corners = np.array([(a, b) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    offset = corners[None] * half[chosen, None, None]
    x = places[chosen, :1] + motion[chosen, :1]
    x = x + (1 + motion[chosen, 1:2]) * offset[..., 0] + motion[chosen, 2:3] * offset[..., 1]
    assert found[0] <= x.min()
    assert found[1] >= x.max()
    alone = extent(places, half, np.zeros((COUNT, 6)), np.arange(COUNT) == 7)
    np.testing.assert_allclose(alone[:2], places[7, 0] + np.array([-1, 1]) * half[7])
    np.testing.assert_allclose(alone[2:], places[7, 1] + np.array([-1, 1]) * half[7])


def test_points_near_their_prediction_and_alike_need_no_confirmation(state: Arrays) -> None:
    rng = np.random.default_rng(6)
    expected = state["motion"] + rng.uniform(-2, 2, (COUNT, 6))
    needed = rng.uniform(0, 1, COUNT)
    found = converged_nearby(
        state["motion"], expected, state["is_tracked"], state["zncc"], needed, np.full(len(needed), 1.5)
    )
    apart = np.hypot(*(state["motion"] - expected)[:, [0, 3]].T)
    right = state["is_tracked"] & (apart <= 1.5) & (state["zncc"] > needed)
    assert 0 < right.sum() < COUNT
    np.testing.assert_array_equal(found, right)


def test_only_trusted_points_are_remembered(state: Arrays) -> None:
    rng = np.random.default_rng(5)
    found, zncc = rng.standard_normal((COUNT, 6)), rng.uniform(0, 1, COUNT)
    trusted, index = rng.random(COUNT) < 0.6, 25
    before = {name: values.copy() for name, values in state.items()}
    names = ("motion", "velocity", "seen", "step", "zncc", "is_tracked", "misses")
    remember(found, zncc, trusted, index, *(state[name] for name in names))
    gap = index - before["seen"]
    moves = trusted & before["is_tracked"] & (before["seen"] >= 0)
    speed = (found - before["motion"])[:, [0, 3]] / gap[:, None]
    np.testing.assert_allclose(state["velocity"], np.where(moves[:, None], speed, 0.0))
    np.testing.assert_allclose(state["motion"], np.where(trusted[:, None], found, before["motion"]))
    np.testing.assert_array_equal(state["seen"], np.where(trusted, index, before["seen"]))
    np.testing.assert_array_equal(state["step"], np.where(moves, gap, 1))
    np.testing.assert_array_equal(state["is_tracked"], trusted)
    np.testing.assert_array_equal(state["misses"], np.where(trusted, 0, before["misses"] + 1))
    np.testing.assert_array_equal(state["zncc"], np.where(trusted, zncc, before["zncc"]))


def test_an_edge_along_either_axis_is_one_way_and_a_corner_is_not():
    slopes = np.array([(1.0, 1.0, 0.0), (1.0, 1e-4, 0.0), (1e-4, 1.0, 0.0), (1.0, 1.0, 0.9999)])
    normal = np.zeros((4, 6, 6))
    normal[:, 0, 0], normal[:, 3, 3], normal[:, 0, 3] = slopes.T
    assert one_way(SimpleNamespace(normal=normal)).tolist() == [False, True, True, True]

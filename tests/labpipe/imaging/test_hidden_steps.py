"""Displacements that gather at whole pixels: when most frames show it, all of them are uncertain by it."""

import numpy as np
import pytest

from labpipe.imaging.dic import _hidden_steps
from labpipe.imaging.dic._hidden_steps import gathered_steps


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        ([4e-4, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0] * 6),  # in one frame of three: two bodies a pixel apart
        ([0.0] * 6, [0.0] * 6),
        ([4e-4, 0.0, 5e-4, 0.0, 6e-4, 0.0], [4e-4, 5e-4, 5e-4, 5e-4, 6e-4, 5e-4]),
    ],
)
def test_steps_count_in_all_frames_when_half_of_those_that_tell_show_them(
    monkeypatch: pytest.MonkeyPatch, told: list[float], expected: list[float]
) -> None:
    values = iter(told)
    monkeypatch.setattr(_hidden_steps, "_gathered", lambda *_: next(values))
    rng = np.random.default_rng(1)
    found = np.ones((3, 200), bool)
    found[:, 7] = False
    steps = gathered_steps(rng.uniform(0.0, 100.0, (200, 2)), rng.normal(0.0, 1.0, (3, 200, 2)), found)
    assert steps[:, 3].ravel().tolist() == pytest.approx(expected)
    assert not steps[:, 7].any()

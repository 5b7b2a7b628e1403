"""The thesis's scheme, of spheres and lines: it converges to the springs, slowly, and says what it cannot do."""

import numpy as np
import pytest

from labpipe.contact import drop, indent
from labpipe.errors import InputError
from labpipe.materials import Prony

SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
SLOW = Prony.from_creep(2e9, [0.25e-9], [0.05], nu=0.35)
SPHERE = {"radius": 9.525e-3, "mass": 0.505, "height": 1.5e-3, "duration": 0.0195, "solver": "thesis"}
LINE = {"profile": "cosine", "solver": "thesis"}
GEOMETRY = (2e-3, 8e-3, 1.0)


def error(steps: int) -> float:
    time = np.linspace(0.0, 0.4, steps + 1)
    depth = 1e-4 * np.sin(np.pi * time / 0.4)
    plain, ours = (
        indent(SLOW, *GEOMETRY, time, depth, profile="cosine", elements=128, solver=solver)
        for solver in ("thesis", "springs")
    )
    return float(np.abs(plain.force - ours.force).max() / ours.force.max())


def test_a_drop_in_steps_of_the_thesis_is_percents_off() -> None:
    result = drop(SLS, **SPHERE)
    assert 0.01 < abs(float(result.peak_force[0]) / 257.5063769 - 1) < 0.2
    assert abs(float(result.restitution[0]) / 0.7288782966 - 1) < 0.2
    assert float(result.displacement[0]) == 1.5e-3
    assert np.all(np.diff(result.time) > 0)
    asked = drop(SLS, **SPHERE, times=[0.0, 0.01, 0.019])
    assert asked.displacement.values[1] == pytest.approx(1.5e-3 - 0.5 * 9.81 * 1e-4, abs=1e-6)


def test_a_line_converges_to_first_order() -> None:
    coarse, fine = error(40), error(160)
    assert 3.0 < coarse / fine < 5.0
    assert coarse > 1e-2


def test_what_it_cannot_do_is_refused() -> None:
    with pytest.raises(InputError, match="time step"):
        drop(SLS, **(SPHERE | {"duration": 10.0}), time_step=2e-6)
    with pytest.raises(InputError, match="uniform"):
        indent(SLOW, *GEOMETRY, [0.0, 1.0, 3.0], [0.0, 0.0, 0.0], **LINE)
    with pytest.raises(InputError, match="outputs"):
        indent(SLOW, *GEOMETRY, [0.0, 1.0], [0.0, 0.0], outputs=["energy"], **LINE)

"""A session as one object from Python."""

from pathlib import Path

import numpy as np
import pytest

import labpipe as lp
from labpipe.report import SURE


@pytest.fixture(scope="module")
def session(pristine_session: Path):
    return lp.open_session(pristine_session)


def test_experiments_readings_results_and_verdicts_are_at_hand(session) -> None:
    (drop,) = (e for e in session.experiments.values() if e.kind == "ball_drop")
    readings = session.readings(drop.name)
    assert all("time" in one.coords for one in readings.values())
    assert session.results(drop.name)["repeats"]["restitution"].equals(
        session.results()[f"{drop.name}/repeats"]["restitution"]
    )
    assert session.verdicts.experiments[0].believable == "yes"
    assert drop.name in repr(session)


def test_a_variable_is_drawn_with_its_band(session) -> None:
    import matplotlib.pyplot as plt

    found = session.result("drop", "repeats")
    axes = session.plot("drop", "repeats", "restitution")
    (line,) = axes.lines
    np.testing.assert_array_equal(line.get_ydata(), found["restitution"])
    heights = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert heights.max() == pytest.approx(float((found["restitution"] + SURE * found["u_restitution"]).max()))
    plt.close(axes.figure)
    (main,) = session.plot("drop").lines
    np.testing.assert_array_equal(main.get_ydata(), found["displacement_mean"])
    plt.close(main.figure)

"""The edge of a contact without fringes: a soft disc is found where it is."""

import numpy as np
import pytest

from labpipe.imaging.fringes._edge import _crossing


def test_a_level_is_crossed_between_samples() -> None:
    assert _crossing(np.array([1.0, 1.0, 3.0, 3.0]), 1.5) == pytest.approx(1.25)
    assert _crossing(np.array([3.0, 1.0, 3.0]), 2.5) == pytest.approx(0.25)
    assert _crossing(np.array([3.0, 3.0]), 2.5) is None

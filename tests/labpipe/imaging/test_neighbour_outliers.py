"""The normalised median test on displacements of points."""

import numpy as np

from labpipe.imaging.dic._neighbour_outliers import Neighbourhood
from tests.labpipe.imaging.speckle import Motion, grid

PLACES = grid((120, 140), 20, 10)


def motions(motion: Motion) -> np.ndarray:
    """Motion (point, 6) of rigid subsets."""
    result = np.zeros((len(PLACES), 6))
    result[:, [0, 3]] = motion.displacement(PLACES)
    result[:, [4, 1, 5]] = np.sin(motion.angle), np.cos(motion.angle) - 1.0, np.cos(motion.angle) - 1.0
    result[:, 2] = -np.sin(motion.angle)
    return result


def test_bodies_that_turn_or_strain_agree_and_a_line_to_its_ends() -> None:
    for motion in (Motion(3.0, -2.0, 0.1, (60.0, 60.0)), Motion(strain=(0.02, -0.01))):
        fails, _ = Neighbourhood(PLACES).outliers(motions(motion), np.ones(len(PLACES), bool))
        assert not fails.any()
    line = np.stack([np.arange(0.0, 400.0, 40.0), np.zeros(10)], axis=1)
    found = np.zeros((10, 6))
    found[:, 0] = 0.015 * line[:, 0]
    assert not Neighbourhood(line).outliers(found, np.ones(10, bool))[0].any()


def test_a_stray_point_fails_and_is_told_where_its_neighbours_lead() -> None:
    found = motions(Motion(3.0, -2.0, 0.1, (60.0, 60.0)))
    expected = found[30, [0, 3]].copy()
    found[30, 0] += 1.0
    fails, median = Neighbourhood(PLACES).outliers(found, np.ones(len(PLACES), bool))
    assert np.flatnonzero(fails).tolist() == [30]
    np.testing.assert_allclose(median, [expected], atol=0.05)

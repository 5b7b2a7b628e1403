"""Template matching finds subsets to a pixel, and says so when there is nothing to find."""

import numpy as np
import pytest

from labpipe.imaging.dic._neighbour_outliers import carried
from labpipe.imaging.dic._seeding import Pyramid, find_subset, fit_motion, make_pyramid
from tests.by_day import crossed
from tests.labpipe.imaging.speckle import Motion, make_speckle, render

SIZE = (260, 280)


def pyramid(image: np.ndarray) -> Pyramid:
    return make_pyramid(image.astype(np.float32))


MOTIONS = (Motion(3.4, 2.3), Motion(-41.7, 38.2), Motion(8.0, 9.0, np.deg2rad(3.0), (140, 130)))


@pytest.mark.parametrize(
    ("kind", "half", "motion"),
    crossed([("fine", 10), ("medium", 70), ("coarse", 15), ("medium", 15)], MOTIONS, day=4, slow=8),
)
def test_the_seed_is_within_a_pixel_of_the_truth(kind: str, half: int, motion: Motion) -> None:
    speckle = make_speckle(kind, SIZE)
    reference, frame = render(speckle, SIZE), render(speckle, SIZE, motion, noise=4.0)
    found = find_subset(pyramid(reference), pyramid(frame), (140, 130), half)
    assert found is not None
    seed, score = found
    truth = motion.displacement(np.array([(140.0, 130.0)]))[0]
    assert np.hypot(*(seed[[0, 3]] - truth)) < 1.2
    assert score > 0.7
    if half == 70:
        assert seed[4] == pytest.approx(motion.angle, abs=0.012)


def test_a_motion_is_fitted_in_spite_of_wrong_displacements() -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(-200, 200, (12, 2))
    motion = Motion(30.0, -12.0, np.deg2rad(4.0))
    shifts = motion.displacement(places).round()
    shifts[[1, 5, 8, 9]] = rng.uniform(-90, 90, (4, 2))
    found, fits = fit_motion(places, shifts)
    assert fits.tolist() == [n not in {1, 5, 8, 9} for n in range(12)]
    expected = motion.displacement(places)
    assert np.abs(carried(np.tile(found, (12, 1)), places) - expected).max() < 1.0

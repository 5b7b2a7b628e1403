"""Template matching finds subsets to a pixel, and says so when there is nothing to find."""

import numpy as np
import pytest

from labpipe.imaging.seeding import Pyramid, find_subset, fit_motion, make_pyramid, shift_of
from tests.labpipe.imaging.speckle import Motion, make_speckle, render

SIZE = (260, 280)


def pyramid(image: np.ndarray) -> Pyramid:
    return make_pyramid(image.astype(np.float32))


@pytest.mark.parametrize("kind", ["fine", "medium", "coarse"])
@pytest.mark.parametrize("half", [10, 15, 70])
@pytest.mark.parametrize(
    "motion", [Motion(3.4, 2.3), Motion(-41.7, 38.2), Motion(8.0, 9.0, np.deg2rad(3.0), (140, 130))]
)
def test_the_seed_is_within_a_pixel_of_the_truth(kind: str, half: int, motion: Motion) -> None:
    speckle = make_speckle(kind, SIZE)
    reference, frame = render(speckle, SIZE), render(speckle, SIZE, motion, noise=4.0)
    seed = find_subset(pyramid(reference), pyramid(frame), (140, 130), half)
    assert seed is not None
    truth = motion.displacement(np.array([(140.0, 130.0)]))[0]
    assert np.hypot(*(seed.motion[[0, 3]] - truth)) < 1.2
    assert seed.score > 0.7
    if half == 70:
        assert seed.motion[4] == pytest.approx(motion.angle, abs=0.012)


def test_another_pattern_and_a_flat_frame_give_no_seed() -> None:
    reference = render(make_speckle("medium", SIZE), SIZE)
    other = render(make_speckle("medium", SIZE, 5), SIZE)
    for frame in (other, np.full(SIZE, 100)):
        assert find_subset(pyramid(reference), pyramid(frame), (140, 130), 15) is None
    assert find_subset(pyramid(np.full(SIZE, 100)), pyramid(other), (140, 130), 15) is None


def test_a_motion_is_fitted_in_spite_of_wrong_displacements() -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(-200, 200, (12, 2))
    motion = Motion(30.0, -12.0, np.deg2rad(4.0))
    shifts = motion.displacement(places).round()
    shifts[[1, 5, 8, 9]] = rng.uniform(-90, 90, (4, 2))
    found, fits = fit_motion(places, shifts)
    assert fits.tolist() == [n not in {1, 5, 8, 9} for n in range(12)]
    expected = motion.displacement(places)
    assert np.abs(shift_of(np.tile(found, (12, 1)), places) - expected).max() < 1.0


def test_displacements_without_a_common_motion_fit_none() -> None:
    found, fits = fit_motion(np.zeros((1, 2)), np.zeros((1, 2)))
    assert not fits.any()
    assert (found == 0).all()

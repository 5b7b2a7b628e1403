"""Template matching finds subsets to a pixel, and says so when there is nothing to find."""

import numpy as np
import pytest

from labpipe.imaging.dic._neighbour_outliers import carried
from labpipe.imaging.dic._seeding import Pyramid, _coarse_shifts, _match_tile, find_subset, fit_motion, make_pyramid
from tests.by_day import by_day
from tests.labpipe.imaging.speckle import Motion, make_speckle, render

SIZE = (260, 280)


def pyramid(image: np.ndarray) -> Pyramid:
    return make_pyramid(image.astype(np.float32))


@pytest.mark.parametrize("kind", ["fine", "medium", "coarse"])
@pytest.mark.parametrize("half", by_day([10, 15, 70], 1))
@pytest.mark.parametrize(
    "motion", [Motion(3.4, 2.3), Motion(-41.7, 38.2), Motion(8.0, 9.0, np.deg2rad(3.0), (140, 130))]
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
    assert np.abs(carried(np.tile(found, (12, 1)), places) - expected).max() < 1.0


def test_displacements_without_a_common_motion_fit_none() -> None:
    found, fits = fit_motion(np.zeros((1, 2)), np.zeros((1, 2)))
    assert not fits.any()
    assert (found == 0).all()


def test_candidates_are_different_places_and_the_best_comes_first() -> None:
    pattern = render(make_speckle("medium", (80, 80)), (80, 80)).astype(np.float32)
    reference = np.full(SIZE, pattern.mean(), np.float32)
    frame = reference.copy()
    reference[80:160, 80:160] = pattern
    for top, left in ((20, 20), (160, 180)):
        frame[top : top + 80, left : left + 80] = pattern
    found = _coarse_shifts(make_pyramid(reference), make_pyramid(frame), (120, 120), 30)
    assert len(set(found)) == len(found) >= 2
    assert {(-60, -60), (100, 80)} <= set(found)


@pytest.mark.parametrize("centre", [(15, 130), (140, 15), (264, 130), (140, 244)])
def test_a_tile_that_touches_the_border_is_matched_and_one_beyond_is_not(centre: tuple[int, int]) -> None:
    image = pyramid(render(make_speckle("medium", SIZE), SIZE))
    found = _match_tile(image, image, centre, 15, (0, 0))
    assert found is not None
    assert found[:2] == (0.0, 0.0)
    assert found[2] == pytest.approx(1.0, abs=1e-4)
    assert _match_tile(image, image, centre, 16, (0, 0)) is None

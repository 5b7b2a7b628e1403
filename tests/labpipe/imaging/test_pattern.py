"""The reference as soft as the frames, and frames as soft as the reference."""

import numpy as np
import pytest

from labpipe.imaging.dic._film_window import smooth
from labpipe.imaging.dic._growth import NO_GROWTH, STEP, Growth, grown, kernels, more_blur, others_like
from labpipe.imaging.dic._pattern import Pattern, Patterns, _convolved, make_pattern
from labpipe.imaging.dic._spline import PADDING, node_gradients, prefilter
from labpipe.imaging.dic._subset_kernel import BLUR, LIGHT
from labpipe.imaging.dic._subset_solver import SOLVED, Solution, empty_solution
from pipelines.bench.film_scenes import View, from_spectrum, random_field

SIZE, BLUR_OF_ALL = 128, 0.5
NEAR, FAR, SMEARED = View(defocus=0.6), View(defocus=1.2), View(defocus=0.6, smear=(3.0, 2.0))
DISC = View(defocus=0.6, disc=2.5)
INNER = np.s_[24:-24, 24:-24]
#: Weights of the bends: half the growth of the variance along both axes, their difference, and the mixed one.
DEFOCUS = 0.5 * (1.2**2 - 0.6**2)
SMEAR = ((9.0 + 4.0) / 48.0, (9.0 - 4.0) / 48.0, 6.0 / 12.0)


def steps(*weights: float) -> Growth:
    first, second, third = (round(weight / STEP) for weight in weights)
    return first, second, third, 0


def pattern_of(image: np.ndarray, growth: Growth = NO_GROWTH, static_frames: int = 1) -> Pattern:
    centres, half, is_rigid = np.array([[40, 40], [80, 70]]), np.array([15, 15]), np.array([True, False])
    grey = smooth(image, BLUR_OF_ALL)
    return make_pattern(grey, 5, BLUR_OF_ALL, static_frames, centres, half, is_rigid, None, 1.0 / 12.0, growth)


def sampled(coefficients: np.ndarray) -> np.ndarray:
    """Values at the pixels, of coefficients with their border."""
    weights = np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120.0
    inner = coefficients[PADDING : PADDING + SIZE, PADDING : PADDING + SIZE].astype(float)
    for axis in (0, 1):
        inner = np.apply_along_axis(np.convolve, axis, inner, weights, "same")
    return inner


@pytest.mark.parametrize(
    ("view", "growth"),
    [(FAR, steps(DEFOCUS, 0.0, 0.0)), (SMEARED, steps(*SMEAR)), (DISC, (*steps(2.5**2 / 8.0, 0.0, 0.0)[:3], 1))],
    ids=["focus", "smear", "disc"],
)
def test_the_sharper_of_frame_and_reference_is_made_as_soft_as_the_other(view: View, growth: Growth) -> None:
    field = random_field(SIZE, 1.4, 5)
    sharp, soft = from_spectrum(field, NEAR), from_spectrum(field, view)
    change = np.abs(smooth(soft, BLUR_OF_ALL) - smooth(sharp, BLUR_OF_ALL))[INNER].max()
    softened = pattern_of(sharp, growth)
    assert np.abs(softened.images.grey - smooth(soft, BLUR_OF_ALL))[INNER].max() < 0.03 * change
    assert softened.kernel is None
    less = pattern_of(soft, (-growth[0], -growth[1], -growth[2], growth[3]))
    frame = sampled(less.blurred(prefilter(smooth(sharp, BLUR_OF_ALL), 5)))
    assert np.abs(frame - less.images.grey)[INNER].max() < 0.03 * change


@pytest.mark.parametrize(
    "growth",
    [NO_GROWTH, (27, 0, 0, 0), (-27, 0, 0, 0), (13, 5, 25, 0), (-13, 5, -25, 0), (60, 0, 0, 1), (-40, 0, 0, 2)],
)
def test_noise_of_frame_and_reference_is_followed_through_their_blur(growth: Growth) -> None:
    rng = np.random.default_rng(8)
    made = [rng.standard_normal((SIZE, SIZE)) for _ in range(24)]
    patterns = [pattern_of(noise, growth) for noise in made]
    model = patterns[0].noise
    own = np.mean([pattern.images.grey[INNER].var() for pattern in patterns])
    slopes = np.mean([(pattern.images.slope_x[INNER] ** 2).mean() for pattern in patterns])
    slopes_y = np.mean([(pattern.images.slope_y[INNER] ** 2).mean() for pattern in patterns])
    frames = [sampled(p.blurred(prefilter(smooth(n, BLUR_OF_ALL), 5))) for p, n in zip(patterns, made, strict=True)]
    assert own == pytest.approx(model.own, rel=0.04)
    assert 0.5 * (slopes + slopes_y) == pytest.approx(model.slope, rel=0.04)
    assert np.mean([frame[INNER].var() for frame in frames]) == pytest.approx(model.gain[:, 0].prod(), rel=0.04)
    # between the pixels the spline of the frame is smoother
    assert (model.gain[:, 16] < model.gain[:, 0]).all()


def test_noise_blurred_as_the_other_image_moves_a_subset_by_what_the_model_says() -> None:
    """Slopes times blurred noise, over the squares of the slopes: the first step of a shift."""
    field, growth = from_spectrum(random_field(SIZE, 1.8, 3), NEAR), (27, 0, 0, 0)
    pattern = pattern_of(field, growth)
    rng = np.random.default_rng(2)
    x, y, half = pattern.subsets.layout[1, :3]
    cut = np.s_[y - half : y + half + 1, x - half : x + half + 1]
    slope = node_gradients(prefilter(pattern.images.grey, 5), 5)
    moved: dict[str, list[list[float]]] = {"frame": [], "reference": []}
    for _ in range(300):
        noise = smooth(rng.standard_normal((SIZE, SIZE)), BLUR_OF_ALL)
        for name, image in (("frame", noise), ("reference", _convolved(noise, kernels(growth)[0]))):
            moved[name].append([(s[cut] * image[cut]).sum() / (s[cut] ** 2).sum() for s in slope])
    plain = np.array([1.0 / (s[cut] ** 2).sum() for s in slope])
    for k, name in enumerate(("frame", "reference")):
        variance = (np.array(moved[name]) ** 2).mean(axis=0)
        assert (variance / plain).mean() == pytest.approx(pattern.noise.smoothing[1, k], rel=0.15)


def told(*growths: float, model: int = BLUR) -> Solution:
    """Answers of points that show growing blur."""
    found = empty_solution(len(growths))
    found.code[:] = SOLVED
    found.model[:] = found.needed[:] = model
    found.change[:, 2] = growths
    return found


def test_the_blur_of_a_frame_is_what_most_of_its_points_tell() -> None:
    assert more_blur(told(0.5, 0.6, 0.7)).tolist() == [0.6, 0.0, 0.0]
    assert not more_blur(told(0.5, 0.6, 0.7, model=LIGHT)).any()
    one_of_three = told(0.5, 0.6, 0.7)
    one_of_three.model[:2] = 0
    assert not more_blur(one_of_three).any()


def test_a_change_that_no_point_needs_is_none() -> None:
    by_chance = told(0.5, 0.6, 0.7)
    by_chance.needed[:] = 0
    assert not more_blur(by_chance).any()


def test_frames_of_like_blur_share_a_pattern_and_what_is_left_is_small() -> None:
    dice = np.random.default_rng(6)
    assert grown(NO_GROWTH, np.array([STEP, 0.0, 0.0])) == NO_GROWTH
    assert grown(NO_GROWTH, np.array([0.5, 0.01, 0.02]))[1:] == (0, 0, 0)  # one blur in all directions
    assert grown(NO_GROWTH, np.array([1e6, 0.0, 0.0]))[0] < 1500
    by_focus, by_path = set(), set()
    for weight, turn in dice.uniform((0.0, 0.0), (1.3, 2.0 * np.pi), (400, 2)):
        # paths have one direction only, of which the difference is as large as the mean
        path = weight * np.array([1.0, np.cos(turn), 2.0 * np.sin(turn)])
        for change, found in ((np.array([weight, 0.0, 0.0]), by_focus), (path, by_path)):
            growth = grown(NO_GROWTH, change)
            found.add(growth)
            left = change - np.array(growth[:3]) * STEP
            assert np.hypot(left[1], 0.5 * left[2]) < 0.06 + 0.2 * weight
            assert abs(left[0]) < 0.06 + 0.14 * weight
            assert kernels(growth)[1] is None  # frames that are softer everywhere are left as they are
            if weight > 0.1:  # below, whole steps are as large as the grid
                assert grown(growth, left) == growth
    assert len(by_focus) <= 16
    assert len(by_path) < 280  # of 400
    sharper = [grown(NO_GROWTH, np.array([-weight, 0.0, 0.0]))[0] * STEP + weight for weight in np.linspace(0, 1.3, 40)]
    assert np.abs(sharper).max() < 0.07


def test_patterns_are_made_once_and_few_are_kept() -> None:
    field = from_spectrum(random_field(SIZE, 1.8, 4), NEAR)
    made: list[Growth] = []

    def make(growth: Growth) -> Pattern:
        made.append(growth)
        return pattern_of(field, growth)

    patterns = Patterns(make)
    first = patterns.of((20, 0, 0, 0))
    assert patterns.of((20, 0, 0, 0)) is first
    assert made == [(20, 0, 0, 0)]
    for k in range(30):
        patterns.of((k, 0, 0, 0))
    assert len(patterns._kept) < 22
    assert patterns.of(NO_GROWTH).growth == NO_GROWTH
    assert made.count(NO_GROWTH) == 1


def test_a_blur_is_compared_with_others_once_it_is_twice_as_wide_as_those_that_were() -> None:
    known = np.zeros(2)
    assert others_like((5, 0, 0, 0), known) == []
    assert others_like((25, 0, 0, 0), known) == [[(25, 0, 0, 1)], [(25, 0, 0, 2)]]
    assert others_like((25, 0, 0, 0), np.array([0.6, 0.6])) == []
    wide = others_like((100, 0, 0, 1), known)
    assert [len(same) for same in wide] == [3, 2, 3]  # of its own shape only smaller ones
    path = others_like((50, 50, 0, 0), known)  # has one direction, and no shape
    assert path == [[(38, 38, 0, 0), (28, 28, 0, 0)]]

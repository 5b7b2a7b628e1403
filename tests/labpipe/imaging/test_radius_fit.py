import numpy as np
import pytest

from labpipe.imaging.fringes._interference import make_optics, ring_limits
from labpipe.imaging.fringes._ring_fit import FitSettings, RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import LIGHT, PARAMETERS, USUAL, Parameter
from labpipe.imaging.fringes._ring_pixels import cut_ring, pixels_in_ring
from labpipe.imaging.fringes._ring_sums import ring_sums
from tests.labpipe.imaging.fringe_film import Scene, clean_image, expose, gap_of_pressure
from tests.labpipe.imaging.oracles import plain_sums

SCENE = Scene(rows=240, columns=320)
PIXEL = SCENE.pixel_size
OPTICS = make_optics(PIXEL, SCENE.sphere_radius, SCENE.wavelength)


def start_at(a: float, x: float, y: float, scene: Scene = SCENE) -> np.ndarray:
    start = np.zeros(PARAMETERS)
    start[:5] = a / scene.pixel_size, x, y, scene.mean, scene.mean * scene.visibility
    start[Parameter.PHASE] = np.pi
    return start


def radius_of(fit: RingFit | None) -> float:
    assert fit is not None
    assert fit.is_converged
    return float(fit.parameters[Parameter.RADIUS]) * PIXEL


@pytest.mark.parametrize("last", [Parameter.BLUR, LIGHT[0], PARAMETERS])
def test_compiled_sums_equal_the_plain_ones(last: int) -> None:
    rng = np.random.default_rng(0)
    frame = expose(clean_image(SCENE, 180e-6, (150.3, 130.2), samples=2), SCENE, rng)
    parameters = start_at(180.5e-6, 150.0, 130.5)
    parameters[5 : Parameter.BLUR] = 0.02, -0.03, 0.05, 3.0, 0.004, -0.003, 2.3, 0.01
    rich = 0.4, 0.1, 0.07, -0.05, 0.002, 0.003, 0.04, 0.02, 0.01, -0.02, 0.03, 0.01, -0.01, 0.04, -0.06, 0.05
    parameters[Parameter.BLUR : last] = rich[: last - Parameter.BLUR]
    free = np.arange(last)
    inner, outer = ring_limits(parameters[0], OPTICS, 3.0, 3.0)
    for max_pixels in (100_000, 5_000):
        ring = cut_ring(frame, parameters, inner, outer, (-np.inf, 215.0), max_pixels)
        assert ring is not None
        one = ring_sums(ring, parameters, free, OPTICS, last - 2)
        other = plain_sums(ring, parameters, free, OPTICS, last - 2)
        assert one.pixels == other.pixels
        assert one.pairs == other.pairs
        for name in ("normal", "right", "weighted", "squares", "differences"):
            expected = getattr(other, name)
            scale = np.abs(expected).max()
            assert np.abs(getattr(one, name) - expected).max() < 1e-10 * scale, name


def test_a_light_that_runs_out_of_all_numbers_is_begun_anew() -> None:
    """As it does beyond the one fringe that told its cubic, once three are looked at."""
    frame = expose(clean_image(SCENE, 150e-6, (160.3, 120.2), samples=2), SCENE, np.random.default_rng(1))
    start = start_at(150.3e-6, 160.3, 120.2)
    plain = fit_contact(frame, start, OPTICS, FitSettings(free=(*USUAL, *LIGHT)))
    start[list(LIGHT)] = 700.0
    fit = fit_contact(frame, start, OPTICS, FitSettings(free=(*USUAL, *LIGHT)))
    assert radius_of(fit) == pytest.approx(radius_of(plain), abs=1e-10)
    assert fit is not None
    assert np.isfinite(fit.covariance).all()


def test_both_ways_end_at_the_same_radius(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    frame = expose(clean_image(SCENE, 150e-6, (160.3, 120.2), samples=2), SCENE, rng)
    start = start_at(151e-6, 160.0, 120.6)
    settings = FitSettings()
    fast = fit_contact(frame, start, OPTICS, settings)
    monkeypatch.setattr("labpipe.imaging.fringes._ring_fit.ring_sums", plain_sums)
    plain = fit_contact(frame, start, OPTICS, settings)
    assert fast is not None
    assert plain is not None
    assert fast.parameters == pytest.approx(plain.parameters, abs=1e-8)
    assert fast.noise == pytest.approx(plain.noise, rel=1e-9)


@pytest.mark.parametrize("a", [60e-6, 150e-6, 230e-6])
def test_noise_free_image_gives_the_radius_to_a_nanometre(a: float) -> None:
    image = clean_image(SCENE, a, (155.3, 118.2), samples=9)
    fit = fit_contact(image, start_at(a + 0.6e-6, 155.0, 118.6), OPTICS, FitSettings())
    assert radius_of(fit) == pytest.approx(a, abs=1e-9)


def test_gap_from_a_pressure_distribution_gives_the_same_radius() -> None:
    a = 150e-6
    profile = gap_of_pressure(a, SCENE.sphere_radius, reach=6.0)
    image = clean_image(SCENE, a, (155.3, 118.2), profile=profile)
    fit = fit_contact(image, start_at(a, 155.0, 118.6), OPTICS, FitSettings())
    assert radius_of(fit) == pytest.approx(a, abs=2e-9)


@pytest.mark.parametrize(("centre", "a"), [((10.0, 230.0), 200e-6), ((160.0, -40.0), 260e-6), ((340.0, 120.0), 150e-6)])
def test_cut_contacts_keep_their_radius(centre: tuple[float, float], a: float) -> None:
    image = clean_image(SCENE, a, centre, samples=7)
    fit = fit_contact(image, start_at(a + 0.3e-6, *centre), OPTICS, FitSettings())
    assert radius_of(fit) == pytest.approx(a, abs=3e-9)


def test_start_a_third_of_a_fringe_off_converges_to_the_same_radius() -> None:
    image = clean_image(SCENE, 150e-6, (155.3, 118.2), samples=3)
    near = fit_contact(image, start_at(150e-6, 155.3, 118.2), OPTICS, FitSettings())
    for dx, dy, da in ((1.2, 0.0, 0.0), (0.0, -1.2, 1e-6), (0.8, 0.8, -2e-6)):
        start = start_at(150e-6 + da, 155.3 + dx, 118.2 + dy)
        assert radius_of(fit_contact(image, start, OPTICS, FitSettings())) == pytest.approx(radius_of(near), abs=1e-9)


def test_slopes_and_vignette_do_not_move_the_radius() -> None:
    scene = SCENE.change(slope_x=0.3, slope_y=0.2, vignette=0.3, mean=90.0)
    image = clean_image(scene, 150e-6, (120.3, 150.2), samples=7)
    fit = fit_contact(image, start_at(150e-6, 120.0, 150.0), OPTICS, FitSettings())
    assert radius_of(fit) == pytest.approx(150e-6, abs=3e-9)


def test_travel_in_the_exposure_is_measured_from_the_blur() -> None:
    # The square of the radius goes evenly with time, as the approach of the bodies does.
    a, travel = 150e-6, 10e-6
    squares = a**2 + (np.arange(31) / 15.0 - 1.0) * 30.0 / 31.0 * a * travel
    images = [clean_image(SCENE, float(np.sqrt(q)), (155.3, 118.2), samples=3) for q in squares]
    fit = fit_contact(np.mean(images, axis=0), start_at(a, 155.0, 118.0), OPTICS, FitSettings())
    assert radius_of(fit) == pytest.approx(a, abs=5e-9)
    assert fit is not None
    assert np.sqrt(fit.parameters[Parameter.SMEAR]) * PIXEL == pytest.approx(travel, rel=0.02)


def test_sensitivities_are_the_shifts_that_wrong_assumptions_cause() -> None:
    a, centre = 200e-6, (155.3, 118.2)
    wrong = {
        Parameter.PHASE: (0.02, SCENE.change(phase=np.pi + 0.02)),
        Parameter.SCALE: (0.002, SCENE.change(wavelength=SCENE.wavelength * np.exp(-0.002))),
    }
    right = fit_contact(clean_image(SCENE, a, centre), start_at(a, *centre), OPTICS, FitSettings())
    assert right is not None
    for parameter, (change, scene) in wrong.items():
        fit = fit_contact(clean_image(scene, a, centre), start_at(a, *centre), OPTICS, FitSettings())
        shift = (radius_of(fit) - radius_of(right)) / PIXEL
        # What the fit gives when the assumption stays while the truth moves by `change`.
        assert shift == pytest.approx(right.sensitivity[parameter] * change, rel=0.05)


def test_saturated_pixels_are_left_out() -> None:
    scene = SCENE.change(mean=170.0)  # bright fringes at 306 of 255
    rng = np.random.default_rng(3)
    frame = expose(clean_image(scene, 150e-6, (155.3, 118.2)), scene, rng)
    start = start_at(150e-6, 155.3, 118.2, scene)
    naive = fit_contact(frame, start, OPTICS, FitSettings())
    right = fit_contact(frame, start, OPTICS, FitSettings(), (0.0, 255.0))
    assert abs(radius_of(right) - 150e-6) < 0.05e-6
    assert naive is not None
    assert right is not None
    assert right.misfit < 0.5 * naive.misfit


def test_noise_is_told_apart_from_errors_of_the_model() -> None:
    rng = np.random.default_rng(4)
    scene = SCENE.change(noise=3.0)
    frame = expose(clean_image(scene, 150e-6, (155.3, 118.2), samples=3), scene, rng)
    settings = FitSettings(free=tuple(p for p in USUAL if p is not Parameter.SMEAR))
    good = fit_contact(frame, start_at(150e-6, 155.3, 118.2), OPTICS, settings)
    blurred = clean_image(scene.change(blur=1.2), 150e-6, (155.3, 118.2), samples=3)
    bad = fit_contact(expose(blurred, scene, rng), start_at(150e-6, 155.3, 118.2), OPTICS, settings)
    assert good is not None
    assert bad is not None
    assert good.residual / good.noise == pytest.approx(1.0, abs=0.02)
    assert bad.residual / bad.noise > 2.0
    assert bad.noise == pytest.approx(3.0, rel=0.1)


def test_ring_beside_the_frame_is_no_fit() -> None:
    image = np.full((64, 64), 100, np.uint8)
    assert fit_contact(image, start_at(50e-6, 500.0, 30.0), OPTICS, FitSettings()) is None


def test_pixels_in_ring_are_counted_within_the_frame() -> None:
    y, x = np.mgrid[:100, :150]
    for centre in ((75.0, 50.0), (0.0, 0.0), (75.0, -10.0)):
        r = np.hypot(x - centre[0], y - centre[1])
        expected = int(((r > 30.0) & (r < 60.0)).sum())
        found = pixels_in_ring((100, 150), *centre, 30.0, 60.0)
        assert found == pytest.approx(expected, rel=0.02)


def test_pixels_of_a_ring_cut_by_any_edge_are_counted() -> None:
    """Row by row: the pixels of a row are a length, and an edge lies half a pixel outside."""
    shape, inner, outer = (40, 40), 3.0, 12.5
    edges = np.arange(-0.5, 39.5, 0.01)
    for x, y in ((1.0, 20.0), (38.0, 20.0), (20.0, 1.0), (-4.0, 20.0)):
        exact = 0.0
        for row in range(shape[0]):
            distance = np.hypot(edges - x, row - y)
            exact += 0.01 * np.count_nonzero((distance > inner) & (distance < outer))
        assert pixels_in_ring(shape, x, y, inner, outer) == pytest.approx(exact, abs=1.5)


def test_the_curve_of_the_light_runs_from_minus_one_to_one_over_the_ring() -> None:
    """So that it is hardly correlated with the level of the light."""
    start = start_at(50e-6, 32.0, 30.0)
    ring = cut_ring(np.zeros((64, 64)), start, 10.0, 25.0, (-np.inf, np.inf), 10_000)
    assert ring is not None
    _, _, outer, middle, factor = ring.origin
    curve = ((np.array([10.0, 25.0]) / outer) ** 2 - middle) * factor
    assert curve == pytest.approx([-1.0, 1.0])

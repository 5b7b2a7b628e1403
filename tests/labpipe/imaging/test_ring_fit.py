import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from labpipe.imaging.fringes._ring_fit import (
    USUAL,
    FitSettings,
    Parameter,
    Ring,
    RingFit,
    Sums,
    cut_ring,
    fit_contact,
    ring_sums,
    tabulate,
)
from labpipe.imaging.fringes._ring_model import SAMPLES_PER_PIXEL, Optics, make_optics, ring_limits
from tests.labpipe.imaging.fringe_film import Scene, clean_image, expose, exposed_image, surface_gap

SCENE = Scene(rows=240, columns=320)
PIXEL = SCENE.pixel_size
OPTICS = make_optics(PIXEL, SCENE.sphere_radius, SCENE.wavelength)


def start_at(a: float, x: float, y: float, scene: Scene = SCENE) -> np.ndarray:
    start = np.zeros(len(Parameter))
    start[:5] = a / scene.pixel_size, x, y, scene.mean, scene.mean * scene.visibility
    start[Parameter.PHASE] = np.pi
    return start


def radius_of(fit: RingFit | None) -> float:
    assert fit is not None
    assert fit.is_converged
    return float(fit.parameters[Parameter.RADIUS]) * PIXEL


def plain_sums(ring: Ring, parameters: np.ndarray, optics: Optics) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Normal matrix, its right side, sum of squares and pixels by array operations: the twin of the compiled loop."""
    top, left, stride = ring.corner
    p = parameters
    y, x = np.mgrid[0 : ring.image.shape[0] : stride, 0 : ring.image.shape[1]].astype(float)
    dx, dy = x + left - p[1], y + top - p[2]
    u, v = dx * (1.0 + p[9]) + dy * p[10], dy * (1.0 - p[9]) + dx * p[10]
    r, grey = np.hypot(u, v), ring.image[::stride].astype(float)
    used = (r >= ring.inner) & (r <= ring.outer) & (grey < ring.ceiling)
    start, table = tabulate((ring.inner, ring.outer), p, optics, range(19))
    places = start + np.arange(table.shape[1]) / SAMPLES_PER_PIXEL
    u, v, dx, dy, r = u[used], v[used], dx[used], dy[used], r[used]
    term, by_r, by_radius, by_phase, by_square, *by_optics = (np.interp(r, places, line) for line in table)
    across = (x[used] + left - ring.origin[0]) / ring.origin[2]
    down = (y[used] + top - ring.origin[1]) / ring.origin[2]
    curve = (across**2 + down**2 - ring.origin[3]) * ring.origin[4]
    saddle, cross = across**2 - down**2, across * down
    light = 1.0 + p[5] * across + p[6] * down + p[7] * curve + p[13] * saddle + p[14] * cross
    core, bright = p[3] + p[4] * term, p[4] * light
    steep = bright * by_r / np.maximum(r, 1e-9)
    slopes = np.stack([
        bright * by_radius, -steep * (u * (1.0 + p[9]) + v * p[10]), -steep * (v * (1.0 - p[9]) + u * p[10]),
        light, light * term, across * core, down * core, curve * core, bright * by_phase,
        steep * (u * dx - v * dy), steep * (u * dy + v * dx), bright * by_square,
        0.5 * bright * (r * by_r + p[0] * by_radius), saddle * core, cross * core,
        *(bright * line for line in by_optics),
    ])  # fmt: skip
    residual = grey[used] - light * core
    return slopes @ slopes.T, slopes @ residual, float((residual**2).sum()), int(used.sum())


@pytest.mark.parametrize("max_pixels", [100_000, 5_000])
def test_compiled_sums_equal_the_plain_ones(max_pixels: int) -> None:
    rng = np.random.default_rng(0)
    frame = expose(clean_image(SCENE, 180e-6, (150.3, 130.2), samples=2), SCENE, rng)
    parameters = start_at(180.5e-6, 150.0, 130.5)
    parameters[5:15] = 0.02, -0.03, 0.05, 3.0, 0.004, -0.003, 2.3, 0.01, 0.02, -0.01
    parameters[15:19] = 0.3, -0.05, 1e-4, 40.0**4
    ring = cut_ring(frame, parameters, *ring_limits(parameters[0], OPTICS, 3.0, 3.0), 215.0, max_pixels)
    assert ring is not None
    found: Sums = ring_sums(ring, parameters, np.arange(19), OPTICS, 19)
    normal, right, squares, pixels = plain_sums(ring, parameters, OPTICS)
    assert found.pixels == pixels
    assert found.squares == pytest.approx(squares, rel=1e-10)
    for one, other in ((found.normal, normal), (found.right, right)):
        assert np.abs(one - other).max() < 1e-9 * np.abs(other).max()


def test_noise_that_pixels_share_widens_the_uncertainty() -> None:
    """By the sandwich estimator over blocks: as the radii of films of such noise scatter."""
    image = clean_image(SCENE, 180e-6, (150.3, 130.2), samples=2)
    rng = np.random.default_rng(1)
    found, u = [], []
    for _ in range(24):
        grain = gaussian_filter(rng.standard_normal(image.shape), 1.5)
        fit = fit_contact(image + 5.0 * grain / grain.std(), start_at(180e-6, 150.3, 130.2), OPTICS, FitSettings())
        assert fit is not None
        found.append(fit.radius)
        u.append(fit.deviation(Parameter.RADIUS))
    assert np.std(found, ddof=1) == pytest.approx(np.mean(u), rel=0.4)


LIT = SCENE.change(slope_x=0.3, slope_y=0.2, vignette=0.3, mean=90.0)


@pytest.mark.parametrize(
    ("scene", "a", "centre", "limit"),
    [
        (SCENE, 60e-6, (155.3, 118.2), 1e-9),
        (SCENE, 230e-6, (155.3, 118.2), 1e-9),
        (LIT, 150e-6, (120.3, 150.2), 3e-9),
        (SCENE, 200e-6, (10.0, 230.0), 3e-9),  # cut by the frame, as are the next
        (SCENE, 260e-6, (160.0, -40.0), 3e-9),
        (SCENE, 150e-6, (340.0, 120.0), 3e-9),
    ],
)
def test_a_noise_free_image_gives_the_radius_to_nanometres(
    scene: Scene, a: float, centre: tuple[float, float], limit: float
) -> None:
    start = start_at(a + 0.5e-6, centre[0] - 0.3, centre[1] + 0.3)
    fit = fit_contact(clean_image(scene, a, centre, samples=9), start, OPTICS, FitSettings())
    assert radius_of(fit) == pytest.approx(a, abs=limit)


def test_gap_from_the_springs_of_the_contact_gives_the_same_radius() -> None:
    r = 150e-6 * (1.0 + 6.0 * np.linspace(0.0, 1.0, 4000) ** 2)
    profile = np.append(0.0, r), np.append(0.0, surface_gap(r, 150e-6, SCENE.sphere_radius))
    image = clean_image(SCENE, 150e-6, (155.3, 118.2), profile=profile)
    fit = fit_contact(image, start_at(150e-6, 155.0, 118.6), OPTICS, FitSettings())
    assert radius_of(fit) == pytest.approx(150e-6, abs=2e-9)


def test_travel_in_the_exposure_is_measured_from_the_blur() -> None:
    # The square of the radius goes evenly with time, as the approach of the bodies does.
    a, travel = 150e-6, 10e-6
    squares = a**2 + (np.arange(31) / 15.0 - 1.0) * 30.0 / 31.0 * a * travel
    image = exposed_image(SCENE, [(float(np.sqrt(square)), 0.0) for square in squares], (155.3, 118.2), 3)
    fit = fit_contact(image, start_at(a, 155.0, 118.0), OPTICS, FitSettings())
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
    right = fit_contact(frame, start, OPTICS, FitSettings(), ceiling=255.0)
    assert abs(radius_of(right) - 150e-6) < 0.05e-6
    assert naive is not None
    assert right is not None
    assert right.misfit < 0.5 * naive.misfit


def test_noise_is_told_apart_from_errors_of_the_model() -> None:
    rng = np.random.default_rng(4)
    scene = SCENE.change(noise=3.0)
    settings = FitSettings(free=tuple(p for p in USUAL if p is not Parameter.SMEAR))
    images = (clean_image(one, 150e-6, (155.3, 118.2), samples=3) for one in (scene, scene.change(blur=1.2)))
    good, bad = (
        fit_contact(expose(image, scene, rng), start_at(150e-6, 155.3, 118.2), OPTICS, settings) for image in images
    )
    assert good is not None
    assert bad is not None
    assert good.residual / good.noise == pytest.approx(1.0, abs=0.02)
    assert bad.residual / bad.noise > 2.0
    assert bad.noise == pytest.approx(3.0, rel=0.1)

import numpy as np
import pytest

from labpipe.imaging.fringes._centre_votes import find_centres
from labpipe.imaging.fringes._vote_kernel import count_lines
from tests.labpipe.imaging.fringe_film import Scene, clean_image, expose
from tests.labpipe.imaging.oracles import plain_lines

SCENE = Scene(rows=240, columns=320, slope_x=0.3, slope_y=-0.2, vignette=0.3, visibility=0.4)


def nearest(frame: np.ndarray, centre: tuple[float, float]) -> float:
    spots = list(find_centres(frame))
    return min(np.hypot(spot.x - centre[0], spot.y - centre[1]) for spot in spots)


@pytest.mark.parametrize("phase", [np.pi, 0.0])
@pytest.mark.parametrize("centre", [(160.3, 118.1), (61.4, 180.2), (170.3, -20.4), (-15.2, 100.6)])
def test_centre_is_found_to_a_third_of_a_pixel_in_uneven_light(centre: tuple[float, float], phase: float) -> None:
    scene = SCENE.change(phase=phase, sphere_radius=2.5e-3)
    image = clean_image(scene, 170e-6, centre, samples=5)
    assert nearest(expose(image, scene, np.random.default_rng(1)), centre) < 0.35


def test_even_frames_have_no_centre() -> None:
    assert list(find_centres(np.full((120, 160), 80, np.uint8))) == []


def test_stripes_have_no_common_centre() -> None:
    _, x = np.mgrid[:120, :160]
    stripes = (100.0 + 50.0 * np.cos(x / 3.0)).astype(np.uint8)
    assert all(spot.radius > 0.0 for spot in find_centres(stripes))


def test_compiled_votes_are_those_of_numpy_to_the_bit() -> None:
    noise = np.random.default_rng(3)
    angle = noise.uniform(0.0, 2.0 * np.pi, 300)
    lines = (
        *(noise.uniform(0.0, 60.0, 300), noise.uniform(0.0, 40.0, 300)),
        *(np.cos(angle), np.sin(angle), noise.uniform(0.1, 3.0, 300)),
    )
    grid = ((45, 55), 2.0, 30.0, 40)
    assert np.array_equal(count_lines(*lines, *grid), plain_lines(*lines, *grid))

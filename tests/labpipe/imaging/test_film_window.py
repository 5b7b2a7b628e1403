"""A rectangle of a frame gives the same coefficients as the whole frame."""

import numpy as np
import pytest

from labpipe.frames import ArrayFrames
from labpipe.imaging.dic._film_window import FilmWindow, smooth
from labpipe.imaging.dic._spline import PADDING

SIZE = (200, 300)


def make_window(order: int, blur: float) -> FilmWindow:
    rng = np.random.default_rng(1)
    film = rng.integers(0, 256, (4, *SIZE)).astype(np.uint8)
    return FilmWindow(ArrayFrames(film), order, blur)


@pytest.mark.parametrize("order", [3, 5])
@pytest.mark.parametrize("blur", [0.0, 0.5, 2.0])
def test_inside_its_window_a_rectangle_equals_the_whole_frame(order: int, blur: float) -> None:
    film = make_window(order, blur)
    whole = film.load(0, film.whole).coefficients.copy()
    loaded = film.load(0, (64, 256, 0, 128))
    left, right, top, bottom = loaded.window
    assert (top, left > 64, right < 255, bottom < 127) == (-0.5, True, True, True)
    x = np.arange(int(np.ceil(left)), int(right) + 1)
    y = np.arange(int(bottom) + 1)
    part = loaded.coefficients[np.ix_(y + PADDING, x - 64 + PADDING)]
    expected = whole[np.ix_(y + PADDING, x + PADDING)]
    assert np.abs(part - expected).max() < 2e-6 * np.abs(whole).max()


def test_the_box_holds_its_margins_and_stays_in_the_frame() -> None:
    film = make_window(5, 0.5)
    left, right, top, bottom = film.box_around(np.array([140.0, 171.0, 90.0, 121.0]))
    assert left <= 110
    assert right >= 201
    assert top <= 60
    assert bottom >= 151
    assert film.box_around(np.array([-900.0, -800.0, 10.0, 50.0])) == film.whole
    assert film.box_around(np.array([0.0, 299.0, 0.0, 199.0])) == film.whole


def test_frames_and_pixels_read_are_counted() -> None:
    film = make_window(3, 0.0)
    film.load(0, film.whole)
    film.load(1, film.whole)
    assert film.frames_read == 2
    assert film.pixels_read == 2 * SIZE[0] * SIZE[1]


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32, np.float64, np.int32])
@pytest.mark.parametrize("blur", [0.0, 0.5, 1.0])
def test_every_type_of_pixel_is_blurred_alike_into_kept_memory(kind: type[np.generic], blur: float) -> None:
    from scipy.ndimage import gaussian_filter

    image = np.random.default_rng(2).integers(0, 256, (40, 50)).astype(kind)
    kept = np.empty(image.shape, np.float32)
    found = smooth(image, blur, kept)
    assert found is kept
    expected = np.asarray(image, float)
    if blur:
        expected = gaussian_filter(expected, blur, mode="mirror", radius=int(np.ceil(4 * blur)))
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert smooth(image[1:], blur, kept).shape == (39, 50)

"""A rectangle of a frame gives the same coefficients as the whole frame."""

import numpy as np
import pytest

from labpipe.frames import ArrayFrames
from labpipe.imaging.dic._film_window import FilmWindow
from labpipe.imaging.dic._spline import PADDING


@pytest.mark.parametrize(("order", "blur"), [(3, 0.5), (5, 0.0), (5, 2.0)])
def test_inside_its_window_a_rectangle_equals_the_whole_frame(order: int, blur: float) -> None:
    image = np.random.default_rng(1).integers(0, 256, (1, 200, 300)).astype(np.uint8)
    film = FilmWindow(ArrayFrames(image), order, blur)
    whole = film.load(0, film.whole).coefficients.copy()
    loaded = film.load(0, (64, 256, 0, 128))
    left, right, top, bottom = loaded.window
    assert (top, left > 64, right < 255, bottom < 127) == (-0.5, True, True, True)
    x, y = np.arange(int(np.ceil(left)), int(right) + 1), np.arange(int(bottom) + 1)
    part = loaded.coefficients[np.ix_(y + PADDING, x - 64 + PADDING)]
    expected = whole[np.ix_(y + PADDING, x + PADDING)]
    assert np.abs(part - expected).max() < 2e-6 * np.abs(whole).max()

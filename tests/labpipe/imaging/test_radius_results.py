"""Parts of the uncertainty of a radius, and the decisions that rest on several frames."""

import numpy as np
import pytest

from labpipe.imaging import contact_radius
from tests.labpipe.imaging.fringe_film import Scene, clean_image, expose, fringe_film

SMALL = Scene(rows=160, columns=224, pixel_size=4e-6)


def test_a_small_contact_of_one_frame_touches_or_hovers() -> None:
    """One of 60 µm among frames without contact, and the same in a contact that grows."""
    rng = np.random.default_rng(2)
    centre = (110.3, 80.1)
    away = [expose(clean_image(SMALL, 0.0, centre, gap), SMALL, rng) for gap in (2e-6, 5e-6, 3.3e-6)]
    alone = np.concatenate([away[:2], fringe_film(SMALL, [60e-6], [centre], 1), away[2:]])
    found = contact_radius(alone, 4e-6, 9.525e-3, 633e-9)
    assert not found.in_contact.any()
    assert 60e-6 < float(found.radius_bound[2]) < 70e-6
    assert "touches or hovers" in found.attrs["note"]
    grows = np.concatenate([away[:2], fringe_film(SMALL, [60e-6, 140e-6, 170e-6], [centre] * 3, 1), away[2:]])
    found = contact_radius(grows, 4e-6, 9.525e-3, 633e-9)
    assert np.flatnonzero(found.in_contact).tolist() == [2, 3, 4]


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_disc_that_grows_and_shrinks_is_a_contact_without_fringes() -> None:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:96, :120]
    frames = []
    for radius in (20.0, 30.0, 26.0):
        disc = 30.0 + 80.0 * np.clip(np.hypot(x - 60.3, y - 48.1) - radius, 0.0, 1.0)
        frames.append((disc + 2.0 * rng.standard_normal(disc.shape)).astype(np.uint8))
    found = contact_radius(np.stack(frames), 4e-6, 9.525e-3, 633e-9)
    assert (found.method == 2).all()


def test_hot_pixels_do_not_change_a_radius() -> None:
    radii, centres = [120e-6, 160e-6, 190e-6, 170e-6], [(110.3, 80.1)] * 4
    film = fringe_film(SMALL, radii, centres, 4)
    rng = np.random.default_rng(5)
    hot = film.copy()
    hot.reshape(4, -1)[:, rng.choice(film[0].size, 120, replace=False)] = 250
    plain, found = (contact_radius(one, 4e-6, 9.525e-3, 633e-9) for one in (film, hot))
    assert "not follow the scene" in found.attrs["note"]
    assert np.abs(found.radius - plain.radius).max() < 2.0 * float(found.u_radius.max())

"""A soft round shadow is no contact, and a contact out of focus is one."""

from dataclasses import replace

import numpy as np
import pytest

from labpipe.imaging import contact_radius
from pipelines.bench.contact_radius import Scene, make_film
from tests.by_day import by_day
from tests.labpipe.imaging.contact_scenes import Disturbed, film_of, gap_of_jkr
from tests.labpipe.imaging.fringe_film import Scene as Optics

SCENE = Scene(rows=320, columns=420, radius=240e-6, centre=(208.3, 161.2))


@pytest.mark.parametrize("softness", by_day([9.0, 14.0], 1))
def test_a_soft_disc_without_fringes_is_no_contact(softness: float) -> None:
    y, x = np.mgrid[:320, :420]
    grey = 120.0 + 70.0 * np.tanh((np.hypot(x - 208.0, y - 161.0) - 110.0) / softness)
    noise = 5.0 * np.random.default_rng(1).standard_normal((2, 320, 420))
    film = np.clip(np.rint(grey + noise), 0.0, 255.0).astype(np.uint8)
    with pytest.warns(UserWarning, match="spots in 2 frames have neither the fringes nor the sharp edge"):
        found = contact_radius(film, SCENE.pixel, SCENE.sphere, SCENE.wavelength)
    assert not found.in_contact.any()


def test_a_single_frame_of_an_edge_without_fringes_is_measured_by_it() -> None:
    y, x = np.mgrid[:320, :420]
    grey = 100.0 + 40.0 * np.tanh(0.5 * (np.hypot(x - 208.0, y - 161.0) - 110.0))
    noise = 5.0 * np.random.default_rng(1).standard_normal((1, 320, 420))
    film = np.clip(np.rint(grey + noise), 0.0, 255.0).astype(np.uint8)
    with pytest.warns(UserWarning, match="measured by the edge of the spot"):
        found = contact_radius(film, SCENE.pixel, SCENE.sphere, SCENE.wavelength)
    assert found.method.item() == 2


@pytest.mark.parametrize("blur", by_day([8.0, 4.0], 1))
def test_a_contact_out_of_focus_is_measured_all_the_same(blur: float) -> None:
    found = contact_radius(make_film(replace(SCENE, blur=blur), 2, 1), SCENE.pixel, SCENE.sphere, SCENE.wavelength)
    assert (found.method == 1).all()
    u = np.hypot(found.u_radius, found.radius_systematic)
    assert (np.abs(found.radius - SCENE.radius) < 3.0 * u).all()
    assert (u < 0.2e-6).all()


def test_contacts_whose_rings_a_lens_has_blurred_away_are_found_by_their_edges() -> None:
    """Smaller ones tell the blur: a growing contact of 400 to 760 µm was taken for nothing beside an empty frame."""
    radii = [650e-6, 720e-6, 0.0, 150e-6, 170e-6]
    scene = Disturbed(Optics(rows=160, columns=416, pixel_size=4.34e-6, blur=5.0))
    film = film_of(scene, lambda r, a: gap_of_jkr(r, a, SCENE.sphere, 5e9, 0.0), radii, (212.3, 77.2))
    with pytest.warns(UserWarning, match="in contact .* measured by the edge"):
        found = contact_radius(film, 4.34e-6, SCENE.sphere, 633e-9)
    # the blur is known from the smaller ones: rings of a larger one may be fitted with it
    assert found.method.values[2:].tolist() == [0, 1, 1]
    assert set(found.method.values[:2]) <= {1, 2}
    u = np.hypot(found.u_radius, found.radius_systematic).values
    pressed = np.array(radii) > 0.0
    assert (np.abs(found.radius.values - radii)[pressed] < 3.0 * u[pressed]).all()

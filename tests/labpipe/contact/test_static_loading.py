"""A sphere under load steps against exact creep laws and the rest state of a bounce train."""

import numpy as np
import pytest

from labpipe.contact.sphere._static_loading import load_sphere, press_sphere
from labpipe.errors import InputError
from labpipe.materials import Prony

RADIUS = 9.525e-3
SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)


def test_exact_sphere_differs_by_the_known_amount() -> None:
    radius = np.sqrt(RADIUS * 7e-5)
    parabola = press_sphere(SLS, RADIUS, [0.0], [7e-5])
    sphere = press_sphere(SLS, RADIUS, [0.0], [7e-5], profile="sphere")
    ratio = float(sphere.force[0] / parabola.force[0])
    assert ratio == pytest.approx(1.0 - 0.1 * (radius / RADIUS) ** 2, abs=3e-5)


def test_unloading_to_nothing_leaves_a_dent_that_recovers() -> None:
    found = load_sphere(SLS, RADIUS, [0.0, 0.1, 0.1, 0.101, 0.2], [5.0, 5.0, 0.0, 0.0, 0.0])
    approach = found.approach.values
    assert approach[2] > approach[3] > approach[4] >= 0.0
    assert approach[4] < 1e-12
    assert np.all(found.contact_radius.values[2:] == 0.0)


@pytest.mark.parametrize(("load", "match"), [([1.0, -1.0], r"load\[1\]"), ([1.0, np.nan], r"load\[1\] is nan")])
def test_bad_loads_are_refused_with_the_place(load, match) -> None:
    with pytest.raises(InputError, match=match):
        load_sphere(SLS, RADIUS, [0.0, 1.0], load)


def test_a_contact_as_wide_as_the_sphere_is_refused() -> None:
    with pytest.raises(InputError, match="as wide as the sphere"):
        load_sphere(Prony(1e3, [], [], nu=0.5), RADIUS, [0.0], [50.0], profile="sphere")

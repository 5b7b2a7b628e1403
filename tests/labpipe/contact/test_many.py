"""The first impacts of many drops against one drop at a time."""

import json

import numpy as np
import pytest

from labpipe.contact import Plate, drop, impacts
from labpipe.errors import InputError
from labpipe.materials import Prony

SOLID = Prony(1e9, [1e9, 5e8, 2e8], [1e-5, 5e-4, 1e-2], nu=0.35)
LIQUID = Prony(0.0, [2e9, 1e9], [1e-3, 1e-2], nu=0.35)
R, MASS = 9.525e-3, 0.505
HEIGHTS = [0.5e-3, 1.5e-3, 4e-3]
NAMES = ("impact_time", "lift_off_time", "contact_duration", "impact_speed", "rebound_speed", "restitution")
PEAKS = ("peak_force", "peak_contact_radius", "peak_approach", "penetration")


@pytest.mark.parametrize(
    ("material", "plate", "profile"),
    [
        (SOLID, None, "sphere"),
        (SOLID, Plate(2.0, 1e4), "parabola"),
        (LIQUID, Plate(20.0, 180.0, 0.02), "parabola"),
        (LIQUID, None, "parabola"),
    ],
)
def test_each_is_as_if_dropped_alone(material, plate, profile):
    rtol = 1e-5
    found = impacts(material, R, MASS, HEIGHTS, 0.08, 3, profile, rtol, plate=plate)
    for i, height in enumerate(HEIGHTS):
        alone = drop(material, R, MASS, height, 0.08, profile=profile, rtol=rtol, plate=plate)
        happened = min(alone.sizes["impact"], 3)
        assert int(found["impacts"][i]) == happened > 0
        for name in (*NAMES, *PEAKS):
            np.testing.assert_allclose(found[name].values[i, :happened], alone[name].values[:happened], rtol=10 * rtol)
            assert np.isnan(found[name].values[i, happened:]).all()
            assert found[name].attrs == alone[name].attrs


def test_each_may_have_its_own_of_everything():
    solids, radii, masses = [SOLID, LIQUID, SOLID], [5e-3, 8e-3, "9.525 mm"], ["100 g", 0.3, 0.505]
    plates, gravity, fall = [None, Plate(20.0, 180.0, 0.02), None], [9.8, 9.81, 9.82], [0.03, 0.04, 0.08]
    found = impacts(solids, radii, masses, HEIGHTS, fall, plate=plates, gravity=gravity)
    for i in range(3):
        alone = drop(solids[i], radii[i], masses[i], HEIGHTS[i], fall[i], plate=plates[i], gravity=gravity[i])
        assert float(found["restitution"][i, 0]) == pytest.approx(float(alone["restitution"][0]), rel=1e-4)


@pytest.mark.parametrize("plate", [None, Plate(30.0, 180.0, 0.03), Plate(30.0, 700.0), Plate(1.0, 60.0, 0.02)], ids=str)
def test_a_sphere_that_stays_is_not_followed_to_its_rest(plate):
    """Which touch is the last is known before it has come to rest, also on a plate that rings on."""
    material, height = Prony(0.0, [3e8, 1e8], [2e-4, 1e-1], nu=0.35), 1e-3
    found = impacts(material, R, MASS, height, 0.6, 20, plate=plate)
    alone = drop(material, R, MASS, height, 0.6, plate=plate)
    happened = alone.sizes["impact"]
    assert int(found["impacts"][0]) == happened
    np.testing.assert_allclose(found["impact_time"][0, :happened], alone["impact_time"], rtol=1e-6)
    touched = float(alone["impact_time"][-1]) if happened else 0.0
    assert float(found["final_contact_time"][0]) > touched
    if np.isfinite(alone["final_contact_time"]):
        assert float(found["final_contact_time"][0]) == pytest.approx(float(alone["final_contact_time"]), rel=1e-9)
    assert int(found["solver_steps"][0]) < 0.7 * json.loads(alone.attrs["work"])["solver_steps"]


def test_what_is_given_is_checked():
    with pytest.raises(InputError, match="radius has 2, mass has 3"):
        impacts(SOLID, [R, R], [MASS] * 3, 1e-3, 0.05)
    with pytest.raises(InputError, match="height is -1"):
        impacts(SOLID, R, MASS, [1e-3, -1.0], 0.05)
    with pytest.raises(InputError, match="wider than the sphere"):
        impacts(Prony(1e3, [1e3], [1e-3], nu=0.35), R, MASS, 1e-3, 0.05)

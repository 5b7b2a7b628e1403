"""The substrate as an oscillator."""

import numpy as np
import pytest

from labpipe.contact import drop, impacts
from labpipe.contact.impact import Plate
from labpipe.errors import InputError
from labpipe.materials import Prony


@pytest.mark.parametrize(
    ("mass", "frequency", "damping_ratio"),
    [(0.0, 1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, -0.1), (np.nan, 1.0, 0.0)],
)
def test_impossible_plates_are_refused(mass, frequency, damping_ratio):
    with pytest.raises(InputError, match="plate"):
        Plate(mass, frequency, damping_ratio)


def test_penetration_is_of_the_sphere_where_the_plate_gives_way() -> None:
    """The plate is pushed ahead: the sphere sinks deeper than both approach each other."""
    case = {"radius": 9.525e-3, "mass": 0.505, "height": 5e-3, "duration": 0.05, "plate": Plate(25.0, 220.0, 0.03)}
    solid = Prony(3.0e9, [2e8], [1e-3], nu=0.35)
    plain = drop(solid, **case)
    touch, lasts = float(plain.impact_time[0]), float(plain.contact_duration[0])
    seen = drop(solid, **case, times=np.linspace(touch, touch + lasts, 4001))
    assert float(plain.penetration[0]) == pytest.approx(-float(seen.displacement.min()), rel=1e-6)
    assert float(impacts(solid, **case).penetration[0, 0]) == pytest.approx(float(plain.penetration[0]), rel=1e-4)
    assert float(plain.penetration[0]) > 1.005 * float(plain.peak_approach[0])

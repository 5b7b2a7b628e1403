import warnings

import numpy as np
import pytest
import xarray as xr

from labpipe.contact import Plate
from labpipe.contact.impact import drop
from labpipe.materials import Prony
from labpipe.signals import Floor, bounces

_RHO = np.logspace(-7.0, 1.0, 33)
BALLS = {
    # a rubber in its transition: the modulus falls as t^-0.4 while the sphere is met
    "soft": ("polymer", Prony(2e7, 4e6 * (_RHO / 1e-3) ** -0.4, _RHO, nu=0.49)),
    # as quick as a twentieth of the contact
    "one relaxation time": ("any", Prony(1e9, [6e8], [5e-5], nu=0.4)),
}


@pytest.mark.parametrize("name", BALLS)
def test_first_three_restitutions_are_as_uncertain_as_stated(name: str) -> None:
    """The force begins as t^(3/2 - 0.4), which Hertz's exponent missed by seven u of the touch."""
    contact, solid = BALLS[name]
    time = np.arange(0.0, 0.3, 5e-5)
    release = 0.02
    truth = drop(solid, 9.525e-3, 0.505, 5e-3, 0.28, times=np.maximum(time - release, 0.0)[400:], rtol=1e-5)
    motion = np.concatenate([np.full(400, 5e-3), truth["displacement"].values])
    z = []
    for seed in range(4):
        values = motion + 1e-6 * np.random.default_rng(seed).standard_normal(time.size)
        record = xr.DataArray(values, {"time": time}, ["time"], attrs={"units": "m"})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the record ends before rest
            found = bounces(record, contact=contact)
        for quantity, exact in (
            ("restitution", truth["restitution"].values),
            ("touch_time", release + truth["impact_time"].values),
            ("liftoff_time", release + truth["lift_off_time"].values),
        ):
            z.append((found[quantity].values[:3] - exact[:3]) / found[f"u_{quantity}"].values[:3])
    assert np.sqrt(np.mean(np.square(z))) < 1.5
    assert np.abs(z).max() < 3.5
    assert found["u_restitution"].values[:3].max() < 0.01


_MASS = 0.505
_TIMES = np.logspace(-8.0, 1.0, 28)
STIFF = Prony(2.5e9, 4e7 * (_TIMES / 1e-3) ** -0.06, _TIMES, nu=0.38)
"""A plastic that returns nearly all of its speed, so that most of the loss is a light plate's."""


def test_on_a_light_plate_restitutions_are_free_of_its_part() -> None:
    """Without the plate's mass the first impact is 1.1 u too low."""
    mass, release, height = 20.0, 0.02, 5e-3
    plate = Plate(mass, 220.0, 0.03)
    time = np.arange(0.0, 0.18, 5e-5)
    truth = drop(
        STIFF, 9.525e-3, _MASS, height, 0.16, times=np.maximum(time - release, 0.0)[400:], rtol=1e-5, plate=plate
    )
    motion = np.concatenate([np.full(400, height), truth["displacement"].values])
    floor = Floor(_MASS / mass, 220.0)
    z: dict[str, list[float]] = {"known": [], "any": []}
    for seed in range(3):
        values = motion + 1e-6 * np.random.default_rng(seed).standard_normal(time.size)
        record = xr.DataArray(values, {"time": time}, ["time"], attrs={"units": "m"})
        for name, beneath in (("known", floor), ("any", None)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # the record ends before rest
                found = bounces(record, contact="polymer", floor=beneath)
            error = found["restitution"].values[:2] - truth["restitution"].values[:2]
            z[name].append((error / found["u_restitution"].values[:2]).tolist())
    known, unknown = np.mean(z["known"], axis=0), np.mean(z["any"], axis=0)
    assert abs(known).max() < 0.6
    assert abs(known).max() < abs(unknown).max()

import warnings

import numpy as np
import pytest
import xarray as xr

from labpipe.contact import Plate
from labpipe.contact.impact import drop
from labpipe.materials import Prony
from labpipe.signals import Floor, bounces
from labpipe.signals._floor import Beneath

_MASS = 0.505
_RHO = np.logspace(-8.0, 1.0, 28)
STIFF = Prony(2.5e9, 4e7 * (_RHO / 1e-3) ** -0.06, _RHO, nu=0.38)
"""A plastic that returns nearly all of its speed, so that most of the loss is a light plate's."""


def test_a_struck_plate_moves_as_its_equation_says() -> None:
    """Many small steps of u'' = share a - w^2 u - 2 z w u' end where the answer to a unit does."""
    floor, length, waits = Floor(0.03, 220.0, 0.04), 1.2e-3, 7e-3
    pulse = 400.0 * np.sin(np.linspace(0.0, np.pi, 201)) ** 1.5
    met, after = Beneath(floor, 2e-6, -1e-3, 0.1).struck(0.1 + waits, length, pulse)
    whole, n = 2 * np.pi * 220.0, 40_000
    place, speed, step = 2e-6, -1e-3, (waits + length) / n
    for i in range(n):
        t = (i + 0.5) * step - waits
        force = 0.03 * np.interp(t, np.linspace(0.0, length, 201), pulse) if t > 0.0 else 0.0
        speed += step * (force - whole**2 * place - 2 * 0.04 * whole * speed)
        place += step * speed
    assert after.displacement == pytest.approx(place, rel=2e-3)
    assert after.speed == pytest.approx(speed, rel=2e-3)
    assert met.pull[-1] == pytest.approx(whole**2 * place + 2 * 0.04 * whole * speed, rel=2e-3)
    assert after.time == pytest.approx(0.1 + waits + length)


@pytest.mark.parametrize("mass", [20.0, 45.0])
def test_on_a_light_plate_restitutions_are_free_of_its_part(mass: float) -> None:
    """Without the plate's mass the first impact is 0.4 u (45 kg) to 1.1 u (20 kg) too low."""
    plate, release, height = Plate(mass, 220.0, 0.03), 0.02, 5e-3
    time = np.arange(0.0, 0.18, 5e-5)
    truth = drop(
        STIFF, 9.525e-3, _MASS, height, 0.16, times=np.maximum(time - release, 0.0)[400:], rtol=1e-5, plate=plate
    )
    motion = np.concatenate([np.full(400, height), truth["displacement"].values])
    floor = Floor(_MASS / mass, 220.0, 0.03)
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

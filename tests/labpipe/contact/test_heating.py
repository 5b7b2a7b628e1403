"""Self-heating: closed forms against quadrature of point sources, bounds in order, a verdict."""

import numpy as np
import pytest
from scipy.integrate import quad

from labpipe import contact, materials
from labpipe.contact import self_heating
from labpipe.contact._heating import remaining_share
from labpipe.errors import InputError
from labpipe.materials import Thermal, thermal

SOLID = Thermal(1180.0, 1470.0, 0.19)


@pytest.mark.parametrize("time", [0.1, 30.0])
def test_a_hot_sphere_cools_as_the_sum_of_its_point_sources(time: float) -> None:
    radius = 1e-3
    four = 4.0 * SOLID.diffusivity * time

    def shell(r: float) -> float:
        return float(4.0 * np.pi * r**2 * np.exp(-(r**2) / four) / (np.pi * four) ** 1.5)

    share, _ = quad(shell, 0.0, radius, epsrel=1e-12)
    assert float(remaining_share(radius, time, SOLID)) == pytest.approx(share, rel=1e-9)


def test_heat_of_a_train_is_that_of_the_ledger_and_the_bounds_are_in_order() -> None:
    acrylic = materials.describe("acrylic")
    drop = contact.drop(acrylic.prony, 9.525e-3, 0.505, 1.5e-3, 0.15, rtol=1e-3)
    table = self_heating(drop, acrylic, thermal("acrylic"))
    solid = thermal("acrylic")
    volume = 2.0 / 3.0 * np.pi * drop["peak_contact_radius"].values ** 3
    heat = float((table["bulk_rise"].values * volume).sum()) * solid.density * solid.heat_capacity
    assert heat == pytest.approx(float(drop["dissipated_energy"][-1]), rel=1e-6)
    assert (table["bulk_rise"] <= table["train_rise"] + 1e-12).all()
    assert (table["train_rise"] <= table["train_rise_adiabatic"]).all()
    assert np.all(np.diff(table["train_rise_adiabatic"].values) > 0.0)
    assert 0.3 < float(table["bulk_rise"].max()) < 0.8
    assert np.all(table["modulus_change"].values < 0.0)


def test_one_impact_is_negligible_and_a_long_train_of_a_lossy_solid_is_not() -> None:
    acrylic, ptfe = materials.describe("acrylic"), materials.describe("ptfe")
    one = contact.drop(acrylic.prony, 9.525e-3, 0.505, 1.5e-3, 0.03, rtol=1e-3)
    assert self_heating(one, acrylic, thermal("acrylic")).verdict == "negligible"
    train = contact.drop(ptfe.prony, 9.525e-3, 0.505, 10e-3, 0.2, rtol=1e-3)
    found = self_heating(train, ptfe, thermal("ptfe"), temperature=20.0)
    assert found.verdict == "matters"
    assert np.all(np.diff(found["modulus_change"].values) < 0.0)


def test_what_cannot_be_estimated_is_refused() -> None:
    acrylic = materials.describe("acrylic")
    falling = contact.drop(acrylic.prony, 9.525e-3, 0.505, 1.5e-3, 0.01, rtol=1e-3)
    with pytest.raises(InputError, match="at least one completed impact"):
        self_heating(falling, acrylic, SOLID)

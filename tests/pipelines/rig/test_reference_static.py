"""The rig's static loading against closed forms, and against the bundled simulator."""

import numpy as np
import pytest

from labpipe import contact, materials
from pipelines.rig.solids import Element, Viscoelastic, solid_of
from pipelines.rig.static_loading import reference_static


def test_the_compliance_of_the_standard_linear_solid() -> None:
    """Closed form: J = 1/E_r - (1/E_r - 1/E_u) exp(-t/tau), tau = rho E_u/E_r."""
    relaxed, branch, rho = 2e9, 3e9, 5.0
    time = np.geomspace(1e-2, 1e3, 40)
    unrelaxed = relaxed + branch
    known = 1 / relaxed - (1 / relaxed - 1 / unrelaxed) * np.exp(-time * relaxed / unrelaxed / rho)
    found = Viscoelastic((Element(branch, rho),), relaxed, 0.3).creep(time)
    np.testing.assert_allclose(found, known, rtol=1e-10)


@pytest.mark.parametrize("flat", [None, (5e9, 0.2)])
def test_steps_of_load_agree_with_the_simulator(flat: tuple[float, float] | None) -> None:
    solid = materials.load("ptfe")
    begin, load = np.array([0.0, 100.0, 400.0]), np.array([5.0, 25.0, 35.0])
    ends = np.array([100.0, 400.0, 900.0])
    stretches = [b + np.concatenate([[0.0], np.geomspace(0.5, e - b, 25)]) for b, e in zip(begin, ends, strict=True)]
    loads, disc = np.repeat(load, [s.size for s in stretches]), 0.0 if flat is None else (1 - flat[1] ** 2) / flat[0]
    made = contact.load_sphere(solid, 9.525e-3, np.concatenate(stretches), loads, substrate=flat)
    time = np.concatenate([s[1:-1] for s in stretches])
    found = reference_static(solid_of(solid), radius=9.525e-3, load_times=begin, loads=load, time=time, disc=disc)
    simulated = np.concatenate([made["approach"].values[i * 26 + 1 : (i + 1) * 26 - 1] for i in range(3)])
    np.testing.assert_allclose(simulated, found, rtol=1e-5)

"""An elastic counter-body adds its compliance: against Hertz of two bodies, and one body with the summed creep."""

import numpy as np
import pytest

from labpipe import contact
from labpipe.contact.sphere._counter_body import COUNTER_BODIES
from labpipe.materials import Prony

RADIUS, MASS = 9.525e-3, 0.505


def test_two_elastic_bodies_are_those_of_hertz() -> None:
    """1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2."""
    softness = (1 - 0.35**2) / 3.2e9 + (1 - 0.3**2) / 70e9
    found = contact.drop(
        Prony(3.2e9, [], [], nu=0.35), RADIUS, MASS, 1.5e-3, 0.03, substrate=("70 GPa", 0.3), rtol=1e-6
    )
    deepest = 0.0
    for _ in range(60):
        deepest = (15 / 8 * MASS * 9.81 * (1.5e-3 + deepest) * softness / np.sqrt(RADIUS)) ** 0.4
    assert float(found.peak_approach[0]) == pytest.approx(deepest, rel=1e-7)
    assert float(found.peak_force[0]) == pytest.approx(4 / 3 / softness * np.sqrt(RADIUS) * deepest**1.5, rel=1e-7)


def test_a_viscoelastic_sphere_on_an_elastic_body_is_the_sphere_with_the_summed_creep() -> None:
    """J1(t) + J2 as one material on a rigid flat."""
    sphere, E, nu = Prony.from_creep(2e9, [0.2e-9, 0.05e-9], [1e-3, 1e-1], nu=0.35), 20e9, 0.2
    added = (1 - nu**2) / E / (1 - 0.35**2)
    both = Prony.from_creep(1 / (1 / 2e9 + added), [0.2e-9, 0.05e-9], [1e-3, 1e-1], nu=0.35)
    fall = (RADIUS, MASS, 1.5e-3, 0.03)
    found, exact = contact.drop(sphere, *fall, substrate=(E, nu)), contact.drop(both, *fall)
    for name in ("peak_force", "restitution", "contact_duration"):
        assert float(found[name][0]) == pytest.approx(float(exact[name][0]), rel=1e-9)


def test_sapphire_is_the_average_of_its_single_crystal() -> None:
    """Voigt and Reuss bound Hill's average, from the constants that the source states (trigonal, GPa)."""
    C11, C12, C13, C14, C33, C44 = 497.0, 163.0, 116.0, -22.0, 501.0, 147.0
    stiffness = np.array([
        [C11, C12, C13, C14, 0.0, 0.0],
        [C12, C11, C13, -C14, 0.0, 0.0],
        [C13, C13, C33, 0.0, 0.0, 0.0],
        [C14, -C14, 0.0, C44, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, C44, C14],
        [0.0, 0.0, 0.0, 0.0, C14, 0.5 * (C11 - C12)],
    ])  # fmt: skip
    bulk, shear = [], []
    for matrix, is_stiffness in ((stiffness, True), (np.linalg.inv(stiffness), False)):
        normal, shearing = matrix[:3, :3], np.trace(matrix[3:, 3:])
        trace, others = np.trace(normal), normal.sum() - np.trace(normal)
        bulk.append((trace + others) / 9 if is_stiffness else 1 / (trace + others))
        shear.append(
            (trace - others / 2 + 3 * shearing) / 15 if is_stiffness else 15 / (4 * trace - 2 * others + 3 * shearing)
        )
    young = [9 * K * G / (3 * K + G) for K, G in zip(bulk, shear, strict=True)]
    K, G = np.mean(bulk), np.mean(shear)
    sapphire = COUNTER_BODIES["sapphire"]
    assert pytest.approx(1e9 * 9 * K * G / (3 * K + G), rel=1e-4) == sapphire.E
    assert sapphire.nu == pytest.approx((3 * K - 2 * G) / (6 * K + 2 * G), abs=5e-4)
    assert sapphire.u_E > 1e9 * np.ptp(young) / 2


def test_sapphire_takes_about_a_percent() -> None:
    """Below acrylic; a batch and a single drop have the same counter-body."""
    assert COUNTER_BODIES["sapphire"].compliance == pytest.approx(1 / 426.6e9, rel=1e-3)
    fall = ("acrylic", RADIUS, MASS, 1.5e-3, 0.03)
    rigid, sapphire = (contact.drop(*fall, substrate=body) for body in (None, "sapphire"))
    ratio = float(sapphire.peak_force[0] / rigid.peak_force[0])
    assert 0.994 < ratio < 0.998
    batch = contact.impacts(*fall, substrate="sapphire")
    assert float(batch.peak_force[0, 0]) == pytest.approx(float(sapphire.peak_force[0]), rel=1e-5)

"""The Prony solid: closed forms, identities of linear viscoelasticity, refusals."""

import pickle

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.materials import Prony
from tests.rounding import rounding

OMEGA = np.logspace(-6, 14, 81)
# Fifteen terms of some ten operations each.
EXACT = rounding(10 * 15)


@pytest.fixture
def acrylic_like():
    """PMMA15 of the contact reference: 15 equal creep terms over 12 decades, 2 to 6 GPa."""
    strength = (1 / 2e9 - 1 / 6e9) / 15
    return Prony.from_creep(2e9, np.full(15, strength), np.logspace(-10, 2, 15), nu=0.35)


def test_modulus_times_compliance_is_one(acrylic_like):
    liquid = Prony(0.0, [1e6, 3e5, 1e2], [1e-6, 1e-2, 10.0])
    voigt = Prony.from_creep(3.0, [1 / 9, 2 / 9], [1.0, 5.0])
    for solid in (acrylic_like, liquid, voigt, acrylic_like.shifted(1e5)):
        C, tau = solid.creep_terms()
        unrelaxed = 0.0 if solid.viscosity > 0 else 1 / solid.E_unrelaxed
        compliance = unrelaxed + (C / (1 + 1j * OMEGA[:, None] * tau)).sum(axis=1) - 1j * solid.fluidity / OMEGA
        assert np.abs(solid.complex_modulus(OMEGA) * compliance - 1).max() < EXACT


def test_weak_terms_come_back_from_the_creep_in_all_their_digits():
    time = np.logspace(-10, 4, 43)
    weight = 1e8 * np.exp(-0.5 * ((np.log10(time) + 3) / 4) ** 2)
    weight[::3] *= 1e-10
    back = Prony.from_creep(1e6, *Prony(1e6, weight, time).creep_terms())
    np.testing.assert_allclose(back.E, weight, rtol=rounding(20 * 43**2))
    np.testing.assert_allclose(back.rho, time, rtol=rounding(20 * 43))


def test_maxwell_element_and_standard_linear_solid_are_as_printed_in_the_thesis():
    time, x = np.array([0.0, 0.1, 1.0, 7.0, 50.0]), np.array([0.01, 0.3, 1.0, 20.0])
    spring, dashpot, unrelaxed = 2e6, 6e6, 8e6
    tau, beta = dashpot / spring, unrelaxed / spring
    element = Prony(0.0, [spring], [tau])
    np.testing.assert_allclose(element.relaxation(time), spring * np.exp(-time / tau))  # (1.33)
    np.testing.assert_allclose(element.creep(time), 1 / spring + time / dashpot)  # (1.34)
    np.testing.assert_allclose(element.complex_modulus(x / tau), spring * (x**2 + 1j * x) / (1 + x**2))  # (1.36)
    solid = Prony(spring, [unrelaxed - spring], [tau])
    np.testing.assert_allclose(solid.relaxation(time), spring + (unrelaxed - spring) * np.exp(-time / tau))  # (1.37)
    creep = 1 / spring + (1 / unrelaxed - 1 / spring) * np.exp(-time / (beta * tau))  # (1.40)
    np.testing.assert_allclose(solid.creep(time), creep, rtol=1e-13)


def test_shift_moves_times_and_the_frequency_axis(acrylic_like):
    cold = acrylic_like.shifted(1e3, b_T=1.1)
    expected = 1.1 * acrylic_like.complex_modulus(1e3 * OMEGA)
    np.testing.assert_allclose(cold.complex_modulus(OMEGA), expected, rtol=EXACT)
    np.testing.assert_allclose(cold.creep_terms()[1], 1e3 * np.logspace(-10, 2, 15), rtol=EXACT)
    assert cold.creep(1.0) == pytest.approx(acrylic_like.creep(1e-3) / 1.1, rel=EXACT, abs=0.0)


def test_shear_and_contact_moduli():
    solid = Prony(1e6, [2e6], [1.0], nu=0.4).scaled(2 * 1.4)
    assert solid.E_relaxed == pytest.approx(2.8e6)
    assert solid.relaxation(0.0, "shear") == pytest.approx(3e6)
    assert solid.complex_modulus(0.0, "contact") == pytest.approx(2.8e6 / 0.84)
    assert solid.creep(0.0, "shear") == pytest.approx(1 / 3e6, rel=1e-6, abs=0.0)


def test_copies_are_identical_and_read_only(acrylic_like):
    for solid in (acrylic_like, Prony(1.0, [2.0], [3.0]), acrylic_like.shifted(2.0)):
        copy = pickle.loads(pickle.dumps(solid))  # noqa: S301
        assert copy == solid
        assert hash(copy) == hash(solid)
        for array in (copy.E, copy.rho, *copy.creep_terms()):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0
    assert acrylic_like != acrylic_like.scaled(2.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Prony(-1.0, [], []), "E_relaxed = -1.0"),
        (lambda: Prony(0.0, [], []), "no stiffness"),
        (lambda: Prony(1.0, [1.0], []), "equal length"),
        (lambda: Prony(1.0, [1.0, -2.0], [1.0, 2.0]), r"E\[1\] = -2.0: with a negative weight"),
        (lambda: Prony(1.0, [1.0], [0.0]), r"rho\[0\] = 0.0 s"),
        (lambda: Prony(1.0, [], [], nu=0.51), "Poisson"),
        (lambda: Prony.from_creep(0.0, [1.0], [1.0]), "positive long-time modulus"),
        (lambda: Prony.from_creep(1.0, [2.0], [1.0]), "exceeds"),
        (lambda: Prony.from_creep(1.0, [-0.1], [1.0]), r"C\[0\] = -0.1"),
        (lambda: Prony(1.0, [], []).shifted(0.0), "a_T = 0.0"),
        (lambda: Prony(1.0, [], []).scaled(-1.0), "positive number"),
        (lambda: Prony(1.0, [], []).complex_modulus([1.0, -1.0]), "defined for omega ≥ 0"),
        (lambda: Prony(1.0, [], []).relaxation(1.0, "torsion"), "unknown"),
    ],
)
def test_inadmissible_materials_are_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()

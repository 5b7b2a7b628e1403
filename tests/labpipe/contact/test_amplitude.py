"""Amplitude-dependent indentation: Kraus's kinetics, the linear limit, what softening does."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from labpipe.contact import amplitude_sweep, dissipated_work, dynamic_stiffness
from labpipe.errors import InputError
from labpipe.materials import Kraus, Prony
from tests.rounding import rounding

RUBBER = Prony(7.6e6, [10e6, 20e6], [0.1, 1e-3], nu=0.5)
FILLED = Kraus(0.01, storage_floor=0.3, loss_peak=1.6, loss_floor=0.6)
PUNCH = (1e-4, 2e-3, 8e-3)


@pytest.mark.parametrize("strain", [1e-4, 3e-3, 0.01, 0.2])
def test_the_share_of_whole_links_is_where_breaking_and_forming_balance(strain: float) -> None:
    """Rates ∝ γ^m and γ^−m; the kinetic equation run to its steady state."""
    m, breaking = FILLED.exponent, (strain / FILLED.critical_strain) ** FILLED.exponent

    def rate(_: float, whole: np.ndarray) -> np.ndarray:
        return np.asarray(-breaking * whole + (1.0 - whole) / breaking)

    late = solve_ivp(rate, (0.0, 400.0), [0.0], rtol=1e-10, atol=1e-13, method="LSODA").y[0, -1]
    assert m == 0.6
    assert float(FILLED.whole_links(strain)) == pytest.approx(late, rel=1e-7)


def test_half_the_drop_and_the_peak_of_the_loss_lie_at_the_critical_strain() -> None:
    assert float(FILLED.storage_share(0.01)) == pytest.approx(0.65, abs=rounding(10))
    plain = Kraus(0.01, storage_floor=0.3, loss_peak=1.6, loss_floor=1.0)
    strains = np.geomspace(1e-5, 10.0, 20001)
    loss = plain.loss_share(strains)
    assert strains[np.argmax(loss)] == pytest.approx(0.01, rel=1e-3)
    assert loss.max() == pytest.approx(1.6, rel=1e-6)


def test_storage_and_loss_lie_on_a_circle() -> None:
    """(2x/(1+x²))² = 4 h (1 − h), h the share of whole links: a Cole-Cole plot over amplitude."""
    plain = Kraus(0.02, storage_floor=0.4, loss_peak=2.0, loss_floor=1.0, exponent=0.5)
    strains = np.geomspace(1e-6, 100.0, 50)
    whole = (plain.storage_share(strains) - 0.4) / 0.6
    np.testing.assert_allclose(
        (plain.loss_share(strains) - 1.0) ** 2, 4.0 * whole * (1.0 - whole), rtol=1e-9, atol=1e-14
    )


def test_small_amplitudes_are_the_linear_theory_exactly() -> None:
    swing = np.array([1e-40, 1e-38])
    found = amplitude_sweep(RUBBER, FILLED, 2.0, swing, *PUNCH, depth=0.018)
    linear = complex(dynamic_stiffness(RUBBER, 2.0, *PUNCH, 0.018))
    np.testing.assert_allclose(found.storage_stiffness, linear.real, rtol=rounding(100))
    np.testing.assert_allclose(found.loss_stiffness, linear.imag, rtol=rounding(100))
    no_payne = Kraus(0.01, storage_floor=1.0)
    swing = np.array([1e-6, 1e-5])
    found = amplitude_sweep(RUBBER, no_payne, 2.0, swing, *PUNCH, depth=0.018)
    work = dissipated_work(RUBBER, 2.0, swing, *PUNCH, depth=0.018)
    np.testing.assert_allclose(found.work_per_cycle, work, rtol=1e-13)
    np.testing.assert_allclose(found.storage_stiffness, linear.real, rtol=rounding(100))


def test_a_larger_swing_meets_a_softer_contact_until_it_lifts_off() -> None:
    swing = np.geomspace(1e-8, 1e-4, 30)
    found = amplitude_sweep(RUBBER, FILLED, 1.0, swing, *PUNCH)
    assert np.all(np.diff(found.storage_stiffness) < 0.0)
    assert np.all(found.strain.values / swing == pytest.approx(float(found.strain[0]) / swing[0]))
    assert not found.lifts_off[0]
    assert found.lifts_off[-1]
    assert float(found.attrs["tapping_amplitude"]) < 1e-4


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Kraus(0.0, 0.5), "critical_strain is 0"),
        (lambda: Kraus(0.01, 1.5), "at most 1"),
        (lambda: Kraus(0.01, 0.5, loss_peak=-1.0), "loss_peak is -1"),
        (lambda: FILLED.storage_share(-1.0), "strain amplitude is -1"),
        (lambda: amplitude_sweep(RUBBER, FILLED, 1.0, [0.0], *PUNCH), "expected positive"),
    ],
)
def test_bad_values_are_refused(call: object, message: str) -> None:
    assert callable(call)
    with pytest.raises(InputError, match=message):
        call()

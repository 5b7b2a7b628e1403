"""Stress and energies of a solid under any strain."""

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.materials import Prony, respond

SOLID = Prony(2e6, [3e6, 1e7], [0.3, 1e-3], nu=0.4)


def test_a_sine_settles_at_the_complex_modulus():
    omega, cycles, samples = 20.0, 12, 400
    time = np.linspace(0.0, cycles * 2 * np.pi / omega, cycles * samples + 1)
    made = respond(SOLID, time, 1e-3 * np.sin(omega * time))
    modulus = complex(SOLID.complex_modulus(omega))
    last = time >= time[-1] - 2 * np.pi / omega - 1e-12
    expected = 1e-3 * np.abs(modulus) * np.sin(omega * time[last] + np.angle(modulus))
    np.testing.assert_allclose(made.stress[last], expected, atol=1e-4 * np.abs(expected).max())
    lost = np.diff(made.dissipated_energy.values[last][[0, -1]])[0]
    assert lost == pytest.approx(np.pi * modulus.imag * 1e-6, rel=1e-4)


def test_energies_balance_and_nothing_is_gained():
    rng = np.random.default_rng(0)
    time, strain = np.cumsum(rng.exponential(0.005, 400)), np.cumsum(rng.standard_normal(400)) * 1e-3
    made = respond(SOLID, time, strain)
    assert np.all(made.dissipation_rate >= 0)  # (1.20)
    assert np.all(np.diff(made.dissipated_energy) >= 0)  # (1.22)
    assert np.all(made.work >= made.stored_energy)  # (1.23)
    assert np.all(made.stored_energy >= 0)  # (1.25)
    # The work by itself: the trapezoid of chords that are a twentieth of the shortest time.
    slow = Prony(2e6, [3e6, 1e7], [0.3, 2e-3])
    fine = np.unique(np.concatenate([time, np.linspace(time[0], time[-1], 20_001)]))
    there = respond(slow, fine, np.interp(fine, time, strain))
    jump = 0.5 * slow.E_unrelaxed * strain[0] ** 2
    done = jump + np.trapezoid(there.stress.values, there.strain.values)
    assert done == pytest.approx(float(respond(slow, time, strain).work[-1]), rel=1e-3)


@pytest.mark.parametrize(
    ("time", "strain", "said"), [([0.0, 1.0], [0.0], "equal length"), ([0.0, 2.0, 1.0], [0.0, 1.0, 1.0], r"time\[2\]")]
)
def test_histories_that_do_not_fit_are_refused(time, strain, said):
    with pytest.raises(InputError, match=said):
        respond(SOLID, time, strain)

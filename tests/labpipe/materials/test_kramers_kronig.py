"""The Kramers-Kronig verdict on moduli that belong together, and on moduli that do not."""

import numpy as np
import pytest

from labpipe.materials import kramers_kronig

FREQUENCY = np.logspace(-3, 5, 60)


def moduli(truth, noise, seed=1):
    rng = np.random.default_rng(seed)
    exact = truth.modulus(2 * np.pi * FREQUENCY)
    factors = 1 + noise * rng.standard_normal((2, FREQUENCY.size))
    return exact.real * factors[0], exact.imag * factors[1]


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.025])
@pytest.mark.parametrize("name", ["maxwell_truth", "melt_truth"])
def test_moduli_of_one_material_pass(name, noise, request):
    found = kramers_kronig(FREQUENCY, *moduli(request.getfixturevalue(name), noise))
    assert found.verdict == "pass"
    assert found.error_of_loss < 0.01 + 2 * noise
    assert found.error_of_storage < 0.01 + 2 * noise


@pytest.mark.parametrize("name", ["maxwell_truth", "melt_truth"])
@pytest.mark.parametrize(("factor", "verdict"), [(1.1, "warn"), (1.3, "fail"), (0.7, "fail")])
def test_wrong_calibration_of_the_phase_does_not_pass(name, factor, verdict, request):
    storage, loss = moduli(request.getfixturevalue(name), 0.025)
    assert kramers_kronig(FREQUENCY, storage, factor * loss).verdict == verdict

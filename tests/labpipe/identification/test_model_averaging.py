from dataclasses import replace

import numpy as np
import pytest

from labpipe.identification import infer, moduli
from labpipe.identification._model_averaging import SMOOTH, UNEVEN
from labpipe.materials import Prony
from tests.labpipe.identification.holds import RUBBER, hold

_FINE = np.logspace(-6.0, 5.0, 111)
_BROAD = 1e6 / np.cosh(0.2 * np.log(_FINE))
_NARROW = 3e6 * np.exp(-0.5 * (np.log10(_FINE / 8.0) / 0.25) ** 2)
_PEAKED = Prony(7.6e6, (_BROAD + _NARROW) * np.gradient(np.log10(_FINE)), _FINE, nu=0.5)
"""A peak half a decade wide on a broad dispersion."""
FREQUENCY = np.array([3e-3, 3e-2, 3e-1])


def held(solid: Prony, seed: int, **options: float):
    """A hold of ten minutes, read to 0.1 %."""
    return hold(solid, seed, shortest=0.06, noise=1e-3, gain=2e-3, **options)


def chances(known) -> dict[str, float]:
    return {n: sum(s.weight for s in known.structures if s.name == n) for n in (SMOOTH, UNEVEN)}


def deviations(known, solid: Prony) -> np.ndarray:
    found, truth = moduli(known, FREQUENCY), solid.complex_modulus(2 * np.pi * FREQUENCY)
    storage = np.log(found.storage / truth.real) / found.u_ln_storage
    loss = np.log(found.loss_factor / (truth.imag / truth.real)) / found.u_ln_loss_factor
    return np.concatenate([storage, loss])


def test_narrow_peak_is_recognised_and_is_no_discrepancy() -> None:
    peaked = infer(*held(_PEAKED, 3))
    assert chances(peaked)[UNEVEN] > 0.8
    assert peaked.fit.misfits == {}
    assert np.abs(deviations(peaked, _PEAKED)).max() < 3


@pytest.fixture(scope="module")
def smooth():
    return infer(*held(RUBBER, 4))


def test_smooth_spectrum_is_recognised(smooth) -> None:
    assert chances(smooth)[SMOOTH] > 0.5
    assert np.abs(deviations(smooth, RUBBER)).max() < 3


def test_wave_that_no_relaxation_makes_stays_a_discrepancy() -> None:
    known = infer(*held(RUBBER, 6, hidden=0.01))
    assert known.fit.misfits["hold", "force"].relative > 2e-3


def test_moduli_are_mean_and_spread_over_the_structures(smooth) -> None:
    apart = []
    for weight in (1.0, 0.0, 0.25):
        two = [replace(s, weight=w) for s, w in zip(smooth.structures, (weight, 1 - weight), strict=True)]
        apart.append(moduli(replace(smooth, structures=tuple(two)), FREQUENCY))
    one, other, mixed = apart
    for name in ("storage", "loss_factor"):
        a, b = (np.log(getattr(m, name)) for m in (one, other))
        assert np.allclose(np.log(getattr(mixed, name)), 0.25 * a + 0.75 * b)
        u, v, w = (getattr(m, f"u_ln_{name}") for m in (one, other, mixed))
        assert np.allclose(w**2, 0.25 * u**2 + 0.75 * v**2 + 0.1875 * (a - b) ** 2)

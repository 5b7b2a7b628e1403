"""The free ringing after a blow: against closed forms, and what is refused."""

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.signals import ringing

NOISE = 2e-7
F0, ZETA = 180.0, 0.03
OMEGA = 2 * np.pi * F0
DAMPED = OMEGA * np.sqrt(1 - ZETA**2)
SURE = {"longest_impact": 4e-3, "shortest_pause": 15e-3}


def ring(time: np.ndarray, at: float, amplitude: float) -> np.ndarray:
    """Ringing by an instantaneous downward blow."""
    s = np.maximum(time - at, 0.0)
    return -amplitude * np.exp(-ZETA * OMEGA * s) * np.sin(DAMPED * s)


def record(amplitude: float = 5e-6, second: float = 0.05, seed: int = 3) -> tuple:
    time = np.arange(0.0, 0.15, 5e-5)
    noise = NOISE * np.random.default_rng(seed).standard_normal(time.size)
    moved = ring(time, 0.02013, amplitude) + ring(time, second, 0.8 * amplitude)
    return time, moved + noise


def test_the_closed_form_comes_back_and_the_second_blow_is_left_out() -> None:
    found = ringing(*record(), **SURE)
    fit = found.fit
    assert abs(fit.natural_frequency - F0) < 3 * fit.u_frequency
    assert abs(fit.damping_ratio - ZETA) < 3 * fit.u_damping_ratio
    assert abs(fit.amplitude - 5e-6) < 3 * fit.u_amplitude
    assert abs(found.blow_time - 0.02013) < 3 * found.u_blow_time
    assert 0.045 < found.free_to < 0.0505
    assert 0.020 < found.free_from < 0.0225
    assert 0.7 < found.chi_square < 1.3


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t, y: (t, 0 * y + NOISE * np.random.default_rng(0).standard_normal(t.size)), "nothing moves"),
        (lambda t, y: (t[420:], y[420:]), "begins in motion"),
        (lambda t, y: (t[:600], y[:600]), "the record ends"),
        (lambda t, y: (t, np.round(y, 6)), "constant"),
    ],
)
def test_what_is_no_ringing_is_refused_with_the_reason(change, says: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=says):
        ringing(*change(*record()), **SURE)


def test_impossible_bounds_are_refused() -> None:
    time, moved = record()
    with pytest.raises(InputError, match="longest impact"):
        ringing(time, moved, longest_impact=20e-3, shortest_pause=15e-3)
    with pytest.raises(InputError, match="cycles"):
        ringing(time, moved, longest_impact=4e-3, shortest_pause=6e-3)

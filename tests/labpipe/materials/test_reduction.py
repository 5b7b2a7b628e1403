"""Fewer terms against the moduli of the full series, evaluated anew."""

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.materials.spectrum import fewest_terms

WIDE = Prony(1e7, 1e8 * np.exp(-0.5 * ((np.linspace(-8, 2, 31) + 3) / 2) ** 2), np.logspace(-8, 2, 31), nu=0.4)


@pytest.mark.parametrize("tolerance", [0.05, 0.01, 0.005])
def test_reduced_series_keeps_both_moduli_within_the_tolerance(tolerance):
    few, error = fewest_terms(WIDE, 1e-2, 1e6, tolerance)
    omega = 2 * np.pi * np.geomspace(1e-2, 1e6, 300)
    full, reduced = WIDE.complex_modulus(omega), few.complex_modulus(omega)
    for a, b in ((reduced.real, full.real), (reduced.imag, full.imag)):
        assert np.sqrt(np.mean((a / b - 1) ** 2)) < 1.1 * tolerance
    assert error <= tolerance
    assert few.E.size < WIDE.E.size
    assert few.nu == WIDE.nu


def test_tighter_tolerance_takes_more_terms():
    sizes = [fewest_terms(WIDE, 1e-2, 1e6, t)[0].E.size for t in (0.1, 0.01, 0.001)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[-1]


def test_series_that_cannot_be_shortened_is_returned_as_it_is():
    assert fewest_terms(WIDE, 1e-2, 1e6, 1e-15) == (WIDE, 0.0)
    elastic = Prony(1e9, [], [])
    assert fewest_terms(elastic, 1.0, 10.0) == (elastic, 0.0)


@pytest.mark.parametrize("window", [(0.0, 1.0), (2.0, 1.0), (1.0, np.inf), (1.0, np.nan)])
def test_wrong_window_is_refused(window):
    with pytest.raises(InputError, match="positive window"):
        fewest_terms(WIDE, *window)

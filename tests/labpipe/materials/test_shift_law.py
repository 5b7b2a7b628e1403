"""WLF and Arrhenius: values, fits, uncertainties, and the end of the WLF law."""

import numpy as np
import pytest

from labpipe.materials import arrhenius, wlf
from labpipe.materials._shift_law import fit_law

TEMPERATURE = np.linspace(-40.0, 120.0, 12)


def test_arrhenius_gains_one_decade_where_the_formula_says():
    law = arrhenius(100e3, 25.0)
    kelvin = 1 / (1 / 298.15 + np.log(10) * 8.314462618 / 100e3)
    assert law.log10_aT(kelvin - 273.15) == pytest.approx(1.0, rel=1e-9)
    assert law.activation_energy == 100e3


@pytest.mark.parametrize("C2", [60.0, 250.0, 1e5])
def test_exact_table_returns_the_constants(C2):
    law = wlf(0.06 * C2, C2, 20.0)
    found = fit_law("wlf", TEMPERATURE + 20, law.log10_aT(TEMPERATURE + 20), 1e-4 * np.eye(12), 20.0)
    assert found.parameters == pytest.approx(law.parameters, rel=1e-6)
    assert found.chi_square < 1e-6


def test_stated_uncertainty_is_the_scatter_of_refits():
    rng = np.random.default_rng(0)
    exact = wlf(15.0, 250.0, 40.0).log10_aT(TEMPERATURE)
    covariance = 0.03**2 * np.eye(12)
    fits = [fit_law("wlf", TEMPERATURE, exact + 0.03 * rng.standard_normal(12), covariance, 40.0) for _ in range(300)]
    for name, stated in (("C1", "u_C1"), ("C2", "u_C2")):
        scatter = np.std([getattr(fit, name) for fit in fits])
        assert np.median([getattr(fit, stated) for fit in fits]) == pytest.approx(scatter, rel=0.2)
    chi = np.mean([fit.chi_square / fit.freedom for fit in fits])
    assert chi == pytest.approx(1.0, abs=0.15)

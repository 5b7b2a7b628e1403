import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.identification import FractionalSpectrum, Parameter, SmoothSpectrum, relaxation_times
from labpipe.identification._spectra import material


def test_fractional_series_is_cole_and_coles_solid_inside_its_grid() -> None:
    spectrum = FractionalSpectrum.over(1e-3, 1e2, 0.5)
    relaxed, strength, time, alpha = 2e6, 3e7, 0.05, 0.4
    values = (relaxed, strength, time, alpha)
    xi = np.array([p.coordinate(v) for p, v in zip(spectrum.parameters, values, strict=True)])
    omega = np.geomspace(1e-1, 1e2, 9)
    x = (1j * omega * time) ** alpha
    exact = relaxed + strength * x / (1 + x)
    made = material(spectrum, spectrum.log_terms(xi)).complex_modulus(omega)
    assert np.abs(made / exact - 1).max() < 0.02


@pytest.mark.parametrize("family", ["smooth", "fractional"])
def test_slopes_are_the_derivatives(family: str) -> None:
    spectrum = (
        SmoothSpectrum(relaxation_times(1e-2, 1e2), 0.5)
        if family == "smooth"
        else FractionalSpectrum.over(1e-2, 1e2, 0.5)
    )
    xi = 0.3 * np.cos(np.arange(len(spectrum.parameters)))
    slopes = spectrum.slopes(xi)
    for k in range(xi.size):
        step = np.zeros(xi.size)
        step[k] = 1e-4
        change = (spectrum.log_terms(xi + step) - spectrum.log_terms(xi - step)) / 2e-4
        assert np.allclose(slopes[:, k], change, atol=1e-5)


def test_start_has_the_loss_factor_that_was_asked_for() -> None:
    spectrum = SmoothSpectrum(relaxation_times(1e-3, 1e3), 0.5)
    solid = material(spectrum, spectrum.log_terms(spectrum.start(1e9, 0.05)))
    storage_less = solid.complex_modulus(1.0).imag / 1e9
    assert storage_less == pytest.approx(0.05, rel=0.1)


def test_spectrum_is_positive_wherever_the_prior_reaches() -> None:
    spectrum = SmoothSpectrum(relaxation_times(1e-3, 1e3), 0.5)
    for seed in range(20):
        xi = np.random.default_rng(seed).standard_normal(len(spectrum.parameters))
        assert material(spectrum, spectrum.log_terms(xi)).E.min() > 0


@pytest.mark.parametrize("per_decade", [1, 2, 6])
def test_changes_of_the_prior_are_a_factor_of_ten_within_two_deviations(per_decade: int) -> None:
    spectrum = SmoothSpectrum(10.0 ** (np.arange(3 * per_decade + 1) / per_decade), 0.5)
    slopes = spectrum.slopes(np.zeros(len(spectrum.parameters)))

    # the integral of a slope that forgets itself within two decades
    def integral(decades: float) -> float:
        return float(decades / 2.0 + np.expm1(-decades / 2.0))

    for decades in (1, 3):
        change = slopes[1 + decades * per_decade] - slopes[1]
        ratio = np.sqrt(integral(decades) / integral(1))
        assert np.linalg.norm(change) == pytest.approx(ratio * np.log(10) / 2)


def test_times_go_decades_beyond_the_data_and_on_to_hours() -> None:
    rho = relaxation_times(1e-4, 0.2)
    assert rho[:3] == pytest.approx([1e-7, 1e-6, 1e-5], rel=1e-6, abs=0.0)
    assert rho[3] == pytest.approx(10**-4.5)
    assert rho[-1] >= 1e4
    with pytest.raises(InputError, match="shortest"):
        relaxation_times(1.0, 0.1)


def test_prior_without_a_spread_is_refused() -> None:
    with pytest.raises(InputError, match="positive deviation"):
        Parameter("x", 0.0, 0.0, "1", "nothing")


def test_logarithmic_parameter_refuses_what_has_no_logarithm() -> None:
    with pytest.raises(InputError, match="positive value"):
        Parameter("x", 0.0, 1.0, "1", "number", is_log=True).coordinate(-1.0)

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.identification import Parameter, SmoothSpectrum, relaxation_times


@pytest.mark.parametrize("per_decade", [1, 6])
def test_changes_of_the_prior_are_a_factor_of_ten_within_two_deviations(per_decade: int) -> None:
    spectrum = SmoothSpectrum(10.0 ** (np.arange(3 * per_decade + 1) / per_decade), 0.5)
    terms, by_xi = spectrum.terms(np.zeros(len(spectrum.parameters)))
    slopes = by_xi / terms[:, None]

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
    with pytest.raises(InputError, match="positive deviation"):
        Parameter("x", 0.0, 0.0, "1", "nothing")

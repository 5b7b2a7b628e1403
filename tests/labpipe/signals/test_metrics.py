"""Figures of agreement: closed forms, coverage of their uncertainties, and refusals."""

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.signals.metrics import agreement, compare, independent_count, nrmse


def curve(values: np.ndarray, units: str = "m") -> xr.DataArray:
    time = np.arange(values.size) * 0.1
    return xr.DataArray(
        values, dims="time", coords={"time": time}, attrs={"units": units, "long_name": "height"}
    )


def test_nrmse_is_the_rms_error_over_the_range_of_the_measurement() -> None:
    measured = np.array([0.0, 1.0, 2.0, 4.0])
    assert nrmse(measured, measured + 0.2) == pytest.approx(0.05)
    assert nrmse(1e3 * measured, 1e3 * measured + 200) == pytest.approx(0.05)  # unit-free


def test_nrmse_of_a_constant_measurement_is_refused() -> None:
    with pytest.raises(InputError, match="does not vary"):
        nrmse([1.0, 1.0], [1.0, 2.0])


def test_compare_says_bias_rms_and_the_largest_difference_with_its_sign() -> None:
    measured = curve(np.array([0.0, 1.0, 2.0, 3.0]))
    found = compare(measured, measured + np.array([0.1, 0.1, 0.1, 0.7]))
    assert float(found["bias"]) == pytest.approx(-0.25)
    assert float(found["max_error"]) == pytest.approx(-0.7)
    assert float(found["rms_error"]) == pytest.approx(np.sqrt((3 * 0.01 + 0.49) / 4))
    assert found["residual"].attrs["units"] == "m"


def test_gaps_are_left_out_and_counted() -> None:
    measured = curve(np.array([0.0, np.nan, 2.0, 3.0]))
    found = compare(measured, curve(np.array([0.0, 1.0, np.nan, 3.0])))
    assert int(found["n_compared"]) == 2
    assert float(found["nrmse"]) == 0.0


def test_compare_refuses_other_units_and_other_times() -> None:
    measured = curve(np.arange(4.0))
    with pytest.raises(InputError, match='in "m"'):
        compare(measured, curve(np.arange(4.0), "mm"))
    with pytest.raises(InputError, match="different times"):
        compare(measured, measured.assign_coords(time=measured["time"] + 1))


def test_limits_of_agreement_hold_95_percent_of_new_differences() -> None:
    generator = np.random.default_rng(1)
    inside = []
    for _ in range(200):
        truth = generator.normal(0, 5, 40)
        first = truth + generator.normal(0.3, 1, 40)
        found = agreement(first, truth + generator.normal(0, 1, 40))
        fresh = generator.normal(0.3, np.sqrt(2), 1000)
        inside.append(np.mean((fresh > found.low) & (fresh < found.high)))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


def test_the_bias_is_covered_by_its_uncertainty_even_when_neighbours_err_alike() -> None:
    generator = np.random.default_rng(2)
    covered = 0
    for _ in range(200):
        noise = np.convolve(generator.normal(0, 1, 2100), np.ones(20) / 20, mode="valid")[:2000]
        found = agreement(noise + 0.1, np.zeros(2000))
        covered += abs(found.bias - 0.1) <= 1.96 * found.u_bias
    assert 175 <= covered <= 200


def test_identical_methods_agree_fully() -> None:
    found = agreement([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    assert (found.bias, found.sd, found.concordance) == (0.0, 0.0, 1.0)


def test_too_few_pairs_are_refused() -> None:
    with pytest.raises(InputError, match="at least three"):
        agreement([1.0, 2.0], [1.0, 2.0])
    with pytest.raises(InputError, match="shape"):
        agreement([1.0, 2.0], [1.0])


def test_independent_samples_are_counted() -> None:
    generator = np.random.default_rng(3)
    white = generator.normal(0, 1, 5000)
    assert independent_count(white) == pytest.approx(5000, rel=0.1)
    averaged = np.convolve(white, np.ones(10) / 10, mode="valid")
    assert independent_count(averaged) == pytest.approx(500, rel=0.25)

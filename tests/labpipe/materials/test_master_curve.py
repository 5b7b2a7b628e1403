"""Master curves against materials that are known, and against sweeps that are spoilt."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.materials import master_curve


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def error(curve, truth):
    return rms(curve.log10_aT.values - truth.log10_aT)


@pytest.fixture(scope="module")
def curve(maxwell_truth):
    return master_curve(maxwell_truth.sweeps(5), T_ref=60.0)


def test_shifts_and_spectrum_of_a_known_material(curve, maxwell_truth):
    assert error(curve, maxwell_truth) < 0.034
    z = (curve.log10_aT.values - maxwell_truth.log10_aT) / curve.u_log10_aT.values
    assert rms(z) < 2
    omega = 2 * np.pi * curve.curve["reduced_frequency"].values
    exact = maxwell_truth.modulus(omega)
    assert rms(curve.curve["storage"].values / exact.real - 1) < 0.02
    assert rms(curve.curve["loss"].values / exact.imag - 1) < 0.03
    assert (curve.vertical, curve.delay) == ("none", 0.0)
    assert curve.kramers_kronig.verdict == "pass"
    assert curve.warnings == ()
    assert curve.noise["storage"] == pytest.approx(0.02, rel=0.25)


def test_liquid_has_no_relaxed_modulus(melt_truth):
    found = quiet(melt_truth.sweeps(3), T_ref=60.0)
    assert error(found, melt_truth) < 0.03
    assert found.prony.E_relaxed < 1e-3 * found.prony.E_unrelaxed


def test_law_inside_the_fit_is_sharper_and_returns_its_constants(maxwell_truth):
    runs = [master_curve(maxwell_truth.sweeps(k), T_ref=60.0, law="wlf") for k in range(5, 9)]
    assert np.mean([error(run, maxwell_truth) for run in runs]) < 0.018
    found = runs[0]
    # The law about 40 °C with C1 = 15, C2 = 250 is the one about 60 °C with C2 = 270.
    assert pytest.approx(270.0, abs=4 * found.law.u_C2) == found.law.C2
    assert pytest.approx(15 * 250 / 270, abs=4 * found.law.u_C1) == found.law.C1
    assert 0 < found.law.u_C2 < 10


def test_law_that_does_not_hold_is_named(maxwell_truth):
    found = quiet(maxwell_truth.sweeps(5), T_ref=60.0, law="arrhenius", vertical="none")
    assert any("the arrhenius law does not hold" in note for note in found.warnings)
    assert found.verdict.level != "pass"


def test_delay_of_the_instrument_is_found_and_taken_out(maxwell_truth):
    late = replace(maxwell_truth, delay=200e-6)
    found = master_curve(late.sweeps(4), T_ref=60.0)
    assert found.delay == pytest.approx(200e-6, abs=4 * found.u_delay)
    assert found.u_delay < 40e-6
    assert error(found, late) < 0.04
    without = quiet(late.sweeps(4), T_ref=60.0, delay=False, vertical="none")
    assert without.delay == 0
    assert error(without, late) > error(found, late)


@pytest.mark.parametrize("factor", [100.0, 0.1])
def test_readings_far_off_their_sweep_are_left_out_and_told(maxwell_truth, factor):
    sweeps = maxwell_truth.sweeps(6)
    for name, places in (("storage", [(4, 5), (8, 0), (8, 9)]), ("loss", [(5, 5), (2, 10)])):
        for place in places:
            sweeps[name].values[place] *= factor
    with pytest.warns(UserWarning, match="5 readings lie far off the other readings of their sweep"):
        found = master_curve(sweeps, T_ref=60.0)
    assert error(found, maxwell_truth) < 0.05
    off = np.abs(found.log10_aT.values - maxwell_truth.log10_aT)
    assert np.all(off <= 3.0 * found.u_log10_aT.values + 1e-3)
    assert found.verdict.level == "pass"


def test_result_is_one_dataset_with_units(curve, tmp_path):
    stored = curve.to_dataset()
    for name in stored.data_vars:
        assert "units" in stored[name].attrs, name
        assert "long_name" in stored[name].attrs, name
    stored.to_netcdf(tmp_path / "curve.nc")
    with xr.open_dataset(tmp_path / "curve.nc") as again:
        np.testing.assert_array_equal(again["log10_aT"], curve.log10_aT)


def quiet(sweeps, **options):
    """Run with the limits of the data expected; they are tested by name elsewhere."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return master_curve(sweeps, **options)


def test_one_temperature_fits_its_own_spectrum(maxwell_truth):
    one = maxwell_truth.sweeps(5).isel(temperature=[4])
    with pytest.warns(UserWarning, match="only one temperature"):
        found = master_curve(one)
    assert (float(found.log10_aT[0]), float(found.u_log10_aT[0])) == (0, 0)
    omega = 2 * np.pi * one["frequency"].values
    exact = maxwell_truth.clean()[4]
    np.testing.assert_allclose(found.prony.complex_modulus(omega).real, exact.real, rtol=0.03)
    with pytest.raises(InputError, match="cannot be shifted"):
        master_curve(one, T_ref=60.0)


def test_stiff_glass_is_barely_determined_and_says_so(maxwell_truth):
    flat = maxwell_truth.sweeps(5)
    rng = np.random.default_rng(0)
    for k in range(3):
        flat["storage"][k] = 3e9 * (1 + 0.02 * rng.standard_normal(11))
        flat["loss"][k] = 2e7 * (1 + 0.2 * rng.standard_normal(11))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = master_curve(flat, T_ref=60.0)
    assert any("barely determine" in str(w.message) for w in caught)
    assert float(found.u_log10_aT[0]) > 0.15
    assert not bool(found.overlap["determined"][0])


def with_value(name, value):
    return lambda sweeps: sweeps.assign({name: sweeps[name].where(np.arange(132).reshape(12, 11) != 25, value)})


def in_unit(name, unit):
    return lambda sweeps: sweeps.assign_coords({name: sweeps[name].assign_attrs(units=unit)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (with_value("storage", -1.0), r"storage modulus zero, negative.*-10.9091 °C, 0.3981 Hz"),
        (with_value("storage", np.inf), "infinite at 1 points"),
        (lambda sweeps: sweeps.assign(loss=-sweeps["loss"]), "132 of 132 points.*sign convention"),
        (in_unit("storage", "MPa"), '"storage" is in "MPa", expected "Pa"'),
        (in_unit("frequency", "rad/s"), '"frequency" is in "rad/s", expected "Hz"'),
        (lambda sweeps: sweeps * 1e150, r"storage modulus of .* Pa, first at -40 °C.*check the unit of its column"),
        (lambda sweeps: sweeps.drop_vars("loss"), "lack loss"),
        (lambda sweeps: sweeps.isel(frequency=0), "has dimensions"),
        (lambda sweeps: sweeps.isel(frequency=[0], temperature=[0]), "only 1 points"),
        (lambda sweeps: sweeps.assign_coords(frequency=-sweeps["frequency"]), "positive, finite"),
    ],
)
def test_unusable_sweeps_are_refused(maxwell_truth, change, message):
    with pytest.raises(InputError, match=message):
        master_curve(change(maxwell_truth.sweeps(5)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"T_ref": 200.0}, r"T_ref = 200 °C lies outside the measured -40 to 120 °C.*law"),
        ({"law": "vogel"}, "law = 'vogel' is unknown"),
        ({"vertical": "free"}, "vertical = 'free' is unknown"),
    ],
)
def test_unknown_options_are_refused(maxwell_truth, options, message):
    with pytest.raises(InputError, match=message):
        master_curve(maxwell_truth.sweeps(5), **options)

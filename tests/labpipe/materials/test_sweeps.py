"""Readings at the front door: neither loading nor Poisson's ratio is guessed; tests over time become sweeps."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import labpipe as lp
from labpipe.errors import InputError
from labpipe.materials import Prony, loading_of

ACRYLIC = Path(__file__).parents[3] / "sample_data/thesis-small/dma/acrylic_dma.csv"


@pytest.fixture(scope="module")
def readings():
    return lp.read(ACRYLIC)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, r'shear moduli \(column "Shear Strain"\): give nu=.*mode="torsion", nu=0.35'),
        ({"mode": "torsion"}, r"E = 2 \(1 \+ nu\) G: give nu="),
        ({"mode": "twist", "nu": 0.35}, 'mode "twist" is unknown'),
    ],
)
def test_loading_and_poisson_ratio_are_asked_for(readings, options, message):
    with pytest.raises(InputError, match=message), warnings.catch_warnings(action="ignore"):
        lp.master_curve(readings, T_ref="25 °C", **options)


def test_readings_that_do_not_show_their_loading_are_refused(readings):
    for name in ("strain", "storage_modulus", "loss_modulus"):
        readings = readings.assign({name: readings[name].assign_attrs(long_name=name)})
    assert loading_of(readings) == ("", "")
    with pytest.raises(InputError, match="do not show what was loaded: give mode="):
        lp.master_curve(readings, nu=0.35)


def test_a_file_name_or_a_number_is_answered_with_the_call_to_write(tmp_path):
    with pytest.raises(InputError, match=r'not the name of a file: master_curve\(lp.read\("a.csv"\)'):
        lp.master_curve("a.csv")
    with pytest.raises(InputError, match="takes a Dataset, found float"):
        lp.master_curve(3.0)


def test_repr_verdict_and_law_are_those_of_the_report(readings):
    with warnings.catch_warnings(action="ignore"):
        curve = lp.master_curve(readings, T_ref="25 °C", nu=0.35)
    assert 4.5e9 < curve.prony.E_unrelaxed < 5.0e9
    assert curve.prony.nu == 0.35
    assert curve.nearest_law.chi_square > 100 * curve.nearest_law.freedom
    assert curve.law is None
    assert "superposition: pass, no law holds (free shifts)" in repr(curve)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"nu": 0.35, "mode": "tension"}, 'mode = "tension", but the readings have a column "Shear Strain"'),
     ({"nu": "0.35 ± 0.02"}, 'nu: "0.35 ± 0.02" states an uncertainty')],
)  # fmt: skip
def test_a_mode_that_contradicts_the_headings_and_an_uncertain_ratio_are_refused(readings, arguments, message):
    with pytest.raises(InputError, match=message):
        lp.master_curve(readings, **arguments)


@pytest.mark.parametrize(("name", "units"), [("relaxation_modulus", "Pa"), ("creep_compliance", "1/Pa")])
def test_tests_over_time_at_several_temperatures_make_a_master_curve(name, units):
    rho = np.geomspace(1e-6, 1e6, 60)
    solid = Prony(5e6, 1e8 / (1 + np.log10(rho) ** 2), rho, nu=0.35)
    respond = solid.relaxation if name == "relaxation_modulus" else solid.creep
    time, shifts = np.geomspace(0.02, 200, 40), {20.0: 1.0, 40.0: 0.0, 60.0: -1.0}
    noise = 1 + 0.005 * np.random.default_rng(1).standard_normal((3, 40))
    values = np.concatenate([respond(time / 10**a) for a in shifts.values()]) * noise.ravel()
    columns = {
        "time": ("sample", np.tile(time, 3), {"units": "s"}),
        name: ("sample", values, {"units": units}),
        "temperature": ("sample", np.repeat(list(shifts), 40), {"units": "degC"}),
        "is_valid": ("sample", np.ones(120, dtype=np.int8)),
    }
    table = xr.Dataset(columns, attrs={"tests": json.dumps([{"rows": 120}])})
    with warnings.catch_warnings(action="ignore"):
        curve = lp.master_curve(table, T_ref=40.0, mode="tension", nu=0.35)
    np.testing.assert_allclose(curve.log10_aT, list(shifts.values()), atol=0.06)
    np.testing.assert_allclose(curve.prony.relaxation(time), solid.relaxation(time), rtol=0.03)

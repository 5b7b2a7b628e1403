"""Tests over time give the moduli over frequency of the same material."""

import json

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.materials import Prony, with_responses

RHO = np.geomspace(1e-6, 1e6, 60)
SOLID = Prony(5e6, 1e8 / (1 + np.log10(RHO) ** 2), RHO, nu=0.4)
LIQUID = Prony(0.0, 1e8 / (1 + (np.log10(RHO) + 2) ** 2), RHO, nu=0.4)
TIME = np.geomspace(0.05, 500, 120)


def rms(found, truth):
    return float(np.sqrt(np.mean((found / truth - 1) ** 2)))


@pytest.mark.parametrize("material", [SOLID, LIQUID], ids=["solid", "liquid"])
@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("name", ["relaxation_modulus", "creep_compliance"])
def test_relaxation_and_creep_give_the_moduli_inside_their_times(material, noise, name):
    factor = 1 + noise * np.random.default_rng(5).standard_normal(TIME.size)
    values = factor * (material.relaxation(TIME) if name == "relaxation_modulus" else material.creep(TIME))
    found = with_responses(
        xr.Dataset(
            {"time": ("sample", TIME), name: ("sample", values)}, attrs={"tests": json.dumps([{"rows": TIME.size}])}
        )
    )
    truth = material.complex_modulus(2 * np.pi * found.frequency.values)
    assert rms(found.storage_modulus.values, truth.real) < 0.004 + 0.5 * noise
    assert rms(found.loss_modulus.values, truth.imag) < 0.02 + 3 * noise
    assert found.attrs["u_moduli"] < 0.005 + noise


def a_hold():
    """Readings of one relaxation at 20 °C."""
    columns = {"time": TIME, "relaxation_modulus": SOLID.shifted(10.0).relaxation(TIME), "temperature": 20.0 + 0 * TIME}
    attrs = {"tests": json.dumps([{"rows": TIME.size}]), "source": "holds.csv"}
    return xr.Dataset({name: ("sample", values) for name, values in columns.items()}, attrs=attrs)


def test_they_join_the_sweeps_of_a_file():
    frequency = np.geomspace(0.1, 10, 9)
    modulus = SOLID.complex_modulus(2 * np.pi * frequency)
    blank = np.full(TIME.size, np.nan)
    holds = a_hold()
    both = xr.Dataset(
        {
            "frequency": ("sample", np.concatenate([frequency, blank])),
            "storage_modulus": ("sample", np.concatenate([modulus.real, blank])),
            "loss_modulus": ("sample", np.concatenate([modulus.imag, blank])),
            "time": ("sample", np.concatenate([frequency * np.nan, holds.time.values])),
            "relaxation_modulus": ("sample", np.concatenate([frequency * np.nan, holds.relaxation_modulus.values])),
            "temperature": ("sample", np.concatenate([frequency * 0 + 40.0, holds.temperature.values])),
        },
        attrs={"tests": json.dumps([{"rows": 9}, {"rows": TIME.size}])},
    )
    joined = with_responses(both)
    assert set(np.unique(joined.temperature)) == {20.0, 40.0}
    np.testing.assert_allclose(joined.storage_modulus.values[:9], modulus.real, rtol=1e-12)
    assert len(json.loads(joined.attrs["tests"])) == 2


def test_readings_without_such_tests_stay_as_they_are():
    plain = xr.Dataset({"frequency": ("sample", [1.0])}, attrs={"tests": '[{"rows": 1}]'})
    assert with_responses(plain) is plain
    short = a_hold().isel(sample=slice(0, 5)).assign_attrs(tests='[{"rows": 5}]')
    with pytest.raises(InputError, match=r"holds.csv: no test over time can be used: found 5 readings after the step"):
        with_responses(short)

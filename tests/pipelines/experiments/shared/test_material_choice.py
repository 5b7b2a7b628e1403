"""The material of an experiment from a DMA experiment, at the temperature that is asked for."""

import json

import numpy as np
import pytest
import xarray as xr

from labpipe import materials
from labpipe.errors import InputError
from labpipe.units import Quantity
from pipelines.experiments.shared.material_choice import resolve, variations
from pipelines.experiments.shared.settings import MaterialChoice

C1, C2, T_REF = 10.0, 120.0, 20.0
TIMES = (1e-5, 1.0)


def wlf_shift(temperature):
    return -C1 * (temperature - T_REF) / (C2 + temperature - T_REF)


@pytest.fixture
def fitted():
    """A master curve as the DMA experiment stores it."""
    temperature = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
    law = {"name": "wlf", "T_ref": T_REF, "parameters": [C1 / C2, 1 / C2]}
    return xr.Dataset(
        {
            "E_relaxed": 1e7,
            "E": ("term", [4e8, 6e8]),
            "rho": ("term", [1e-3, 1.0]),
            "nu": 0.4,
            "T_ref": T_REF,
            "log10_aT": ("temperature", wlf_shift(temperature)),
            "b_T": ("temperature", 1 + 1e-3 * (temperature - T_REF)),
            "mode_storage": (("mode", "mode_frequency"), np.full((1, 50), 0.01)),
            "mode_loss": (("mode", "mode_frequency"), np.full((1, 50), 0.01)),
            "mode_shift": (("mode", "mode_temperature"), np.zeros((1, 5))),
            "mode_vertical": (("mode", "mode_temperature"), np.zeros((1, 5))),
        },
        coords={
            "temperature": temperature,
            "mode_frequency": np.geomspace(1e-4, 1e6, 50),
            "mode_temperature": temperature,
        },
        attrs={"law": json.dumps(law), "u_scale": 0.0},
    )


def choice(temperature=None):
    given = None if temperature is None else Quantity(temperature, 0.0, "degC")
    return MaterialChoice(material_from="dma", temperature=given)


def test_without_a_temperature_it_is_taken_at_its_reference(fitted):
    found = resolve(choice(), None, fitted)
    assert found == materials.Prony(1e7, [4e8, 6e8], [1e-3, 1.0], nu=0.4)
    assert resolve(choice(T_REF), None, fitted) == found


@pytest.mark.parametrize("temperature", [0.0, 13.0, 35.0])
def test_temperature_shifts_it_by_law_and_vertical_factor(fitted, temperature):
    found = resolve(choice(temperature), None, fitted)
    a_T, b_T = 10.0 ** wlf_shift(temperature), 1 + 1e-3 * (temperature - T_REF)
    np.testing.assert_allclose(found.rho, a_T * np.array([1e-3, 1.0]), rtol=1e-12)
    np.testing.assert_allclose(found.E, b_T * np.array([4e8, 6e8]), rtol=1e-12)
    assert found.E_relaxed == pytest.approx(b_T * 1e7)
    assert found.nu == 0.4


def test_beyond_the_isotherms_the_law_goes_on_with_a_warning_until_its_pole(fitted):
    with pytest.warns(UserWarning, match="60 °C lies outside.*0 to 40 °C"):
        found = resolve(choice(60.0), None, fitted)
    assert np.log10(found.rho[1]) == pytest.approx(wlf_shift(60.0))

    with pytest.raises(InputError, match="-150"):
        resolve(choice(-150.0), None, fitted)
    one = fitted.isel(temperature=[2])
    one.attrs["law"] = json.dumps({"name": "arrhenius", "T_ref": T_REF, "parameters": [0.0]})
    with pytest.raises(InputError, match="one isotherm cannot be shifted to 30 °C"):
        resolve(choice(30.0), None, one)


@pytest.mark.parametrize(("factor", "power"), [(1.0, 2), (2.8, 1)])
def test_an_uncertain_poisson_ratio_changes_the_modulus_of_a_contact(fitted, factor, power):
    """E / (1 - nu^2) of a modulus in tension, 2 G / (1 - nu) of one in shear."""
    known = fitted.assign(u_nu=0.01).assign_attrs(fitted.attrs | {"modulus_factor": factor})
    given, step, stiffer = variations(choice(), None, known, TIMES)["Poisson's ratio"]
    assert given == Quantity(0.4, 0.01, "1")
    expected = 1e7 * (1 - 0.4**power) / (1 - (0.4 + step) ** power)
    assert stiffer.E_relaxed == pytest.approx(expected, rel=1e-12)
    # a material of the library is exact
    assert variations(MaterialChoice(material="acrylic"), None, None, TIMES) == {}

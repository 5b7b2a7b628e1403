"""From a rheometer export to a master curve: the truth is found, wrong settings are refused."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from instruments import anton_paar
from labpipe.errors import InputError
from labpipe.materials import Prony, gather_sweeps
from labpipe.schema import check
from labpipe.units import Quantity
from pipelines.experiments.dma import glass_transition, measured as dma, model
from pipelines.experiments.dma.settings import Dimensions, Fit, Specimen
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.session_text import dma_section
from pipelines.rig.solids import SOLIDS
from pipelines.session import SCHEMAS
from tests.pipelines.sessions import begun, page_of, processed, replaced, truth
from tests.pipelines.sweeps import FEW, settings_for


@pytest.fixture(scope="module")
def ptfe(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ptfe")
    export = write_dma(folder, "ptfe", SOLIDS["ptfe"], FEW, 3)
    return dma.readings(folder / export, settings=settings_for("ptfe")), truth(folder, "ptfe")


@pytest.fixture(scope="module")
def curve(ptfe):
    settings = settings_for("ptfe", fit=Fit(vertical="linear", delay="on"))  # as the session of the rig says
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sweeps = dma.sweeps([ptfe[0]], settings=settings)
        return model.master_curve(sweeps, settings=settings)


def test_the_sweeps_hold_the_true_moduli_within_the_noise(ptfe):
    found = gather_sweeps(ptfe[0], "torsion", SOLIDS["ptfe"].nu)
    assert found.sizes == {"temperature": 5, "frequency": 9}
    check(found, SCHEMAS["sweeps"])
    T, f = np.meshgrid(found.temperature, found.frequency, indexing="ij")
    true = SOLIDS["ptfe"].modulus(f, T)
    assert np.sqrt(np.mean((found.storage.values / true.real - 1) ** 2)) < 0.015
    assert np.sqrt(np.mean((found.loss.values / true.imag - 1) ** 2)) < 0.03


def test_the_master_curve_lies_on_the_truth(ptfe, curve):
    """Noise is 1 % and 2 %; shifts were found to 0.02, moduli to 0.5 % and 2 % (rms)."""
    check(curve, SCHEMAS["master_curve"])
    known = ptfe[1]
    np.testing.assert_allclose(curve.log10_aT, known["log10_aT"], atol=0.08)
    f = np.array(known["frequency"])
    covered = curve["reduced_frequency"].values
    inside = (f >= covered[0]) & (f <= covered[-1])
    solid = Prony(float(curve.E_relaxed), curve.E.values, curve.rho.values, nu=float(curve.nu))
    found = solid.complex_modulus(2 * np.pi * f[inside])
    storage = found.real / np.array(known["storage"])[inside] - 1
    loss = found.imag / np.array(known["loss"])[inside] - 1
    assert np.sqrt(np.mean(storage**2)) < 0.01
    assert np.sqrt(np.mean(loss**2)) < 0.03


def tables(intervals):
    return [
        anton_paar.make_interval(
            "test",
            "sweep",
            number,
            [
                anton_paar.make_column("Frequency", "[Hz]", frequency),
                anton_paar.make_column("Temperature", "[°C]", temperature),
                anton_paar.make_column("Storage Modulus", "[Pa]", np.full(len(frequency), 1e9)),
                anton_paar.make_column("Loss Modulus", "[Pa]", np.full(len(frequency), 1e8)),
                anton_paar.make_column("Status", "", status),
            ],
        )
        for number, (frequency, temperature, status) in enumerate(intervals, 1)
    ]


def make(intervals):
    return anton_paar.assemble(tables(intervals))


def test_ragged_frequencies_are_padded_and_temperatures_sorted():
    found = gather_sweeps(
        make([([1.0, 2.0, 4.0], [30.0, 30.1, 30.2], [""] * 3),
              ([4.0, 8.0001, 16.0, 1.0], [10.0] * 4, [""] * 4)]),
        "tension", 0.3,
    )  # fmt: skip
    np.testing.assert_allclose(found.temperature, [10.0, 30.1])
    np.testing.assert_allclose(found.frequency, [1, 2, 4, 8.0001, 16])
    assert np.isnan(found.storage.values).tolist() == [
        [False, True, False, False, False],
        [False, False, False, True, True],
    ]


def test_points_without_torque_are_left_out_and_said():
    data = make([([1.0, 2.0, 4.0, 8.0], [20.0] * 4, ["", "ME-,taD", "", ""])])
    with pytest.warns(UserWarning, match="1 of 4 points are left out"):
        found = gather_sweeps(data, "tension", 0.3)
    assert int(np.isnan(found.storage).sum()) == 1


def test_an_export_without_a_sweep_is_refused():
    data = make([([1.0] * 9, np.arange(0, 90, 10.0).tolist(), [""] * 9)])
    with pytest.raises(InputError, match="no isothermal frequency sweep"):
        gather_sweeps(data, "tension", 0.3)


def test_the_glass_transition_lies_at_the_maximum_of_the_true_curve():
    solid, T = SOLIDS["nylon"], np.arange(-40.0, 121.0, 2.0)
    fine = np.linspace(-40, 120, 8001)
    true = solid.modulus(np.ones(fine.size), fine)
    noise = np.random.default_rng(4)
    measured = solid.modulus(np.ones(T.size), T)
    storage = measured.real * np.exp(0.01 * noise.standard_normal(T.size))
    loss = measured.imag * np.exp(0.02 * noise.standard_normal(T.size))
    found = glass_transition.transitions([(1.0, np.array([T, storage, loss]))])
    peak = fine[np.argmax(true.imag / true.real)]
    assert abs(float(found.T_peak[0]) - peak) < max(3 * float(found.u_T_peak[0]), 2.0)


def test_no_transition_is_said_where_there_is_none(ptfe):
    solid, T = SOLIDS["peek"], np.arange(-40.0, 121.0, 2.0)
    measured = solid.modulus(np.ones(T.size), T)
    found = glass_transition.transitions([(1.0, np.array([T, measured.real, measured.imag]))])
    assert np.isnan(found.T_peak).all()
    assert "falls by a factor of" in json.loads(found.attrs["reasons"])[0]
    kept = ptfe[0].isel(sample=slice(0, 0)).assign_attrs(tests="[]")
    assert "absent" in dma.temperature_sweep([kept], settings=settings_for("ptfe")).attrs


def test_the_transition_over_frequency_is_that_of_the_true_curve():
    solid, T, f = SOLIDS["nbr"], np.arange(-40.0, 61.0, 10.0), np.geomspace(0.1, 10.0, 11)
    noise = np.random.default_rng(5)
    true = np.array([solid.modulus(f, np.full(f.size, t)) for t in T])
    parts = {"storage": true.real, "loss": true.imag}
    sweeps = xr.Dataset(
        {n: (("temperature", "frequency"), v * (1 + 0.01 * noise.standard_normal(v.shape))) for n, v in parts.items()},
        coords={"temperature": T, "frequency": f},
        attrs={"u_modulus_factor": 0.0, "modulus_factor": 1.0, "u_scale": 0.0},
    )
    found = model.master_curve(sweeps, settings=settings_for("nbr"))
    fine = np.linspace(-60.0, 80.0, 14001)
    for i, hertz in enumerate(found["transition_frequency"].values[:4]):
        exact = solid.modulus(np.full(fine.size, hertz), fine)
        gap = float(found["T_peak"][i]) - fine[np.argmax(exact.imag / exact.real)]
        assert not abs(gap) > 4 * float(found["u_T_peak"][i]) + 0.4, hertz  # NaN beyond the isotherms
    assert np.isfinite(found["T_peak"].values[:2]).all()


def lengths(**mm):
    return {name: Quantity(value * 1e-3, u * 1e-3, "m") for name, (value, u) in mm.items()}


def test_a_wrong_dimension_is_corrected_and_its_uncertainty_is_that_of_all_moduli(ptfe):
    """A square bar in torsion: stiffness goes with the fourth power of its side, Saint-Venant's factor is 0.1406."""
    side, own = lengths(width=(3.0, 0.0), thickness=(3.0, 0.03)), lengths(length=(20.0, 0.1))
    plain = dma.sweeps([ptfe[0]], settings=settings_for("ptfe"))
    stated = dma.sweeps([ptfe[0]], settings=settings_for("ptfe", specimen=Specimen(**own, **side)))
    np.testing.assert_allclose(stated["storage"], plain["storage"], rtol=1e-12)  # nothing was entered otherwise
    assert stated.attrs["u_scale"] == pytest.approx(np.hypot(0.1 / 20, 2 * 0.03 / 3), rel=0.02)  # thickness^4 by halves
    wrong = Dimensions(**lengths(width=(3.3, 0.0), thickness=(3.3, 0.0)))
    corrected = dma.sweeps([ptfe[0]], settings=settings_for("ptfe", specimen=Specimen(**own, **side, entered=wrong)))
    np.testing.assert_allclose(corrected["storage"], plain["storage"] * 1.1**4, rtol=1e-9)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    solid = SOLIDS["ptfe"]
    export = write_dma(tmp_path, "ptfe", solid, FEW, 3)
    return begun(tmp_path, dma_section("ptfe", export, solid))


def test_a_session_is_processed_to_a_page_with_every_section(session):
    page = page_of(processed(session), "ptfe")
    for title in (
        "Master curve",
        "Shift factors",
        "Spectrum",
        "Kramers–Kronig",
        "Temperature sweep",
        "Methods text, to paste",
        "synthetic data",
    ):
        assert title in page


def test_one_temperature_gives_a_page_that_claims_no_shift_law(session):
    solid = SOLIDS["ptfe"]
    write_dma(session, "ptfe", solid, Protocol(temperatures=(20.0,), ramp=(0.0, 5.0)), 1)
    replaced(session, 'T_ref = "20.031 degC"\n', "")
    page = page_of(processed(session), "ptfe")
    assert "a single temperature determines no shift" in page
    assert "only one temperature" in page

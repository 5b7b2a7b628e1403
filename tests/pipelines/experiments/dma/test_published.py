"""Shifts against a published table: equal tables agree, wrong ones are named with the place."""

import warnings

import msgspec
import numpy as np
import pytest
import xarray as xr

from instruments import tables
from labpipe.errors import SourceError
from labpipe.units import Quantity
from pipelines.experiments.dma import _published_section, measured as dma, model, published
from pipelines.experiments.dma.settings import Dma, Fit, Published
from pipelines.session import init
from tests.labpipe.materials.conftest import Truth, maxwell_sum, wlf_law

TRUTH = Truth(60.0, maxwell_sum, wlf_law, temperature=(0.0, 20.0, 40.0, 60.0, 80.0))
SETTINGS = Dma(
    kind="dma",
    rheometer=["x.csv"],
    mode="tension",
    nu=Quantity(0.4, 0.0, "1"),
    T_ref=Quantity(60.0, 0.0, "degC"),
    fit=Fit(vertical="none", delay="off", levels="off"),
    published=Published(shifts="shifts.csv", source="a paper"),
)


@pytest.fixture(scope="module")
def sweeps():
    made = TRUTH.sweeps(7)
    made.attrs = {"modulus_factor": 1.0}
    return made


@pytest.fixture(scope="module")
def curve(sweeps):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return model.master_curve(sweeps, settings=SETTINGS)


def table(folder, shifts, temperature=TRUTH.temperature):
    path = folder / "shifts.csv"
    rows = [f"{T:.6g},{a:.6f}" for T, a in zip(temperature, shifts, strict=True)]
    path.write_text("\n".join(["T,log_aT", "C,-", *rows]) + "\n", encoding="utf-8")
    return path


def compared(folder, sweeps, curve, shifts, **options):
    path = table(folder, shifts, **options)
    return published.compared(sweeps, curve, path, settings=SETTINGS)


def test_the_true_table_is_found_to_agree_whatever_its_reference(tmp_path, sweeps, curve):
    found = compared(tmp_path, sweeps, curve, TRUTH.log10_aT + 3.0)
    assert np.nanmax(np.abs(found.difference)) < 0.1
    assert found.attrs["published_at_reference"] == pytest.approx(3.0)
    said = " ".join(_published_section.reasons(found, curve))
    assert "do not distinguish the two tables" in said
    assert "+3.00, which is subtracted" in said
    assert "a paper" in said


def test_a_table_with_a_wrong_step_contradicts_the_readings(tmp_path, sweeps, curve):
    wrong = TRUTH.log10_aT + np.array([0.8, 0.8, 0.0, 0.0, 0.0])
    found = compared(tmp_path, sweeps, curve, wrong)
    assert "contradicts the published steps" in " ".join(_published_section.reasons(found, curve))
    assert found.attrs["residual_loss"] > 0.04
    assert [block.summary for block in _published_section.blocks(found, curve)[1:2]] == ["Differences by temperature"]


def test_temperatures_outside_the_table_are_left_out(tmp_path, sweeps, curve):
    found = compared(tmp_path, sweeps, curve, TRUTH.log10_aT[1:4], temperature=(20.0, 40.0, 60.0))
    assert np.isnan(found.difference.values).tolist() == [True, False, False, False, True]


@pytest.mark.parametrize("temperature", [(200.0, 300.0), (40.0,)])
def test_a_table_that_shares_nothing_is_refused(tmp_path, sweeps, curve, temperature):
    with pytest.raises(SourceError, match="shares fewer than 2"):
        compared(tmp_path, sweeps, curve, np.zeros(len(temperature)), temperature=temperature)


def test_sweeps_are_no_table_of_shifts(tmp_path, sweeps, curve):
    path = tmp_path / "sweeps.csv"
    path.write_text("f,E_stor,E_loss,T\nHz,Pa,Pa,C\n1,2,3,4\n", encoding="utf-8")
    with pytest.raises(SourceError, match="no column log_aT"):
        published.compared(sweeps, curve, path, settings=SETTINGS)


def test_without_a_table_there_is_nothing_to_compare(sweeps, curve):
    settings = msgspec.structs.replace(SETTINGS, published=None)
    found = published.compared(sweeps, curve, None, settings=settings)
    assert "absent" in found.attrs


def test_a_scan_proposes_table_and_comparison(tmp_path, sweeps):
    rows = [
        f"{f:.6g},{float(sweeps.storage[i, j]):.6g},{float(sweeps.loss[i, j]):.6g},{T:.6g},{i}"
        for i, T in enumerate(TRUTH.temperature)
        for j, f in enumerate(TRUTH.frequency)
    ]
    text = "\n".join(["f,E_stor,E_loss,T,Set", "Hz,Pa,Pa,C,-", *rows]) + "\n"
    (tmp_path / "polymer.csv").write_text(text, encoding="utf-8")
    table(tmp_path, TRUTH.log10_aT)
    scan = init(tmp_path)
    assert scan.experiments == ["polymer"]
    assert 'published = { shifts = "shifts.csv"' in scan.path.read_text("utf-8")
    gathered = dma.gathered([dma.readings(tmp_path / "polymer.csv", settings=SETTINGS)], settings=SETTINGS)
    np.testing.assert_allclose(gathered.storage, sweeps.storage, rtol=1e-5)
    assert isinstance(tables.read(tmp_path / "shifts.csv"), xr.Dataset)

"""The virtual rheometer's materials obey causality and are no sums of exponentials."""

import json

import numpy as np
import pytest

import instruments
from labpipe.materials import kramers_kronig
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.solids import SOLIDS

FREQUENCY = np.logspace(-4, 4, 120)


@pytest.mark.parametrize("name", sorted(SOLIDS))
def test_a_solid_is_causal_stiffens_with_frequency_and_shifts_without_a_jump(name):
    solid = SOLIDS[name]
    modulus = solid.modulus(FREQUENCY, np.full(FREQUENCY.size, solid.T_ref))
    assert (np.diff(modulus.real) > 0).all()
    assert (modulus.imag > 0).all()
    assert kramers_kronig(FREQUENCY, modulus.real, modulus.imag).verdict == "pass"
    shift = np.diff(solid.log10_aT(np.linspace(-40, 120, 1601)))
    assert float(solid.log10_aT(solid.T_ref)) == 0.0
    assert ((shift > -0.05) & (shift < 0.0)).all()


def test_an_export_says_that_it_is_synthetic_and_repeats_itself(tmp_path):
    protocol = Protocol(temperatures=(20.0, 40.0), ramp=(0.0, 10.0))
    for folder in ("a", "b"):
        write_dma(tmp_path / folder, "nbr", SOLIDS["nbr"], protocol, 5)
    first, second = (tmp_path / f / "dma/nbr.csv" for f in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    readings = instruments.read(first)
    assert "SYNTHETIC" in readings.attrs["project"]
    assert readings.sizes["sample"] == 24
    truth = json.loads((tmp_path / "a/truth/nbr.json").read_text("utf-8"))
    assert truth["synthetic"] is True
    storage = readings.storage_modulus.values[0]
    true = SOLIDS["nbr"].modulus(10.0, 20.2).real
    assert abs(storage / true - 1) < 0.05

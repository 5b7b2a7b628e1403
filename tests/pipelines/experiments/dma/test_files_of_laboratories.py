"""Sweeps as other laboratories keep them, from the folder to the master curve."""

import warnings

import numpy as np
import pytest

from labpipe.errors import InputError, UsageError
from labpipe.materials import Prony, gather_sweeps
from labpipe.units import Quantity
from pipelines.experiments.dma import measured, model
from pipelines.experiments.dma.settings import Dma
from pipelines.session import export, init, process, result

SOLID = Prony(1e6, np.array([3e8, 1e8, 2e7]), np.array([1e-3, 1e-1, 1e1]), nu=0.35)
RHO = np.geomspace(1e-6, 1e6, 60)
BROAD = Prony(5e6, 1e8 / (1 + np.log10(RHO) ** 2), RHO, nu=0.35)
"""As broad as polymers are: times tell the moduli at frequencies of a smooth spectrum only."""
FREQUENCY = np.geomspace(0.1, 10, 7)
SHIFT = {20.0: 1.0, 40.0: 0.0, 60.0: -1.0}


def rows(t, sep="\t"):
    modulus = SOLID.complex_modulus(2 * np.pi * FREQUENCY * 10 ** SHIFT[t])
    lines = zip(2 * np.pi * FREQUENCY, modulus.real, modulus.imag, strict=True)
    return "".join(sep.join(f"{v:.12g}" for v in line) + "\n" for line in lines)


def settings_for(files, **changes):
    return Dma(kind="dma", rheometer=list(files), mode="tension", nu=Quantity(0.35, 0.0, "1"), **changes)


def degrees(value):
    return Quantity(value, 0.0, "degC")


def write(folder, text="omega\tE'\tE''\nrad/s\tPa\tPa\n", name="pi_{t:g}C.dat", of=rows):
    names = [name.format(t=t) for t in SHIFT]
    for t, file in zip(SHIFT, names, strict=True):
        (folder / file).write_text(text.format(t=t) + of(t), "utf-8")
    return names


def test_one_file_per_temperature_without_a_column_of_it(tmp_path):
    names = write(tmp_path)
    settings = settings_for(names, temperatures=[degrees(t) for t in SHIFT])
    sweeps = measured.sweeps([measured.readings(tmp_path / n, settings=settings) for n in names], settings=settings)
    assert sweeps.temperature.values.tolist() == list(SHIFT)
    truth = SOLID.complex_modulus(2 * np.pi * FREQUENCY * 10)
    np.testing.assert_allclose(sweeps.storage.values[0], truth.real, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, 'pi_20C.dat has no column for: temperature; state it in session.toml, temperature = "25 degC"'),
        ({"temperatures": [degrees(1.0)]}, "temperatures holds 1 values for 3 files"),
        ({"temperature": degrees(1.0), "temperatures": [degrees(1.0)] * 3}, "both given; keep one"),
    ],
)
def test_a_temperature_that_is_missing_or_too_many_is_told(tmp_path, changes, message):
    names = write(tmp_path)
    settings = settings_for(names, **changes)
    with pytest.raises(InputError, match=message):
        gather_sweeps(measured.readings(tmp_path / names[0], settings=settings), "tension", 0.35)


def test_files_of_one_isotherm_each_are_one_experiment_from_scan_to_curve(tmp_path):
    write(tmp_path, "T={t:g};Mw=20;chem=PI;\nFreq\tE'\tE''\nrad/s\tPa\tPa\n", "pi_{t:g}C.osc")
    found = init(tmp_path)
    assert found.experiments == ["pi"]
    text = found.path.read_text("utf-8")
    text = text.replace('mode = "FILL"', 'mode = "tension"').replace('nu = "FILL"', 'nu = "0.35"')
    found.path.write_text(text, "utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert not process(tmp_path, jobs=0).failures
    curve = result(tmp_path, "pi", "master_curve")
    np.testing.assert_allclose(np.diff(curve.log10_aT), [-1.0, -1.0], atol=0.05)
    written_for_simulation(tmp_path)


def written_for_simulation(folder):
    """Write the material for a code, with the bulk modulus as chosen; what is impossible is told."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (path,) = export(folder, "abaqus", only="pi", bulk="constant").paths
        assert path.name == "pi.material.inp"
        shares = [
            line.split(", ")
            for line in path.read_text("utf-8").splitlines()
            if line[0].isdigit() and line.count(", ") == 2
        ]
        assert {row[1] for row in shares[:3]} == {"0"}
        relaxing = export(folder, "lsdyna").paths[0].read_text("utf-8")
        both = {path.name for path in export(folder, "json", only="pi").paths}
    assert "*MAT_GENERAL_VISCOELASTIC" in relaxing
    assert {"pi.material.json", "pi.master_curve.json"} <= both
    with pytest.raises(UsageError, match="ansys writes the materials of a whole session"):
        export(folder / "pi_20C.osc", "ansys")


def holds(t):
    time = np.geomspace(0.02, 200, 60)
    values = BROAD.relaxation(time / 10 ** SHIFT[t])
    return "".join(f"{a:.12g}\t{b:.12g}\n" for a, b in zip(time, values, strict=True))


def test_relaxation_tests_are_sweeps_of_a_master_curve(tmp_path):
    names = write(tmp_path, "t\tE(t)\ns\tPa\n", of=holds)
    settings = settings_for(names, temperatures=[degrees(t) for t in SHIFT], T_ref=degrees(40.0))
    sweeps = measured.sweeps([measured.readings(tmp_path / n, settings=settings) for n in names], settings=settings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        curve = model.master_curve(sweeps, settings=settings)
    np.testing.assert_allclose(curve.log10_aT, list(SHIFT.values()), atol=0.05)

"""Mach-1 text files: what is read, in which unit and sign, and that it is written back."""

import json
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import instruments
from instruments import mach1
from tests.instruments.mach1_blocks import split_blocks

SAMPLES = Path(__file__).parents[2] / "../shared/samples/mach1"
DYNAMIC = SAMPLES / "dynamic_5_sinusoid_blocks.txt"
RELAXATION = SAMPLES / "stress_relaxation_3_ramps.txt"

needs_samples = pytest.mark.skipif(not SAMPLES.exists(), reason="the public sample files are not beside the checkout")

GF = 0.00980665


def sinusoid(n=30, frequency=1.0):
    time = np.arange(n) * 0.01
    position, force = (m + a * np.sin(2 * np.pi * frequency * time) for m, a in ((1.8776e-3, 4.69e-5), (196.6, 2.0)))
    parameters = {"Stage Axis": "Position (z)", "Amplitude, mm": "0.0469", "Frequency, Hz": f"{frequency:.5f}"}
    columns = {"Time, s": time, "Position (z), mm": position, "Fz, gf": force}
    return mach1.make_block("Sinusoid", datetime(2024, 1, 24, 10, 8), columns, parameters, images_folder="Rep1_004")


def relaxation(n=40, dividers=(20, 40)):
    time = np.arange(n) * 0.01
    columns = {"Time, s": time, "Position (z), mm": 1.574e-4 + 1e-6 * time, "Position (theta), deg": np.zeros(n)}
    columns |= {"Fz, N": -0.25 - 0.01 * time, "Tx, N-mm": 1.1e-3 + 1e-4 * time}
    start, parameters = datetime(2023, 7, 19, 23, 59, 59, 900000), {"Relaxation Rate, N/min": "0.0100"}
    cell = mach1.LOAD_CELLS["17N"]
    return mach1.make_block("Stress Relaxation", start, columns, parameters, load_cell=cell, dividers=dividers)


def read_blocks(tmp_path, *blocks):
    path = tmp_path / "made.txt"
    mach1.write(path, mach1.assemble(blocks))
    return mach1.read(path)


def test_values_are_si_and_keep_their_unit_as_provenance(tmp_path):
    readings = read_blocks(tmp_path, relaxation())
    assert readings.position_z.attrs["units"] == "m"
    assert readings.position_z.attrs["original_unit"] == "mm"
    assert readings.position_z.values[0] == pytest.approx(1.574e-4, rel=1e-12)
    assert readings.torque_x.attrs["units"] == "N m"
    assert readings.torque_x.values[0] == pytest.approx(1.1e-3, abs=3e-6)
    assert readings.position_theta.attrs["units"] == "rad"


def test_compression_sign_follows_the_type_of_the_cell(tmp_path):
    assert read_blocks(tmp_path, relaxation()).attrs["compression_sign"] == -1
    assert read_blocks(tmp_path, sinusoid()).attrs["compression_sign"] == 1
    both = read_blocks(tmp_path, sinusoid(), relaxation())
    assert "compression_sign" not in both.attrs
    np.testing.assert_array_equal(both.compression_sign.values, [1, -1])


def test_declared_parameters_are_si_over_blocks(tmp_path):
    readings = read_blocks(tmp_path, sinusoid(frequency=2.0), relaxation())
    np.testing.assert_array_equal(readings.declared_frequency.values, [2.0, np.nan])
    assert readings.declared_amplitude.values[0] == pytest.approx(4.69e-5)
    assert readings.declared_relaxation_rate.values[1] == pytest.approx(0.01 / 60)
    assert readings.declared_relaxation_rate.attrs["units"] == "N/s"


def test_write_read_is_the_identity(tmp_path):
    made, path = mach1.assemble((sinusoid(), relaxation(dividers=(0, 20, 40)), sinusoid(1))), tmp_path / "a.txt"
    mach1.write(path, made)
    again = mach1.read(path)
    for name in made.variables:
        xr.testing.assert_equal(made[name].variable, again[name].variable)
    assert mach1.encode(again) == path.read_bytes()


@needs_samples
@pytest.mark.parametrize("path", [DYNAMIC, RELAXATION], ids=["dynamic", "relaxation"])
def test_public_files_are_rewritten_byte_for_byte(path):
    assert mach1.encode(instruments.read(path)) == path.read_bytes()


@needs_samples
def test_public_dynamic_file_has_its_five_frequencies():
    readings = instruments.read(DYNAMIC)
    np.testing.assert_array_equal(readings.declared_frequency.values, [0.1, 0.2, 0.5, 1.0, 2.0])
    np.testing.assert_array_equal(readings.n_rows.values, [20270, 10180, 4130, 2100, 1110])
    assert readings.attrs["compression_sign"] == 1
    # Not tared, 20 051 gf of preload; commands are up to 1 % and 4 % off.
    assert readings.force_z.values[0] == pytest.approx(20051.351733 * GF, rel=1e-12)
    block = split_blocks(readings)[4]
    crossings = np.flatnonzero(np.diff(np.sign(block.position_z.values - 1.8781e-3)) > 0)
    assert block.sizes["time"] == 1110
    assert crossings.size >= 19
    ends = block.start_time.item()
    assert ends.startswith("2024-01-24T10:")


@needs_samples
def test_public_relaxation_file_has_three_ramps_and_nine_columns():
    readings = instruments.read(RELAXATION)
    assert readings.sizes["sample"] == 117_900
    assert readings.segment.values.max() == 2
    assert len(json.loads(readings.attrs["blocks"])[0]["columns"]) == 9
    assert readings.attrs["compression_sign"] == -1
    assert readings.force_z.values[0] == -0.249172

"""Load cell: compression positive, an honest tare, and the lag of the filter by its formula."""

import json
import math
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

import calibration
from calibration import load_cell
from instruments import mach1
from labpipe.errors import CalibrationError, InputError
from labpipe.units import Quantity
from tests.calibration.records import made
from tests.instruments.mach1_blocks import split_blocks

SAMPLES = Path(__file__).parents[2] / "../shared/samples/mach1"
START = datetime(2024, 1, 24, 10)


def record(scale="1.002 ± 0.001", serial="", instrument="25kg", **values):
    return made("load_cell", instrument, START.date(), {"scale": scale, **values}, serial=serial)


def press(n=400, rest=200, offset=-0.25, seed=0, cell="17N"):
    """Force of a rest, then a ramp to 1 N of compression, in the sign of the cell."""
    time = np.arange(n) * 0.01
    pressed = np.clip(time - rest * 0.01, 0, None) / 2.0
    noise = np.random.default_rng(seed).normal(0, 0.002, n)
    is_six = cell == "17N"
    shown = offset + (-pressed if is_six else pressed) + noise
    columns = {"Time, s": time, "Position (z), mm": time * 1e-4}
    columns["Fz, N" if is_six else "Fz, gf"] = shown
    return mach1.make_block("Wave", START, columns, {}, load_cell=mach1.LOAD_CELLS[cell]), pressed


@pytest.mark.parametrize(("cell", "sign"), [("17N", -1), ("25g", 1)])
def test_compression_is_positive_for_either_cell(cell, sign):
    block, pressed = press(cell=cell)
    result = load_cell.force(mach1.assemble([block]), zero="start")
    assert result.attrs["compression_sign"] == sign
    np.testing.assert_allclose(result.force.values, pressed, atol=0.012)
    np.testing.assert_array_equal(result.force_raw.values, mach1.assemble([block]).force_z.values)


def test_tare_by_window_number_or_quantity():
    block, _ = press()
    readings = split_blocks(mach1.assemble([block]))[0]
    result = load_cell.force(readings)  # nothing is tared unless asked
    np.testing.assert_array_equal(result.force.values, -readings.force_z.values)
    assert (result.attrs["tared"], float(result.tare)) == (0, 0.0)
    for zero in ("start", (0.0, 1.5)):
        result = load_cell.force(readings, zero=zero)
        assert float(result.tare) == pytest.approx(-0.25, abs=5 * float(result.u_tare))
        assert 0 < float(result.u_tare) < 0.001
    assert float(load_cell.force(readings, zero=-0.25).tare) == -0.25
    given = load_cell.force(readings, zero=Quantity(-0.25, 0.01, "N"))
    assert float(given.u_tare) == 0.01
    with pytest.raises(InputError, match='zero must be "start"'):
        load_cell.force(readings, zero="end")
    with pytest.raises(InputError, match="the zero is in m, expected a force in N"):
        load_cell.force(readings, zero=Quantity(0.1, 0.01, "m"))


def test_tare_of_a_file_comes_from_its_first_block():
    first, _ = press(offset=-0.25)
    second, _ = press(offset=-0.9)
    result = load_cell.force(mach1.assemble([first, second]), zero="start")
    assert float(result.tare) == pytest.approx(-0.25, abs=0.002)
    assert float(result.force[400]) == pytest.approx(0.65, abs=0.01)
    assert float(result.u_force[0]) == pytest.approx(0.002, rel=0.15)
    assert result.attrs["resolution"] == pytest.approx(0.00085, rel=0.01)
    # without a record the gain is said to be unknown
    assert float(result.gain) == 1.0
    assert math.isnan(float(result.u_gain))
    assert "no record" in json.loads(result.attrs["calibration"])
    assert "gain" not in {row["source"] for row in json.loads(result.attrs["budget"])}


def test_record_scales_and_enters_the_budget():
    block, pressed = press(cell="25g")
    known = record("1.002 ± 0.001", instrument="25g", linearity="0 ± 0.001 N", capacity="0.9 N")
    readings = mach1.assemble([block])
    result = calibration.apply(readings, known, zero="start")
    beyond = np.flatnonzero(pressed > 0.91 + 0.25)
    assert np.isnan(result.force.values[beyond]).all()
    within = result.valid.values
    np.testing.assert_array_equal(np.isfinite(result.force.values), within)
    np.testing.assert_allclose(result.force.values[within], 1.002 * pressed[within], atol=0.012)
    rows = {row["source"]: row for row in json.loads(result.attrs["budget"])}
    largest = float(result.force.max())
    assert rows["gain"]["contribution"] == pytest.approx(0.001 * largest / 1.002, rel=1e-6)
    assert rows["linearity"]["contribution"] == pytest.approx(0.001)
    assert sum(row["share"] for row in rows.values()) == pytest.approx(1.0)


def test_unknown_sign_is_asked_for():
    block, pressed = press()
    readings = mach1.assemble([block])
    assert load_cell.declared_filter(readings.attrs) == {"order": 3, "cutoff": 20.0}
    assert load_cell.declared_filter({}) is None
    del readings.attrs["compression_sign"]
    with pytest.raises(CalibrationError, match="compression_sign=1"):
        load_cell.force(readings)
    result = load_cell.force(readings, zero="start", compression_sign=-1)
    np.testing.assert_allclose(result.force.values, pressed, atol=0.012)
    with pytest.raises(InputError, match="must be 1 or -1"):
        load_cell.force(readings, compression_sign=2)


@pytest.mark.parametrize("frequency", [0.1, 50.0])
def test_lag_is_that_of_the_butterworth_polynomial(frequency):
    s = 1j * frequency / 20.0
    response = 1 / ((s + 1) * (s**2 + s + 1))
    lag = load_cell.filter_lag(frequency, 3, 20.0)
    assert lag.gain == pytest.approx(abs(response), rel=1e-12)
    phase = -np.angle(1 / (s + 1)) - np.angle(1 / (s**2 + s + 1))
    assert lag.phase == pytest.approx(phase, rel=1e-10)
    assert lag.delay == pytest.approx(phase / (2 * math.pi * frequency), rel=1e-10)
    # the unknown type of the filter is in the uncertainty
    bessel = signal.besselap(3, norm="mag")[1]
    other = float(-np.sum(np.angle(bessel / (bessel - 1j * frequency / 20.0))))
    assert abs(other - lag.phase) < 2 * lag.u_phase
    assert "elastic reference" in lag.note


@pytest.mark.skipif(not SAMPLES.exists(), reason="the public sample files are not here")
def test_public_files_give_compression_positive_forces():
    six = mach1.read(SAMPLES / "stress_relaxation_3_ramps.txt")
    result = load_cell.force(six, zero="start")
    assert float(result.tare) == pytest.approx(-0.2492, abs=0.001)
    assert float(result.force.max()) > 0.5
    assert result.attrs["resolution"] == pytest.approx(0.00085, rel=0.01)
    single = mach1.read(SAMPLES / "dynamic_5_sinusoid_blocks.txt")
    result = load_cell.force(single)
    assert float(result.force.min()) > 100  # 20 kgf of preload, not tared away
    assert result.attrs["resolution"] == pytest.approx(1.506261 * 0.00980665, rel=1e-4)

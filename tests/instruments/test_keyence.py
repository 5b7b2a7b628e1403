"""Keyence storage files in the assumed layout: values, states, units, time, and the way back."""

import json
from datetime import datetime

import numpy as np
import pytest

import instruments
from instruments import keyence
from instruments.keyence import Status
from labpipe.errors import SourceError
from labpipe.units import quantity

# The assumed layout, with one output in micrometres.
EXAMPLE = """\
Model,LK-G5001
Date,2024/05/14 10:22:31
Sampling cycle,50us
Storage cycle,x1
Unit,mm,µm
No.,OUT1,OUT2
1,+00.1234,-00.0120
2,+00.1236,-FFFFFFF
3,+FFFFFFF,-------
"""


def read_text(tmp_path, text, codec="utf-8", **options):
    path = tmp_path / "a.csv"
    path.write_bytes(text.replace("\n", "\r\n").encode(codec))
    return keyence.read(path, **options)


OUTPUTS = {1: 2.5e-3 - 2e-3 * np.cos(300 * 50e-6 * np.arange(500)), 2: 1e-3 * np.sin(500 * 50e-6 * np.arange(500))}
AS_SET = {"cycle": "50 us", "start": datetime(2024, 5, 14, 10, 22, 31)}


def test_example_is_read_in_si_with_states(tmp_path):
    readings = read_text(tmp_path, EXAMPLE)
    np.testing.assert_allclose(readings.out1.values, [1.234e-4, 1.236e-4, np.nan], rtol=1e-14)
    np.testing.assert_allclose(readings.out2.values, [-1.2e-8, np.nan, np.nan], rtol=1e-14)
    assert readings.status1.values.tolist() == [0, 0, Status.RANGEOVER_P]
    assert readings.status2.values.tolist() == [0, Status.RANGEOVER_N, Status.WAITING]
    np.testing.assert_allclose(readings.time.values, [0, 50e-6, 100e-6], rtol=1e-14)
    assert readings.attrs["layout"] == "assumed"
    assert readings.attrs["model"] == "LK-G5001"
    assert readings.attrs["start"] == "2024-05-14T10:22:31"
    assert readings.attrs["sampling_interval"] == pytest.approx(50e-6)
    assert readings.attrs["header"] == EXAMPLE[: EXAMPLE.index("1,+")].rstrip("\n")
    assert json.loads(readings.attrs["status_counts"])["status2"] == {"VALID": 1, "RANGEOVER_N": 1, "WAITING": 1}


TOKENS = [
    ("+FFFFFFF", Status.RANGEOVER_P),
    ("-099999999", Status.RANGEOVER_N),
    ("FFFFFFF", Status.SUSPECT),
    ("XXXXXXXX", Status.WAITING),
    ("-----", Status.WAITING),
    ("ALARM", Status.ALARM),
    ("+EE.EEE", Status.ALARM),
    ("+100000000", Status.ALARM),
    ("Invalid", Status.INVALID),
    ("-1048576", Status.INVALID),
    ("-999999", Status.INVALID),
    ("-999.9999", Status.SUSPECT),
    ("#NAME?", Status.SUSPECT),
    ("+99.9999", Status.RANGEOVER_P),
    ("-99.9999", Status.RANGEOVER_N),
    ("+99.999", Status.SUSPECT),
]


@pytest.mark.parametrize(("token", "status"), TOKENS, ids=[token for token, _ in TOKENS])
@pytest.mark.parametrize("row", [0, 7])
def test_every_marker_becomes_nan_and_a_state(tmp_path, token, status, row):
    cells = [f"+0{i}.1234" for i in range(9)]
    cells[row] = token
    rows = "".join(f"{i},{cell},+00.0001\n" for i, cell in enumerate(cells, 1))
    readings = read_text(tmp_path, EXAMPLE[: EXAMPLE.index("1,+")] + rows)
    assert np.flatnonzero(np.isnan(readings.out1.values)).tolist() == [row]
    assert readings.status1.values[row] == status
    assert readings.status1.values.sum() == status
    assert np.isfinite(readings.out2.values).all()


@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ",")])
@pytest.mark.parametrize("codec", ["utf-8", "utf-16", "cp932"])
def test_every_codec_delimiter_and_decimal_sign_gives_the_same_readings(tmp_path, delimiter, decimal, codec):
    made = keyence.encode(OUTPUTS, **AS_SET, measuring_range=4e-3, averaging=16, storage_factor=2)
    path = tmp_path / "made.csv"
    text = made.decode("utf-8-sig").replace(",", delimiter).replace(".", decimal).replace("No,", "No.")
    path.write_bytes(text.encode(codec))
    again = instruments.read(path)
    over = OUTPUTS[1] > 4e-3
    np.testing.assert_array_equal(again.status1.values, np.where(over, Status.RANGEOVER_P, 0))
    assert np.isnan(again.out1.values[over]).all()
    np.testing.assert_allclose(again.out1.values[~over], OUTPUTS[1][~over], atol=0.5001e-7)
    np.testing.assert_allclose(again.out2.values, OUTPUTS[2], atol=0.5001e-7)
    found = [again.attrs[key] for key in ("storage_factor", "averaging", "start", "model", "decimal")]
    assert found == [2, 16, "2024-05-14T10:22:31", "LK-G5001", decimal]
    assert again.attrs["sampling_interval"] == pytest.approx(1e-4)


@pytest.mark.parametrize(
    ("unit", "decimals", "largest"), [("cm", 5, 0.09), ("um", 2, 9e-3), ("V", 4, 9.0), ("m/s2", 3, 9.0)]
)
def test_write_read_is_the_identity(tmp_path, unit, decimals, largest):
    values = np.r_[np.linspace(-largest, largest, 14), np.nan]
    keyence.write(tmp_path / "a.csv", {3: values}, **AS_SET, unit_text=unit, decimals=decimals)
    again = keyence.read(tmp_path / "a.csv")
    np.testing.assert_allclose(again.out3.values, values, atol=0.501 * again.out3.attrs["resolution"])
    assert again.status3.values.tolist() == [0] * 14 + [Status.WAITING]
    keyence.write(tmp_path / "b.csv", {3: again.out3.values}, **AS_SET, unit_text=unit, decimals=decimals)
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "a.csv").read_bytes()


def test_volts_stay_volts_and_saturation_is_suspect(tmp_path):
    text = EXAMPLE.replace("mm,µm", "V,mm").replace("1,+00.1234", "1,+10.0000")
    readings = read_text(tmp_path, text)
    assert readings.out1.attrs["units"] == "V"
    assert readings.status1.values[0] == Status.SUSPECT
    assert np.isnan(readings.out1.values[0])
    assert readings.out1.values[1] == pytest.approx(0.1236)


@pytest.mark.parametrize(
    ("old", "line", "cycle", "factor"),
    [
        ("Sampling cycle,50us", "Sampling cycle(us),20", 20e-6, 1),
        ("Sampling cycle,50us", "Sampling cycle: 20 µs", 20e-6, 1),
        ("Sampling cycle,50us", "sampling period,1ms", 1e-3, 1),
        ("Sampling cycle,50us", "Sampling rate,20kHz", 50e-6, 1),
        ("cycle,x1", "cycle,x10", 50e-6, 10),
        ("cycle,x1", "cycle,500us", 50e-6, 10),
    ],
)
def test_sampling_and_storage_cycle_are_read_in_their_spellings(tmp_path, old, line, cycle, factor):
    readings = read_text(tmp_path, EXAMPLE.replace(old, line))
    assert (readings.attrs["sampling_cycle"], readings.attrs["storage_factor"]) == (pytest.approx(cycle), factor)
    assert readings.time.values[1] == pytest.approx(cycle * factor)


@pytest.mark.parametrize(
    ("line", "words", "option", "interval"),
    [
        ("Sampling cycle,50us\n", 'cycle="50 us"', {"cycle": "50 us"}, 50e-6),
        ("Sampling cycle,50us\n", 'cycle="50 us"', {"cycle": quantity("50 us")}, 50e-6),
        ("Unit,mm,µm\n", r'units=\["mm"\]', {"units": ["mm", "um"]}, 50e-6),
        ("Storage cycle,x1\n", "storage_factor=1", {"storage_factor": 5}, 250e-6),
    ],
)
def test_what_the_header_lacks_is_asked_for(tmp_path, line, words, option, interval):
    text = EXAMPLE.replace(line, "")
    with pytest.raises(SourceError, match=words):
        read_text(tmp_path, text)
    readings = read_text(tmp_path, text, **option)
    assert readings.time.values[1] == pytest.approx(interval)
    assert readings.out2.values[0] == pytest.approx(-1.2e-8, rel=1e-6, abs=0.0)


def test_last_line_without_end_is_accepted_only_when_the_count_is_stated(tmp_path):
    with pytest.raises(SourceError, match="the last line is cut"):
        read_text(tmp_path, EXAMPLE.rstrip("\n"))
    stated = EXAMPLE.replace("Unit", "Data count,3\nUnit").replace("3,+FFFFFFF,-------", "3,+01.5000,+01.2345")
    readings = read_text(tmp_path, stated.rstrip("\n"))
    assert readings.sizes["time"] == 3
    with pytest.raises(SourceError, match="the last line is cut"):
        read_text(tmp_path, stated.rstrip("\n")[:-1])


def test_counter_with_a_gap_is_refused_or_followed_on_request(tmp_path):
    text = EXAMPLE.replace("3,+FFFFFFF,-------", "5,+00.1240,-00.0120")
    with pytest.raises(SourceError, match="5 after 2, expected 3") as caught:
        read_text(tmp_path, text)
    assert (caught.value.line, caught.value.column) == (9, 1)
    with pytest.warns(UserWarning, match="the time follows the counter"):
        readings = read_text(tmp_path, text, allow_incomplete=True)
    np.testing.assert_allclose(readings.time.values, [0, 50e-6, 200e-6])


N_DROP = 400
DROP = np.round(1.5 - 0.5 * 9810.0 * np.minimum(np.arange(N_DROP) * 1e-4, 0.0175) ** 2, 4)
LINES = "Sampling cycle,100us\nStorage cycle,x1\n"


def table(row, n=N_DROP):
    """Write every row of the fall by its number, time in s and ms, and value."""
    return "".join(row.format(i=i + 1, t=i * 1e-4, ms=i * 0.1, v=DROP[i]) + "\n" for i in range(n))


TIMES = {
    "time of every row in s": "Time [s],OUT1 [mm]\n" + table("{t:.6f},{v:+.4f}"),
    "in ms, decimal commas": "Zeit [ms];OUT1 [mm]\n" + table("{ms:.3f};{v:+.4f}").replace(".", ","),
    "names of another program": "Time (s),Displacement (mm)\n" + table("{t:.6f},{v:+.4f}"),
    "judgements": LINES + "Unit,mm\nNo.,OUT1,Judge\n" + table("{i},{v:+08.4f},GO"),
    "German": "Abtastzyklus;100 us\nSpeicherzyklus;x1\nEinheit;mm\nNr.;OUT1\n" + table("{i};{v:+.4f}"),
}


@pytest.mark.parametrize("name", TIMES)
def test_other_columns_labels_and_footers_leave_the_numbers(tmp_path, name):
    readings = read_text(tmp_path, TIMES[name])
    np.testing.assert_allclose(readings.out1.values, DROP * 1e-3, rtol=1e-12)
    np.testing.assert_allclose(readings.time.values, np.arange(N_DROP) * 1e-4, rtol=0, atol=1e-9)


def test_a_column_of_notes_is_passed_over(tmp_path):
    text = LINES + "Unit,mm\nNo.,OUT1,Note\n" + table("{i},{v:+08.4f},").replace("\n", "released by hand\n", 1)
    with pytest.warns(UserWarning, match="not read: Note"):
        readings = read_text(tmp_path, text)
    np.testing.assert_allclose(readings.out1.values, DROP * 1e-3, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "words", "line"),
    [
        ("Time,OUT1[mm]\n" + table("{t:.4f},{v}"), "the unit of 'Time' is not stated", 1),
        ("Time [kg],OUT1[mm]\n" + table("{t:.4f},{v}"), "expected a unit of s for time", 1),
        (TIMES["time of every row in s"].replace("0.000500,", "0.0x0500,"), "expected a number", 7),
        ("Time [s],OUT1[mm]\n" + table("{t:.4f},{v}").replace("0.0100,", "0.0300,"), "are uneven", 102),
        (LINES + "Unit,mm\nTime [s],OUT1\n" + table("{ms:.1f},{v}"), "the cycle is stated as 0.0001 s", 5),
        ("Time,OUT1[mm]\n" + table("10:22:3{t:.4f},{v:+.4f}"), "the rows carry times of day", 2),
        (TIMES["judgements"].replace("4,+01.4996,GO", "4,+01.4996"), "2 cells, expected 3", 8),
    ],
)
def test_times_and_footers_that_do_not_fit_are_refused(tmp_path, text, words, line):
    with pytest.raises(SourceError, match=words) as caught:
        read_text(tmp_path, text)
    assert caught.value.line == line


RECORDED = np.arange(40) * 2e-4
VOLTAGE = 3.1 - 4905 * RECORDED**2
LVM = "LabVIEW Measurement\nChannels\t1\nSamples\t40\nY_Unit_Label\tVolts\nDelta_X\t2.0E-4\n***End_of_Header***\t\n"


@pytest.mark.parametrize("head", ["Time,Channel A\n(ms),(mV)\n\n", "Time (ms) Run #1,Position (mV) Run #1\n"])
def test_a_column_of_times_is_no_output_and_its_units_count(tmp_path, head):
    path = tmp_path / "a.csv"
    rows = "".join(f"{t * 1e3:.7f},{z:.5f}\n" for t, z in zip(RECORDED, VOLTAGE, strict=True))
    path.write_text(head + rows, "utf-8")
    found = keyence.read(path)
    assert [name for name in found.data_vars if name.startswith("out")] == ["out1"]
    np.testing.assert_allclose(found.out1, VOLTAGE * 1e-3, atol=1e-8)
    assert found.out1.attrs["units"] == "V"
    assert found.attrs["sampling_interval"] == pytest.approx(2e-4)
    with pytest.raises(SourceError, match="units"):
        keyence.read(path, units=["mm"])
    with pytest.raises(SourceError, match="the option units says"):
        keyence.read(path, units=["mm", "mm"], cycle="200 us")


def test_the_unit_of_a_labview_header_counts(tmp_path):
    path = tmp_path / "a.lvm"
    path.write_text(LVM + "X_Value\tVoltage\tComment\n" + "".join(f"\t{z:.6f}\n" for z in VOLTAGE), "utf-8")
    with pytest.raises(SourceError, match="Volts"):
        keyence.read(path, units=["mm"], cycle="200 us")

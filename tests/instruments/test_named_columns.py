"""Tables that no reader recognises, read by the columns that the user names: Python, command line and session."""

# ruff: noqa: E501 (a table of a recorder is seen best on one line)

import json

import numpy as np
import pytest
from click.testing import CliRunner

import instruments
from labpipe.errors import InputError, SourceError, UsageError
from labpipe.workflow.session import load
from pipelines.cli import cli
from pipelines.experiments.harmonic import measured
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.laser_readings import read_laser
from pipelines.experiments.shared.settings import Keyence
from pipelines.session import SETTINGS

TIME = np.arange(24) * 5e-4
FALL = 0.031 - 4.905 * TIME**2


def rows(*columns, sep=",", form="{:.7f}"):
    return "".join(sep.join(form.format(v) for v in row) + "\n" for row in zip(*columns, strict=True))


LVM = (
    "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
    "Channels\t1\t\nSamples\t24\t\nY_Unit_Label\tMeters\t\nX_Dimension\tTime\t\nX0\t0.0E+0\t\nDelta_X\t5.0E-4\t\n"
    "***End_of_Header***\t\t\nX_Value\tLaser\tComment\n"
)
"""The headings of recorders, each with the columns that it takes to read them."""
RECORDERS = {
    "PASCO": ("Time (s) Run #1,Position (m) Run #1\n" + rows(TIME, FALL), 'time = "Time (s) Run #1", displacement = "Position (m) Run #1"'),
    "PicoScope": ("Time,Channel A\n(ms),(mm)\n\n" + rows(TIME * 1e3, FALL * 1e3), '{ time = "Time", displacement = "Channel A" }'),
    "Tektronix": (
        "Model,MSO24\nHorizontal Units,s\nVertical Units,m\nRecord Length,24\n\nTIME,CH1\n" + rows(TIME, FALL, form="{:.9E}"),
        'time = "TIME", displacement = "CH1"',
    ),
    "Tracker": ("#multi:\nt\ty\n" + rows(TIME, FALL, sep="\t", form="{:.8E}"), 'time = { column = "t", unit = "s" }, displacement = { column = "y", unit = "m" }'),
    "phyphox": ('"Time (s)";"Distance (mm)"\n' + rows(TIME, FALL * 1e3, sep=";", form="{:.9E}").replace(".", ","), 'time = "Time (s)", displacement = "Distance (mm)"'),
    "LabVIEW": (LVM + rows(TIME, FALL, sep="\t"), 'time = { column = "X_Value", unit = "s" }, displacement = "Laser"'),
    "blanks": ("time[s]   z[cm]   F[N]\n" + rows(TIME, FALL * 100, TIME, sep="   "), 'time = "time", displacement = "z"'),
    "numbers": (rows(TIME, TIME, FALL), 'time = { column = 1, unit = "s" }, displacement = { column = 3, unit = "m" }'),
    "two runs": (
        "Time (s) A,Position (m) A,Time (s) B,Position (m) B\n" + rows(TIME, FALL, TIME, FALL + 1) + ",,0.02,1.0\n,,0.03,1.0\n",
        'time = "Time (s) A", displacement = "Position (m) A"',
    ),
}  # fmt: skip


def write(folder, text, name="run.csv"):
    path = folder / name
    path.write_text(text, "utf-8")
    return path


@pytest.mark.parametrize("name", RECORDERS)
def test_the_table_of_a_recorder_is_read_by_its_columns(tmp_path, name):
    text, columns = RECORDERS[name]
    path = write(tmp_path, text)
    found = instruments.read(path, columns=columns)
    np.testing.assert_allclose(found.out1, FALL, atol=1e-6)
    np.testing.assert_allclose(found.time, TIME, atol=1e-9)
    assert found.attrs["sampling_interval"] == pytest.approx(5e-4)
    assert found.out1.attrs["units"] == "m"
    told = CliRunner().invoke(cli, ["inspect", str(path), "--columns", columns, "--json"])
    described = json.loads(told.stdout)
    assert next(row for row in described["variables"] if row["name"] == "out1")["max"] == pytest.approx(0.031, abs=1e-6)
    assert read_laser(path, Keyence(columns=columns)).out1.values == pytest.approx(FALL, abs=1e-6)


@pytest.mark.parametrize("name", ["PASCO", "PicoScope", "LabVIEW", "Tektronix"])
def test_the_refusal_prints_the_line_to_copy(tmp_path, name):
    path = write(tmp_path, RECORDERS[name][0])
    with pytest.raises(SourceError, match="no instrument recognises") as caught:
        instruments.read(path)
    copied = caught.value.hint.partition("columns = ")[2]
    np.testing.assert_allclose(instruments.read(path, columns=copied).out1, FALL, atol=1e-6)
    path = write(tmp_path, LVM + rows(FALL, form="\t{:.7f}"))
    with pytest.raises(SourceError, match="no instrument recognises") as caught:
        instruments.read(path)
    assert caught.value.hint.endswith('columns = { displacement = "Laser" }')  # the column of times is empty
    path = write(tmp_path, RECORDERS["blanks"][0].replace("z[cm]", "Weg[cm]"))
    with pytest.raises(SourceError, match="no instrument recognises") as caught:
        instruments.read(path)
    assert 'columns = { time = "time[s]", position = "Weg[cm]", force = "F[N]" }' in caught.value.hint


def test_a_table_without_times_needs_the_time_between_rows(tmp_path):
    text = LVM.replace("X_Columns\tOne", "X_Columns\tNo") + rows(FALL, form="\t{:.7f}")
    stated = instruments.read(write(tmp_path, text), columns={"displacement": "Laser"})
    np.testing.assert_allclose(stated.time, TIME, atol=1e-12)  # by Delta_X
    with pytest.raises(SourceError, match=r"the header states a step of 0\.0005 s, and the cycle is stated as 0\.001"):
        instruments.read(tmp_path / "run.csv", columns={"displacement": "Laser"}, cycle="1 ms")
    path = write(tmp_path, text.replace("Delta_X\t5.0E-4\t\n", ""))
    with pytest.raises(SourceError, match="no column of times is named"):
        instruments.read(path, columns={"displacement": "Laser"})
    found = instruments.read(path, columns={"displacement": "Laser"}, cycle="500 us")
    np.testing.assert_allclose(found.time, TIME, atol=1e-12)
    np.testing.assert_allclose(found.out1, FALL, atol=1e-7)
    with pytest.raises(SourceError, match=r"apart by 0\.0005 s, and the cycle is stated as 0\.001 s"):
        instruments.read(write(tmp_path, RECORDERS["PASCO"][0]), columns=RECORDERS["PASCO"][1], cycle="1 ms")
    with pytest.raises(UsageError, match='plain_table has no option "units"'):
        read_laser(path, Keyence(columns={"displacement": "Laser"}, units=["mm"]))


@pytest.mark.parametrize("form", ["{:.7f}", "{:.6E}"])
@pytest.mark.parametrize(
    ("steps", "message"),
    [(np.repeat([5e-4, 1e-3], 12), "a step of 0.001 s, 0.0005 s elsewhere|a step of 0.0005 s, 0.001 s"),
     (np.where(np.arange(24) == 9, 1e-3, 5e-4), "a step of 0.001 s, 0.0005 s elsewhere")],
)  # fmt: skip
def test_times_that_lie_unevenly_are_refused_in_every_notation(tmp_path, form, steps, message):
    path = write(tmp_path, "t (s),z (m)\n" + rows(np.cumsum(steps), FALL, form=form))
    with pytest.raises(SourceError, match=f"the times are uneven: ({message})") as caught:
        instruments.read(path, columns={"time": "t (s)", "displacement": "z (m)"})
    assert caught.value.line is not None


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"time": "Time", "displacement": {"column": "Channel A", "unit": "um"}}, r"'Channel A' is in '\(mm\)', and col"),
        ({"displacement": "Time"}, "'Time' is a time, no displacement"),
        ({"displacement": 1}, "'Time' is a time, no displacement"),
        ({"time": 1, "displacement": {"column": 2, "unit": "um"}}, r"'Channel A' is in '\(mm\)', and columns say 'um'"),
        ({"time": "Time", "displacement": "Channel B"}, "no column, or more than one, is called 'Channel B'; the headings are 'Time', 'Ch"),
        ({"time": "Time", "force": "Channel A"}, "columns name time, force; expected displacement and time, or"),
        ({"time": "Time", "displacement": {"column": "Channel A", "units": "mm"}}, "expected the heading of a column"),
        ({"time": "Time", "gravity": "Channel A"}, '"gravity" is no quantity; known are displacement, position, force'),
        ("time = Time", "columns cannot be read"),
    ],
)  # fmt: skip
def test_columns_that_contradict_the_file_or_mean_nothing_are_refused(tmp_path, columns, message):
    path = write(tmp_path, RECORDERS["PicoScope"][0])
    with pytest.raises((SourceError, InputError), match=message):
        instruments.read(path, columns=columns)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.0010000,", "0.001x000,", "run.csv:4:1: found '0.001x000', expected a number"),
        ("0.0010000,0.0309951\n", "0.0010000\n", "run.csv:4: found 1 cells, expected 2"),
        ("0.0010000,0.0309951\n", "", "the times are uneven"),
        ("Position (m)", "Position (furlong)", "the unit of .* is not stated"),
    ],
)
def test_a_fault_of_a_row_is_named_with_its_place(tmp_path, old, new, message):
    text, columns = RECORDERS["PASCO"]
    assert old in text
    with pytest.raises(SourceError, match=message):
        instruments.read(
            write(tmp_path, text.replace(old, new)), columns=columns.replace("(m)", new[-9:] if "f" in new else "(m)")
        )


def test_sweeps_of_strange_headings_are_read_by_their_columns(tmp_path):
    path = write(tmp_path, "drive;one;two;chamber\n" + rows([1, 2], [9, 8], [3, 2], [20, 20], sep=";", form="{:.1f}"))
    in_order = instruments.read(path, columns="f (Hz), E' (MPa), E'' (MPa), T (degC)")
    named = instruments.read(
        path,
        columns={
            "frequency": {"column": "drive", "unit": "Hz"}, "E'": {"column": "one", "unit": "MPa"},
            "loss_modulus": {"column": 3, "unit": "MPa"}, "temperature": {"column": "chamber", "unit": "degC"},
        },
    )  # fmt: skip
    for found in (in_order, named):
        assert found.storage_modulus.values.tolist() == [9e6, 8e6]
        assert found.loss_modulus.values.tolist() == [3e6, 2e6]
        assert found.temperature.values.tolist() == [20.0, 20.0]


def session(folder, text):
    return write(folder, f'labpipe = 1\n[session]\ntitle = "x"\n{text}', "session.toml")


def test_columns_stand_in_the_session(tmp_path):
    time = np.arange(1200) * 0.01
    position, force = 0.5 * np.cos(2 * np.pi * 0.5 * time), 3 + np.cos(2 * np.pi * 0.5 * time + 0.1)
    write(tmp_path, "t;travel;load\n[s];[mm];[N]\n" + rows(time, position, force, sep=";"), "wave.txt")
    path = session(
        tmp_path,
        """[experiments.wave]
kind = "harmonic"
mach1 = "wave.txt"
columns = { time = "t", position = "travel", force = { column = 3, unit = "N" } }
cycles = { skip = 1 }
[experiments.drop]
kind = "ball_drop"
laser = ["run.csv"]
calibration = "calibration/laser.toml"
height = "30 mm"
sphere = { radius = "9 mm", mass = "28 g", material = "nbr" }
keyence = { columns = { time = "Time", displacement = { column = "Channel A", unit = "mm" } } }
[experiments.sweep]
kind = "dma"
rheometer = ["a.csv"]
mode = "tension"
nu = "0.35"
export = { columns = "f (Hz), E' (MPa), E'' (MPa)" }
""",
    )
    loaded = load(path, SETTINGS, may_wait=True)
    assert set(loaded.experiments) == {"wave", "drop", "sweep"}
    settings = loaded.experiments["wave"].settings
    readings = mach1_readings.readings(tmp_path / "wave.txt", settings=settings)
    untared = pytest.warns(UserWarning, match="the file begins in contact")
    with untared, pytest.warns(UserWarning, match="holds no Find Contact block"):  # forces need no depth
        found = measured.oscillations(mach1_readings.loads(readings, None, settings=settings), settings=settings)
    assert float(found.frequency[0]) == pytest.approx(0.5, rel=1e-4)
    assert float(found.force_amplitude[0]) == pytest.approx(1.0, rel=1e-3)

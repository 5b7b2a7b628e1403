"""Wrong inputs, one per function; each raises when it is called with an empty folder.

The exact messages stand in ``messages.toml``; ``python -m tests.errors.wrong_inputs`` prints the
present ones in that form, to be read before they are kept.
"""

import json
import shutil
import struct
import tempfile
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np

from labpipe.errors import LabpipeError

CASES: dict[str, Callable[[Path], object]] = {}


def case(function: Callable[[Path], object]) -> Callable[[Path], object]:
    CASES[function.__name__] = function
    return function


def named(name: str, call: Callable[[Path], object]) -> None:
    CASES[name] = call


# --- session.toml ---------------------------------------------------------------------------------

DROP = """labpipe = 1
[session]
title = "t"
[experiments.drop]
kind = "ball_drop"
laser = ["a.csv"]
calibration = "laser.toml"
height = "7 ± 0.01 mm"
[experiments.drop.sphere]
radius = "9.525 mm"
mass = "505 g"
material = "acrylic"
"""


def session(folder: Path, old: str = "", new: str = "", text: str = DROP) -> object:
    from pipelines.process import open_session

    (folder / "a.csv").write_text("x")
    (folder / "laser.toml").write_text("x")
    assert old in text
    (folder / "session.toml").write_text(text.replace(old, new, 1), "utf-8")
    return open_session(folder)


SESSION = {
    "session_syntax": ('title = "t"', 'title = "t'),
    "session_version_missing": ("labpipe = 1\n", ""),
    "session_version_newer": ("labpipe = 1", "labpipe = 9"),
    "session_version_text": ("labpipe = 1", 'labpipe = "one"'),
    "session_top_key": ("labpipe = 1\n", "labpipe = 1\nexperiment = 2\n"),
    "session_key_twice": ('title = "t"', 'title = "t"\ntitle = "u"'),
    "session_title_number": ('title = "t"', "title = 3"),
    "kind_missing": ('kind = "ball_drop"\n', ""),
    "kind_misspelt": ('"ball_drop"', '"ball_dorp"'),
    "field_missing": ('height = "7 ± 0.01 mm"\n', ""),
    "field_misspelt": ("height =", "hieght ="),
    "length_without_unit": ('"7 ± 0.01 mm"', '"7"'),
    "length_as_number": ('"7 ± 0.01 mm"', "7"),
    "length_in_grams": ('"7 ± 0.01 mm"', '"7 g"'),
    "length_unknown_unit": ('"7 ± 0.01 mm"', '"7 cubits"'),
    "length_negative": ('"7 ± 0.01 mm"', '"-7 mm"'),
    "length_zero": ('radius = "9.525 mm"', 'radius = "0 mm"'),
    "length_gap": ('radius = "9.525 mm"', 'radius = "FILL mm"'),
    "length_infinite": ('radius = "9.525 mm"', 'radius = "inf mm"'),
    "file_absent": ('["a.csv"]', '["b.csv"]'),
    "file_outside": ('["a.csv"]', '["../a.csv"]'),
    "file_absolute": ('["a.csv"]', '["/a.csv"]'),
    "file_as_number": ('["a.csv"]', "[3]"),
    "files_not_a_list": ('["a.csv"]', '"a.csv"'),
    "files_empty": ('["a.csv"]', "[]"),
    "file_twice": ('["a.csv"]', '["a.csv", "a.csv"]'),
    "material_none": ('material = "acrylic"\n', ""),
    "material_two": ('material = "acrylic"', 'material = "acrylic"\nmaterial_file = "laser.toml"'),
    "material_from_nobody": ('material = "acrylic"', 'material_from = "dma"'),
    "table_as_text": ("[experiments.drop.sphere]\n", 'sphere = "round"\n[x]\n'),
    "date_as_text": ("height =", 'measured_on = "14.05.2024"\nheight ='),
    "choice_unknown": ("height =", 'analysis = { velocity = "splin" }\nheight ='),
    "storage_factor_zero": ("height =", "keyence = { storage_factor = 0 }\nheight ="),
    "name_reserved": ("experiments.drop", "experiments.nul"),
    "name_hidden": ("experiments.drop]", 'experiments.".drop"]'),
}
for _name, (_old, _new) in SESSION.items():
    named(_name, lambda folder, old=_old, new=_new: session(folder, old, new))


@case
def session_absent(folder: Path) -> object:
    from pipelines.process import open_session

    return open_session(folder)


@case
def session_not_utf8(folder: Path) -> object:
    from pipelines.process import open_session

    (folder / "session.toml").write_bytes(b'labpipe = 1\n[session]\ntitle = "\xe9"\n')
    return open_session(folder)


@case
def session_empty(folder: Path) -> object:
    return session(folder, text="labpipe = 1\n")


@case
def names_differ_in_case(folder: Path) -> object:
    twin = DROP[DROP.index("[experiments.drop]") :].replace("experiments.drop", "experiments.Drop")
    return session(folder, text=DROP + twin)


# --- calibration records --------------------------------------------------------------------------

RECORD = """version = 1
kind = "laser"
id = "laser-1"
instrument = "LK-G5001"
valid_from = 2024-05-01
valid_until = 2025-05-01
who = "A. Person"
when = 2024-05-01
how = "steps"
[values]
inclination = "12.0 ± 0.1 deg"
"""

RECORDS = {
    "record_date_german": ("valid_from = 2024-05-01", 'valid_from = "01.05.2024"'),
    "record_date_number": ("valid_from = 2024-05-01", "valid_from = 20240501"),
    "record_date_impossible": ("valid_from = 2024-05-01", "valid_from = 2024-13-01"),
    "record_ends_before_it_begins": ("valid_until = 2025", "valid_until = 2023"),
    "record_kind": ('kind = "laser"', 'kind = "lazer"'),
    "record_kind_missing": ('kind = "laser"\n', ""),
    "record_newer": ("version = 1", "version = 7"),
    "record_without_uncertainty": ("12.0 ± 0.1 deg", "12.0 deg"),
    "record_inclination_too_steep": ("12.0 ± 0.1 deg", "85 ± 0.1 deg"),
    "record_value_missing": ('inclination = "12.0 ± 0.1 deg"\n', ""),
    "record_empty_name": ('who = "A. Person"', 'who = ""'),
    "record_key": ("[values]", "[value]"),
}


def record(folder: Path, old: str, new: str) -> object:
    import calibration

    assert old in RECORD
    (folder / "laser.toml").write_text(RECORD.replace(old, new, 1), "utf-8")
    return calibration.load_record(folder / "laser.toml")


for _name, (_old, _new) in RECORDS.items():
    named(_name, lambda folder, old=_old, new=_new: record(folder, old, new))


def required(folder: Path, attrs: dict[str, str], kind: str = "laser", **options: object) -> object:
    import calibration

    (folder / "laser.toml").write_text(RECORD, "utf-8")
    found = calibration.load_record(folder / "laser.toml")
    return calibration.require(found, kind, attrs, **options)  # type: ignore[arg-type]


named("record_expired", lambda f: required(f, {"start": "2026-01-01"}))
named("record_not_yet_valid", lambda f: required(f, {"start": "2024-04-01"}))
named("record_of_another_kind", lambda f: required(f, {}, "camera"))
named("record_of_another_sensor", lambda f: required(f, {"model": "IL-100"}))
named("record_of_another_view", lambda f: required(f, {"start": "2024-06-01"}, view="front"))

# --- Keyence --------------------------------------------------------------------------------------


def keyence_text() -> str:
    from instruments import keyence

    made = keyence.make_recording({1: np.linspace(0, 1e-3, 6)}, cycle="50 us", start=datetime(2024, 5, 14))
    return keyence.encode(made).decode("utf-8-sig")


KEYENCE = {
    "keyence_letter_in_number": ("+00.2000", "+0x.2000"),
    "keyence_cut_row": ("+00.4000", "+00.4"),
    "keyence_row_missing": ("2,+00.2000\r\n", ""),
    "keyence_column_too_many": ("+00.2000", "+00.2000,1"),
    "keyence_no_cycle": ("Sampling cycle,50us\r\n", ""),
    "keyence_cycle_without_unit": ("50us", "50"),
    "keyence_no_unit": ("Unit,mm\r\n", ""),
    "keyence_unit_of_force": ("Unit,mm", "Unit,N"),
    "keyence_storage": ("Storage cycle,x1", "Storage cycle,x1.5"),
    "keyence_no_storage": ("Storage cycle,x1\r\n", ""),
    "keyence_count": ("Data count,6", "Data count,7"),
    "keyence_counter_repeats": ("\r\n3,", "\r\n2,"),
    "keyence_decimal_comma": ("+00.4000", "+00,4000"),
}


def keyence(folder: Path, old: str = "", new: str = "", **options: object) -> object:
    import instruments

    text = keyence_text()
    assert old in text, text
    (folder / "a.csv").write_bytes(text.replace(old, new, 1).encode())
    return instruments.read(folder / "a.csv", instrument="keyence", **options)


for _name, (_old, _new) in KEYENCE.items():
    named(_name, lambda folder, old=_old, new=_new: keyence(folder, old, new))


@case
def keyence_no_cycle_in_a_session(folder: Path) -> object:
    from pipelines.experiments.shared.laser_readings import read_laser
    from pipelines.experiments.shared.settings import Keyence

    text = keyence_text().replace("Sampling cycle,50us\r\n", "")
    (folder / "a.csv").write_bytes(text.encode())
    return read_laser(folder / "a.csv", Keyence())


named("keyence_cycle_contradicts", lambda f: keyence(f, cycle="100 us"))
named("keyence_option_cycle", lambda f: keyence(f, cycle="fast"))


@case
def keyence_last_line_cut(folder: Path) -> object:
    import instruments

    (folder / "a.csv").write_bytes(keyence_text().replace("Data count,6\r\n", "").encode()[:-5])
    return instruments.read(folder / "a.csv")


# --- Mach-1, rheometer, films ---------------------------------------------------------------------


def mach1_text() -> str:
    rows = "".join(f"{i * 0.01:.6f}\t0.1{i}0000\t-0.25{i}000\r\n" for i in range(10))
    return (
        "<Mach-1 File>\r\n<INFO>\r\nDate:\tWed, Jul 19, 2023\r\nTime:\t12:14:21.065\r\n"
        "Mach-1 Motion Software Version:\t4.4.0.19\r\nLoad Cell Type:\tMultiple-axis\r\n"
        "<END INFO>\r\n<Sinusoid>\r\nStage Axis:\tPosition (z)\r\nAmplitude, mm:\t0.1\r\n"
        "Frequency, Hz:\t1.00000\r\nNumber of Cycles:\t20\r\n<DATA>\r\n"
        f"Time, s\tPosition (z), mm\tFz, N\r\n{rows}<END DATA>\r\n"
    )


MACH1 = {
    "mach1_letter_in_number": ("0.150000", "0.15x000"),
    "mach1_cell_missing": ("0.150000\t", ""),
    "mach1_no_end": ("<END DATA>\r\n", ""),
    "mach1_unit": ("Fz, N", "Fz, lbf"),
    "mach1_row_missing": ("0.040000\t0.140000\t-0.254000\r\n", ""),
    "mach1_decimal_comma": ("0.150000", "0,150000"),
}


def mach1(folder: Path, old: str, new: str) -> object:
    import instruments

    text = mach1_text()
    assert old in text
    (folder / "m.txt").write_bytes(text.replace(old, new, 1).encode())
    return instruments.read(folder / "m.txt")


for _name, (_old, _new) in MACH1.items():
    named(_name, lambda folder, old=_old, new=_new: mach1(folder, old, new))

RHEOMETER = (
    "Project:\tP\r\n\r\nTest:\tT\r\n\r\nResult:\tFrequency sweep 1\r\n\r\n"
    "Interval and data points:\t1\t2\r\n"
    "Interval data:\tPoint No.\tAngular Frequency\tStorage Modulus\tLoss Modulus\r\n"
    "\t\t\t\t\r\n\t\t[rad/s]\t[Pa]\t[Pa]\r\n\t1\t50\t62589\t1.25E+05\r\n\t2\t31.5\t50000\t9.9E+04\r\n"
)
SWEEPS = {
    "rheometer_letter_in_number": ("62589", "62x89"),
    "rheometer_unit": ("[rad/s]", "[turns]"),
    "rheometer_no_units": ("\t\t[rad/s]\t[Pa]\t[Pa]\r\n", ""),
}


def rheometer(folder: Path, old: str, new: str) -> object:
    import instruments

    assert old in RHEOMETER
    (folder / "r.csv").write_bytes(RHEOMETER.replace(old, new, 1).encode("utf-16"))
    return instruments.read(folder / "r.csv")


for _name, (_old, _new) in SWEEPS.items():
    named(_name, lambda folder, old=_old, new=_new: rheometer(folder, old, new))


def cine(folder: Path, change: Callable[[bytearray], object], cut: int | None = None) -> object:
    import instruments

    source = Path(__file__).parents[2] / "sample_data/films/film/ptfe_front.cine"
    data = bytearray(source.read_bytes()[:200_000])
    change(data)
    (folder / "f.cine").write_bytes(bytes(data[:cut]))
    return instruments.read(folder / "f.cine")


def put(offset: int, code: str, value: int) -> Callable[[bytearray], object]:
    return lambda data: struct.pack_into(code, data, offset, value)


named("film_header_cut", lambda f: cine(f, lambda d: None, 60))
named("film_offsets_beyond_the_end", lambda f: cine(f, put(32, "<I", 4_000_000_000)))
named("film_colour", lambda f: cine(f, put(44 + 14, "<H", 24)))
named("film_count_impossible", lambda f: cine(f, put(20, "<I", 2**31)))


@case
def file_of_nobody(folder: Path) -> object:
    import instruments

    (folder / "a.bin").write_bytes(bytes(range(256)))
    return instruments.read(folder / "a.bin")


@case
def file_not_there(folder: Path) -> object:
    import instruments

    return instruments.read(folder / "a.csv")


@case
def file_empty(folder: Path) -> object:
    import instruments

    (folder / "a.csv").write_bytes(b"")
    return instruments.read(folder / "a.csv", instrument="keyence")


@case
def instrument_of_no_name(folder: Path) -> object:
    import instruments

    (folder / "a.csv").write_bytes(b"x")
    return instruments.read(folder / "a.csv", instrument="keyance")


@case
def dice_without_images(folder: Path) -> object:
    import instruments

    (folder / "DICe_solution_00.txt").write_text(
        "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA\n0,1,2,x,0,0\n"
    )
    return instruments.read(folder)


# --- values handed to functions -------------------------------------------------------------------


@case
def material_of_no_name(folder: Path) -> object:
    from labpipe import materials

    return materials.load("acryl")


def prony(**changes: object) -> object:
    from labpipe.materials import Prony

    given: dict[str, object] = {"E_relaxed": 1e6, "E": [1e6], "rho": [1.0], "nu": 0.4}
    return Prony(**(given | changes))  # type: ignore[arg-type]


named("prony_lengths", lambda f: prony(rho=[1.0, 2.0]))
named("prony_negative", lambda f: prony(E=[-1e6]))
named("prony_nu", lambda f: prony(nu=0.7))
named("prony_time_zero", lambda f: prony(rho=[0.0]))


def drop(**changes: object) -> object:
    from labpipe import contact, materials

    given: dict[str, object] = {"radius": 9.5e-3, "mass": 0.5, "height": 1e-3, "duration": 0.01}
    return contact.drop(materials.load("acrylic"), **(given | changes))  # type: ignore[arg-type]


named("drop_height", lambda f: drop(height=-1e-3))
named("drop_solver", lambda f: drop(solver="fem"))
named("drop_profile", lambda f: drop(profile="cone"))
named("drop_rtol", lambda f: drop(rtol=0.5))
named("drop_mass_nan", lambda f: drop(mass=float("nan")))


@case
def unit_of_no_name(folder: Path) -> object:
    from labpipe.units import unit

    return unit("furlong")


@case
def quantity_without_number(folder: Path) -> object:
    from labpipe.units import quantity

    return quantity("mm 3")


@case
def track_points_of_wrong_shape(folder: Path) -> object:
    from labpipe.imaging import track

    return track(np.zeros((2, 40, 40)), np.zeros((3, 3)))


@case
def track_subset_even(folder: Path) -> object:
    from labpipe.imaging import track

    return track(np.zeros((2, 40, 40)), np.array([[20.0, 20.0]]), subset=30)


@case
def velocity_of_one_point(folder: Path) -> object:
    import xarray as xr

    from labpipe.signals import velocity

    attrs = {"units": "m", "long_name": "displacement"}
    made = xr.DataArray([1.0], dims="time", coords={"time": [0.0]}, attrs=attrs)
    return velocity(made)


# --- the session as a whole, and the command line -------------------------------------------------


def planned(folder: Path, **options: object) -> object:
    from pipelines.process import plan

    session(folder)
    return plan(folder, **options)  # type: ignore[arg-type]


named("target_of_no_name", lambda f: planned(f, targets=["velocty"]))
named("experiment_of_no_name", lambda f: planned(f, only=["dorp"]))


@case
def result_of_no_run(folder: Path) -> object:
    from pipelines.process import result

    session(folder)
    return result(folder, "drop", "repeats")


@case
def export_before_processing(folder: Path) -> object:
    from pipelines.process import export

    session(folder)
    return export(folder)


@case
def report_before_processing(folder: Path) -> object:
    from pipelines.process import report

    session(folder)
    return report(folder, "drop")


@case
def scan_of_nothing(folder: Path) -> object:
    from pipelines.session import init

    return init(folder)


@case
def store_record_damaged(folder: Path) -> object:
    from labpipe import files

    (folder / "a.nc").write_bytes(b"not netCDF")
    return files.read_dataset(folder / "a.nc")


@case
def folder_cannot_be_made(folder: Path) -> object:
    from labpipe import files

    (folder / "a").write_text("a file")
    return files.write_text(folder / "a/b.txt", "x")


def present() -> dict[str, tuple[str, str]]:
    """Return class and text of every error; the folder stands as ``FOLDER``."""
    found = {}
    for name, call in CASES.items():
        folder = Path(tempfile.mkdtemp())
        try:
            call(folder)
        except LabpipeError as error:
            found[name] = (type(error).__name__, str(error).replace(str(folder), "FOLDER"))
        except Exception as error:
            found[name] = ("NOT OURS", f"{type(error).__name__}: {error}")
        else:
            found[name] = ("NO ERROR", "")
        shutil.rmtree(folder)
    return found


if __name__ == "__main__":
    import sys

    for _name, (_kind, _text) in present().items():
        sys.stdout.write(f"[{_name}]\nerror = {json.dumps(_kind)}\n")
        sys.stdout.write(f"message = {json.dumps(_text, ensure_ascii=False)}\n\n")

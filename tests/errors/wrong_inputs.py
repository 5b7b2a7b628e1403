"""Wrong inputs by name; each raises when it is called with an empty folder.

The exact messages are in ``messages.toml``; ``python -m tests.errors.wrong_inputs`` prints the
present ones in that form, to be read before they are kept.
"""

import json
import shutil
import struct
import sys
import tempfile
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import calibration
import instruments
from instruments import keyence
from labpipe import contact, files, imaging, materials, signals, units
from labpipe.errors import LabpipeError
from pipelines import session as verbs
from pipelines.session import init

Edits = Mapping[str, tuple[str, str]]
CASES: dict[str, Callable[[Path], object]] = {}


def edited(text: str, edits: Edits, call: Callable[[Path, str], object]) -> None:
    """Add cases in which a text of a correct file is replaced by another one."""
    for name, (old, new) in edits.items():
        assert old in text, name
        wrong = text.replace(old, new, 1)
        CASES[name] = lambda folder, wrong=wrong: call(folder, wrong)  # type: ignore[misc]


def read(name: str, data: bytes, **options: Any) -> Callable[[Path], object]:
    """Return a case in which a file of some bytes is read as that of an instrument."""

    def call(folder: Path) -> object:
        (folder / name).write_bytes(data)
        return instruments.read(folder / name, **options)

    return call


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


def session(folder: Path, text: str = DROP) -> object:
    (folder / "a.csv").write_text("x")
    (folder / "laser.toml").write_text("x")
    (folder / "session.toml").write_text(text, "utf-8")
    return verbs.open_session(folder)


SESSION = {
    "session_syntax": ('title = "t"', 'title = "t'),
    "session_version_newer": ("labpipe = 1", "labpipe = 9"),
    "session_top_key": ("labpipe = 1\n", "labpipe = 1\nexperiment = 2\n"),
    "session_key_twice": ('title = "t"', 'title = "t"\ntitle = "u"'),
    "session_title_number": ('title = "t"', "title = 3"),
    "kind_misspelt": ('"ball_drop"', '"ball_dorp"'),
    "field_missing": ('height = "7 ± 0.01 mm"\n', ""),
    "length_without_unit": ('"7 ± 0.01 mm"', '"7"'),
    "length_in_grams": ('"7 ± 0.01 mm"', '"7 g"'),
    "length_gap": ('radius = "9.525 mm"', 'radius = "FILL mm"'),
    "file_absent": ('["a.csv"]', '["b.csv"]'),
    "material_two": ('material = "acrylic"', 'material = "acrylic"\nmaterial_file = "laser.toml"'),
    "material_from_nobody": ('material = "acrylic"', 'material_from = "dma"'),
    "table_as_text": ("[experiments.drop.sphere]\n", 'sphere = "round"\n[x]\n'),
    "date_as_text": ("height =", 'measured_on = "14.05.2024"\nheight ='),
    "storage_factor_zero": ("height =", "keyence = { storage_factor = 0 }\nheight ="),
    "name_reserved": ("experiments.drop", "experiments.nul"),
}
edited(DROP, SESSION, session)


def session_not_utf8(folder: Path) -> object:
    (folder / "session.toml").write_bytes(b'labpipe = 1\n[session]\ntitle = "\xe9"\n')
    return verbs.open_session(folder)


_TWIN = DROP[DROP.index("[experiments.drop]") :].replace("experiments.drop", "experiments.Drop")
CASES |= {
    "session_absent": verbs.open_session,
    "session_not_utf8": session_not_utf8,
    "names_differ_in_case": lambda f: session(f, DROP + _TWIN),
}

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
    "record_date_number": ("valid_from = 2024-05-01", "valid_from = 20240501"),
    "record_date_impossible": ("valid_from = 2024-05-01", "valid_from = 2024-13-01"),
    "record_ends_before_it_begins": ("valid_until = 2025", "valid_until = 2023"),
    "record_kind": ('kind = "laser"', 'kind = "lazer"'),
    "record_kind_missing": ('kind = "laser"\n', ""),
    "record_newer": ("version = 1", "version = 7"),
    "record_without_uncertainty": ("12.0 ± 0.1 deg", "12.0 deg"),
    "record_inclination_too_steep": ("12.0 ± 0.1 deg", "85 ± 0.1 deg"),
    "record_value_missing": ('inclination = "12.0 ± 0.1 deg"\n', ""),
    "record_key": ("[values]", "[value]"),
}


def record(folder: Path, text: str = RECORD) -> Any:
    (folder / "laser.toml").write_text(text, "utf-8")
    return calibration.load_record(folder / "laser.toml")


edited(RECORD, RECORDS, record)


def required(folder: Path, attrs: dict[str, str], kind: str = "laser", **options: Any) -> object:
    return calibration.require(record(folder), kind, attrs, **options)


CASES |= {
    "record_expired": lambda f: required(f, {"start": "2026-01-01"}),
    "record_of_another_kind": lambda f: required(f, {}, "camera"),
    "record_of_another_sensor": lambda f: required(f, {"model": "IL-100"}),
    "record_of_another_view": lambda f: required(f, {"start": "2024-06-01"}, view="front"),
}

# --- Keyence --------------------------------------------------------------------------------------

LASER = keyence.encode({1: np.linspace(0, 1e-3, 6)}, cycle="50 us", start=datetime(2024, 5, 14)).decode("utf-8-sig")
KEYENCE = {
    "keyence_letter_in_number": ("+00.2000", "+0x.2000"),
    "keyence_cut_row": ("+00.4000", "+00.4"),
    "keyence_column_too_many": ("+00.2000", "+00.2000,1"),
    "keyence_no_cycle": ("Sampling cycle,50us\r\n", ""),
    "keyence_no_unit": ("Unit,mm\r\n", ""),
    "keyence_unit_of_force": ("Unit,mm", "Unit,N"),
    "keyence_storage": ("Storage cycle,x1", "Storage cycle,x1.5"),
    "keyence_count": ("Data count,6", "Data count,7"),
    "keyence_decimal_comma": ("+00.4000", "+00,4000"),
}

edited(LASER, KEYENCE, lambda f, text: read("a.csv", text.encode(), instrument="keyence")(f))


def keyence_no_cycle_in_a_session(folder: Path) -> object:
    from pipelines.experiments.shared.laser_readings import read_laser
    from pipelines.experiments.shared.settings import Keyence

    (folder / "a.csv").write_bytes(LASER.replace("Sampling cycle,50us\r\n", "").encode())
    return read_laser(folder / "a.csv", Keyence())


CASES |= {
    "keyence_no_cycle_in_a_session": keyence_no_cycle_in_a_session,
    "keyence_cycle_contradicts": read("a.csv", LASER.encode(), instrument="keyence", cycle="100 us"),
    "keyence_option_cycle": read("a.csv", LASER.encode(), instrument="keyence", cycle="fast"),
    "keyence_last_line_cut": read("a.csv", LASER.replace("Data count,6\r\n", "").encode()[:-5]),
}

# --- Mach-1, rheometer, films ---------------------------------------------------------------------

ROWS = "".join(f"{i * 0.01:.6f}\t0.1{i}0000\t-0.25{i}000\r\n" for i in range(10))
SINUSOID = (
    "<Mach-1 File>\r\n<INFO>\r\nDate:\tWed, Jul 19, 2023\r\nTime:\t12:14:21.065\r\n"
    "Mach-1 Motion Software Version:\t4.4.0.19\r\nLoad Cell Type:\tMultiple-axis\r\n"
    "<END INFO>\r\n<Sinusoid>\r\nStage Axis:\tPosition (z)\r\nAmplitude, mm:\t0.1\r\n"
    "Frequency, Hz:\t1.00000\r\nNumber of Cycles:\t20\r\n<DATA>\r\n"
    f"Time, s\tPosition (z), mm\tFz, N\r\n{ROWS}<END DATA>\r\n"
)
MACH1 = {
    "mach1_letter_in_number": ("0.150000", "0.15x000"),
    "mach1_no_end": ("<END DATA>\r\n", ""),
    "mach1_unit": ("Fz, N", "Fz, lbf"),
    "mach1_row_missing": ("0.040000\t0.140000\t-0.254000\r\n", ""),
}

edited(SINUSOID, MACH1, lambda f, text: read("m.txt", text.encode())(f))

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

edited(RHEOMETER, SWEEPS, lambda f, text: read("r.csv", text.encode("utf-16"))(f))


def cine(*changes: tuple[int, str, int], cut: int | None = None) -> Callable[[Path], object]:
    def call(folder: Path) -> object:
        source = Path(__file__).parents[2] / "sample_data/films/film/ptfe_front.cine"
        data = bytearray(source.read_bytes()[:200_000])
        for offset, code, value in changes:
            struct.pack_into(code, data, offset, value)
        return read("f.cine", bytes(data[:cut]))(folder)

    return call


def dice_without_images(folder: Path) -> object:
    head = "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA\n"
    (folder / "DICe_solution_00.txt").write_text(f"{head}0,1,2,x,0,0\n")
    return instruments.read(folder)


CASES |= {
    "film_header_cut": cine(cut=60),
    "film_offsets_beyond_the_end": cine((32, "<I", 4_000_000_000)),
    "film_colour": cine((44 + 14, "<H", 24)),
    "film_count_impossible": cine((20, "<I", 2**31)),
    "file_of_nobody": read("a.bin", bytes(range(256))),
    "file_not_there": lambda f: instruments.read(f / "a.csv"),
    "file_empty": read("a.csv", b"", instrument="keyence"),
    "instrument_of_no_name": read("a.csv", b"x", instrument="keyance"),
    "dice_without_images": dice_without_images,
}

# --- values handed to functions -------------------------------------------------------------------


def prony(**changes: Any) -> object:
    given: dict[str, Any] = {"E_relaxed": 1e6, "E": [1e6], "rho": [1.0], "nu": 0.4}
    return materials.Prony(**(given | changes))


def drop(**changes: Any) -> object:
    given: dict[str, Any] = {"radius": 9.5e-3, "mass": 0.5, "height": 1e-3, "duration": 0.01}
    return contact.drop(materials.load("acrylic"), **(given | changes))


def velocity_of_one_point(folder: Path) -> object:
    attrs = {"units": "m", "long_name": "displacement"}
    return signals.velocity(xr.DataArray([1.0], dims="time", coords={"time": [0.0]}, attrs=attrs))


BLACK = np.zeros((2, 40, 40))
CASES |= {
    "material_of_no_name": lambda f: materials.load("acryl"),
    "prony_lengths": lambda f: prony(rho=[1.0, 2.0]),
    "prony_nu": lambda f: prony(nu=0.7),
    "drop_height": lambda f: drop(height=-1e-3),
    "drop_solver": lambda f: drop(solver="fem"),
    "drop_rtol": lambda f: drop(rtol=0.5),
    "drop_mass_nan": lambda f: drop(mass=float("nan")),
    "unit_of_no_name": lambda f: units.unit("furlong"),
    "quantity_without_number": lambda f: units.quantity("mm 3"),
    "track_points_of_wrong_shape": lambda f: imaging.track(BLACK, np.zeros((3, 3))),
    "track_subset_even": lambda f: imaging.track(BLACK, np.array([[20.0, 20.0]]), subset=30),
    "velocity_of_one_point": velocity_of_one_point,
}

# --- the session as a whole, and the command line -------------------------------------------------


def unprocessed(verb: Callable[..., object], *arguments: Any, **options: Any) -> Callable[[Path], object]:
    def call(folder: Path) -> object:
        session(folder)
        return verb(folder, *arguments, **options)

    return call


def store_record_damaged(folder: Path) -> object:
    (folder / "a.nc").write_bytes(b"not netCDF")
    return files.read_dataset(folder / "a.nc")


def folder_cannot_be_made(folder: Path) -> object:
    (folder / "a").write_text("a file")
    return files.write_text(folder / "a/b.txt", "x")


CASES |= {
    "target_of_no_name": unprocessed(verbs.plan, targets=["velocty"]),
    "experiment_of_no_name": unprocessed(verbs.plan, only=["dorp"]),
    "result_of_no_run": unprocessed(verbs.result, "drop", "repeats"),
    "export_before_processing": unprocessed(verbs.export),
    "scan_of_nothing": init,
    "store_record_damaged": store_record_damaged,
    "folder_cannot_be_made": folder_cannot_be_made,
}


def present() -> dict[str, tuple[str, str]]:
    """Return class and text of every error; the folder is called ``FOLDER``."""
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
    for _name, (_kind, _text) in present().items():
        sys.stdout.write(f"[{_name}]\nerror = {json.dumps(_kind)}\n")
        sys.stdout.write(f"message = {json.dumps(_text, ensure_ascii=False)}\n\n")

"""What `inspect` says of every kind of file, and the picture that it writes."""

from datetime import datetime
from pathlib import Path

import cv2
import numpy as np
import pytest

from instruments import keyence
from instruments.keyence._markers import Status
from labpipe.errors import SourceError
from labpipe.frames import ArrayFrames
from pipelines.session import describe, inspect, write_sheet
from pipelines.session._inspection import film

SAMPLES = Path(__file__).parents[3] / "../shared/samples"
FILMS = Path(__file__).parents[3] / "sample_data/films"
needs_films = pytest.mark.skipif(not FILMS.is_dir(), reason="the sample films are not here")


def test_a_laser_export_with_columns_sampling_and_states(tmp_path: Path) -> None:
    readings = np.full(1000, 1e-3)
    readings[100:110] = 9e-3
    settings = {"cycle": "50 us", "start": datetime(2024, 5, 14), "measuring_range": 5e-3}
    keyence.write(tmp_path / "a.csv", {1: readings}, **settings)
    found = describe(tmp_path / "a.csv")
    assert (found["reader"], found["kind"]) == ("keyence", "table")
    assert (found["interval"], found["rate"], found["duration"]) == ("5e-05 s", "20000 Hz", "0.04995 s")
    out1 = next(row for row in found["variables"] if row["name"] == "out1")
    assert (out1["units"], out1["min"], out1["max"], out1["invalid"]) == ("m", 1e-3, 1e-3, 10)
    assert found["problems"] == ["out1: 10 of 1000 readings are invalid (10 RANGEOVER_P)"]
    assert Status.RANGEOVER_P == 1
    assert "1 … 1 mm, 10 invalid (OUT1)" in repr(inspect(tmp_path / "a.csv"))
    assert "1,000 readings at 20 kHz, 0.05 s, 1 problem" in repr(inspect(tmp_path))


@needs_films
def test_records_sessions_results_and_pictures_are_known(processed_session: Path, tmp_path: Path) -> None:
    record = describe(processed_session / "calibration/laser.toml")
    assert (record["kind"], record["of"]) == ("record", "laser")
    assert "12 ± 0.1 deg" in record["inclination"]
    session = describe(processed_session / "session.toml")
    assert session["experiments"] == "drop (ball_drop), nbr (harmonic)"
    stored = next((processed_session / "labpipe/store").glob("??/*.nc"))
    assert describe(stored)["kind"] == "result"
    picture = describe(FILMS / "calibration/ruler_under.png")
    assert picture["kind"] == "picture"
    broken = tmp_path / "calibration.toml"
    broken.write_text('kind = "laser"\n')
    assert any("missing" in line for line in describe(broken)["problems"])
    (tmp_path / "session.toml").write_text("labpipe = 1\n")
    assert "no experiment" in describe(tmp_path / "session.toml")["problems"][0]


def test_a_folder_says_of_each_file_what_it_is(tmp_path: Path) -> None:
    for celsius in (20, 40):
        rows = "".join(f"{f};{100 + f};{5 + f};{celsius}\n" for f in (0.1, 1, 10))
        (tmp_path / f"pp_{celsius}.csv").write_text("f (Hz);E' (MPa);E'' (MPa);T (°C)\n" + rows, "utf-8")
    (tmp_path / "short.csv").write_text("f (Hz),E' (MPa),T (°C)\n1,2,3\n2,3,4\n", "utf-8")
    (tmp_path / "notes.md").write_text("clamped anew\n", "utf-8")
    (tmp_path / "more").mkdir()
    (tmp_path / "more/pp_60.csv").write_bytes((tmp_path / "pp_40.csv").read_bytes())
    found = inspect(tmp_path)
    assert [part["file"] for part in found["files"]][:2] == ["more/pp_60.csv", "notes.md"]
    assert [part["reader"] for part in found["files"]] == ["plain_table", "", *["plain_table"] * 3]
    assert found["problems"] == [
        "short.csv: found frequency, storage modulus, temperature; no loss modulus, tan δ or phase"
    ]
    text = repr(found)
    assert "3 readings, 40 … 40 °C, 0.1 … 10 Hz" in text
    assert "notes.md   " in text
    assert "no instrument recognises the content" in text
    (tmp_path / "none").mkdir()
    with pytest.raises(SourceError):
        inspect(tmp_path / "none")
    (tmp_path / "none/film.png").mkdir()
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"none/film.png/{i:03d}.png"), np.full((8, 8), 9, np.uint8))
    assert inspect(tmp_path / "none")["problems"][0].startswith("film.png: no frame rate. ")


def test_a_film_tells_missing_frames_and_its_strip_reads_only_what_it_shows(tmp_path: Path) -> None:
    path = FILMS / "film/ptfe_front.cine"
    found = describe(path)
    assert (found["frames"], found["image"], found["problems"]) == (552, "64 × 144 px", [])
    write_sheet(path, tmp_path / "strip.png")
    image = cv2.imread(str(tmp_path / "strip.png"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert image.shape[1] == 1000
    assert image.shape[0] > 900  # the first frame with its pixels along the sides, and the strip
    images = np.zeros((20, 4, 8), np.uint8)
    gap = film(ArrayFrames(images, time=np.r_[np.arange(10.0), np.arange(15.0, 25.0)]))
    assert gap["problems"] == ["frames are missing: the longest step is 6 s"]

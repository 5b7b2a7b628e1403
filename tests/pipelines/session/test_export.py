"""Exports: the values survive every format, and nothing stale or foreign is written over."""

import json
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.io import loadmat

from labpipe import files
from labpipe.errors import InputError, SourceError, UsageError
from pipelines.process import export, result
from pipelines.session import FORMATS
from pipelines.session._export_formats import csv_tables, json_text, mat_bytes


def small() -> xr.Dataset:
    values = np.array([[1.0, np.nan, -0.1], [1e-17, 2.5, np.pi]])
    return xr.Dataset(
        {
            "x": (("repeat", "time"), values, {"units": "m", "long_name": "place"}),
            "state": ("time", ["=1+2", "a,b", "-"], {"long_name": "state"}),
            "is_good": ("time", [True, False, True], {"units": "1", "long_name": "good"}),
            "u": ((), 0.25, {"units": "V", "long_name": "one number"}),
        },
        coords={"time": ("time", [0.0, 0.1, 0.2], {"units": "s", "long_name": "time"})},
        attrs={"source": "drop.csv"},
    )


def test_tables_hold_every_value_exactly_with_a_row_of_units() -> None:
    tables = csv_tables(small(), {"title": "two\nlines"})
    assert set(tables) == {"repeat-time", "time", "values"}
    assert tables["values"] == "# title: two lines\nu\nV\n0.25\n"
    frame = pd.read_csv(BytesIO(tables["repeat-time"].encode()), comment="#", header=[0, 1])
    assert list(frame.columns) == [("repeat", "1"), ("time", "s"), ("x", "m")]
    np.testing.assert_array_equal(frame["x", "m"], small()["x"].values.ravel())
    np.testing.assert_array_equal(frame["time", "s"], [0.0, 0.1, 0.2] * 2)


def test_no_cell_of_text_is_a_formula() -> None:
    table = csv_tables(small(), {})["time"]
    assert table.splitlines()[2:] == ["0.0,'=1+2,1", '0.1,"a,b",0', "0.2,'-,1"]


def test_json_holds_units_and_null_for_nan() -> None:
    document = json.loads(json_text(small(), {"title": "t"}))
    x = document["variables"]["x"]
    assert x["units"] == "m"
    assert x["dimensions"] == ["repeat", "time"]
    assert x["values"] == [[1.0, None, -0.1], [1e-17, 2.5, np.pi]]
    assert document["dimensions"] == {"repeat": 2, "time": 3}


def test_matlab_file_holds_values_units_and_no_clock() -> None:
    data = mat_bytes(small(), {"title": "t"})
    assert data == mat_bytes(small(), {"title": "t"})
    assert data.startswith(b"MATLAB 5.0")
    found = loadmat(BytesIO(data), squeeze_me=True)
    np.testing.assert_array_equal(found["x"], small()["x"].values)
    assert found["units"]["x"].item() == "m"
    assert found["dimensions"]["x"].item() == "repeat, time"


def test_matlab_names_are_legal_and_distinct() -> None:
    dataset = xr.Dataset({"a b": ((), 1.0), "a_b": ((), 2.0), "2x": ((), 3.0), "units": ((), 4.0)})
    found = loadmat(BytesIO(mat_bytes(dataset, {})))
    assert {k: found[k].item() for k in ("a_b", "a_b_2", "x2x", "units_2")} == {
        "a_b": 1.0,
        "a_b_2": 2.0,
        "x2x": 3.0,
        "units_2": 4.0,
    }


@pytest.mark.parametrize("kind", FORMATS)
def test_a_result_survives_every_format(processed_session: Path, tmp_path: Path, kind: str) -> None:
    done = export(processed_session, kind, only=["drop"], stages=["repeats"], out=tmp_path)
    expected = result(processed_session, "drop", "repeats")["displacement_mean"].values
    name = "drop.repeats.time.csv" if kind == "csv" else f"drop.repeats.{kind}"
    path = tmp_path / name
    assert path in done.paths
    assert done.left_out == ()
    if kind == "csv":
        # As text, because the number parser of older pandas rounds in the last digits.
        table = pd.read_csv(path, comment="#", header=[0, 1], dtype=str)
        found = table["displacement_mean", "m"].astype(float).to_numpy()
        assert path.read_text("utf-8").startswith("# experiment: drop\n# stage: repeats\n")
    elif kind == "nc":
        found = files.read_dataset(path)["displacement_mean"].values
    elif kind == "mat":
        found = loadmat(path, squeeze_me=True)["displacement_mean"]
    else:
        values = json.loads(path.read_text("utf-8"))["variables"]["displacement_mean"]["values"]
        found = np.array(values, float)
    np.testing.assert_array_equal(found, expected)


def test_results_that_are_not_up_to_date_are_left_out_and_named(session_copy: Path) -> None:
    path = session_copy / "session.toml"
    path.write_text(path.read_text("utf-8").replace('height = "1.5', 'height = "1.6'), "utf-8")
    done = export(session_copy, "json", only=["drop"])
    assert {p.name for p in done.paths} == {"drop.readings.laser_drop_1.json", "drop.readings.laser_drop_2.json"}
    assert any("drop/bounces" in line for line in done.left_out)
    with pytest.raises(InputError, match="run: labpipe process"):
        export(session_copy, stages=["bounces"])


def test_a_raw_file_is_exported_with_its_origin(small_session: Path, tmp_path: Path) -> None:
    done = export(small_session / "laser/drop_1.csv", out=tmp_path)
    assert [p.name for p in done.paths] == ["drop_1.time.csv"]
    text = done.paths[0].read_text("utf-8")
    assert files.digest(small_session / "laser/drop_1.csv") in text
    with pytest.raises(UsageError, match="exists already; use --force"):
        export(small_session / "laser/drop_1.csv", out=tmp_path)
    export(small_session / "laser/drop_1.csv", out=tmp_path, replace=True)


def test_wrong_sources_and_names_are_refused(processed_session: Path, tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="labpipe init"):
        export(tmp_path)
    with pytest.raises(UsageError, match="bounces"):
        export(processed_session, stages=["bounce"])
    with pytest.raises(UsageError, match="expected one of csv, nc, mat, json"):
        export(processed_session, "xlsx")
    with pytest.raises(UsageError, match="do not go with a session"):
        export(processed_session, reading={"cycle": "50 us"})

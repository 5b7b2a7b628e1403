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
from labpipe.errors import InputError, UsageError
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.session import compare, export, result
from pipelines.session._export_formats import csv_tables, tex_text
from tests.pipelines.sessions import replaced


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


@pytest.mark.parametrize("text", ["a;=1+1", "a; @SUM(1)", "-5;-cmd()", "x,+1"])
def test_no_cell_is_a_formula_where_a_spreadsheet_splits_at_semicolons(text: str) -> None:
    """Nor within a remark; a negative number stays one."""
    table = csv_tables(xr.Dataset({"a": ("time", np.array([text], object), {"units": ""})}), {"title": text})
    for line in "".join(table.values()).splitlines():
        assert [c for c in line.replace('"', "").split(";") if c.strip().startswith(("=", "+", "@", "-c"))] == []
    numbers = {"parameters": "[0;-1.5,-2]"}
    assert "# parameters: [0;-1.5,-2]" in "".join(csv_tables(small(), numbers).values())


@pytest.mark.parametrize("kind", ["csv", "nc", "mat", "json"])
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
        flag = files.read_dataset(path)["quality_flag"]
        assert flag.attrs["flag_meanings"] == "yes unknown doubtful impossible"
        assert list(flag.attrs["flag_values"]) == [1, 2, 3, 4]
        assert int(flag) in (1, 2)
    elif kind == "mat":
        found = loadmat(path, squeeze_me=True)["displacement_mean"]
    else:
        values = json.loads(path.read_text("utf-8"))["variables"]["displacement_mean"]["values"]
        found = np.array(values, float)
    np.testing.assert_array_equal(found, expected)


def test_results_that_are_not_up_to_date_are_left_out_and_named(session_copy: Path) -> None:
    replaced(session_copy, 'height = "1.5', 'height = "1.6')
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


def test_one_table_says_of_each_quantity_its_value_model_and_verdict(processed_session: Path, tmp_path: Path) -> None:
    (path,) = export(processed_session, "xlsx", out=tmp_path).paths
    table = pd.read_excel(path, sheet_name="quantities", engine="openpyxl").fillna({"condition": ""})
    table = table.set_index(["experiment", "condition", "quantity"])
    rows = {(r.experiment, r.condition, r.quantity): r for r in compare(processed_session).rows}
    assert set(rows) <= set(table.index)
    for key, row in rows.items():
        shown = table.loc[key]
        for title, value in (("value", row.measured), ("expected", row.model), ("deviation in u", row.deviation)):
            assert np.isclose(shown[title], np.nan if value is None else value, rtol=1e-12, atol=0, equal_nan=True)
    judged = result(processed_session, "drop", "judgement").attrs
    assert set(table.loc["drop"]["believable"]) == {judged["believable"]}
    assert set(table.loc["drop"]["model"]) == {judged["model"]}
    assert not table.index.duplicated().any()


def test_the_table_for_latex_has_its_cells_and_escapes(processed_session: Path, tmp_path: Path) -> None:
    (path,) = export(processed_session, "tex", out=tmp_path).paths
    body = [line for line in path.read_text("utf-8").splitlines() if line.endswith("\\\\")]
    assert len(body) == 1 + len(pd.read_csv(_table_csv(processed_session, tmp_path), comment="#"))
    assert all(line.count(" & ") == 6 for line in body)
    row = Row("50_%", "k", "", "", "a = b²", "m", 1, measured=1.5e-3, u_measured=2e-6)
    text = tex_text([row], pd.DataFrame({"believable": ["yes"], "model": ["none"]}), {})
    assert r"50\_\% & a = b$^{2}$ & mm & 1.5000 $\pm$ 0.0020 &  &  & yes \\" in text


def _table_csv(session: Path, folder: Path) -> Path:
    return next(p for p in export(session, "csv", out=folder).paths if p.name == "quantities.csv")

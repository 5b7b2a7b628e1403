"""Plain tables of other analysers: columns by name, units by the file, faults with their place."""

import json
from pathlib import Path

import numpy as np
import pytest

import instruments
from instruments import tables
from instruments.tables import _layout
from labpipe.errors import SourceError

SAMPLES = Path(__file__).parents[2] / "../shared/samples/dma"

SWEEPS = """f,E_stor,E_loss,T,Set
Hz, MPa, MPa, C, -
0.1,1000,100,20.1,0
1,1100,90,20.2,0
0.1,500,120,40.0,1
1,600,130,40.1,1
"""
SHIFTS = "T,log_aT\nC, -\n40,-1.5\n20,0\n"


def read(folder, text, encoding="utf-8", **options):
    path = folder / "table.csv"
    path.write_bytes(text.encode(encoding))
    return tables.read(path, **options)


def assert_is_the_table(found):
    np.testing.assert_allclose(found.frequency, [0.1, 1, 0.1, 1], rtol=1e-12)
    np.testing.assert_allclose(found.storage_modulus, [1e9, 1.1e9, 5e8, 6e8], rtol=1e-12)
    np.testing.assert_allclose(found.loss_modulus, [1e8, 9e7, 1.2e8, 1.3e8], rtol=1e-12)
    np.testing.assert_allclose(found.temperature, [20.1, 20.2, 40.0, 40.1], rtol=1e-12)


def test_a_table_with_a_row_of_units_is_read_in_si(tmp_path):
    found = read(tmp_path, SWEEPS)
    assert_is_the_table(found)
    assert found.interval.values.tolist() == [1, 1, 2, 2]
    assert [entry["rows"] for entry in json.loads(found.attrs["tests"])] == [2, 2]
    assert found.storage_modulus.attrs["units"] == "Pa"


@pytest.mark.parametrize(
    "text",
    [
        SWEEPS.replace(",", "\t"),
        SWEEPS.replace(",", ";")
        .replace("20.1", "20,1")
        .replace("20.2", "20,2")
        .replace("40.0", "40,0")
        .replace("40.1", "40,1")
        .replace("0.1;", "0,1;"),
        SWEEPS.replace(
            "f,E_stor,E_loss,T,Set\nHz, MPa, MPa, C, -", "Frequency (Hz),E' [MPa],E'' [MPa],Temperature (°C),sweep"
        ),
        SWEEPS.replace("E_stor,E_loss", "Speichermodul,Verlustmodul"),
        SWEEPS.replace("20.1", "293.25")
        .replace("20.2", "293.35")
        .replace("40.0", "313.15")
        .replace("40.1", "313.25")
        .replace("C, -", "K, -"),
        SWEEPS.replace("\n", ",,\r\n"),
    ],
)
def test_other_forms_give_the_same_numbers(tmp_path, text):
    assert_is_the_table(read(tmp_path, text))


def test_rows_of_a_set_are_found_wherever_they_stand(tmp_path):
    lines = SWEEPS.splitlines()
    found = read(tmp_path, "\n".join([*lines[:2], *(lines[k] for k in (2, 4, 3, 5))]) + "\n")
    assert_is_the_table(found)
    assert [entry["rows"] for entry in json.loads(found.attrs["tests"])] == [2, 2]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings_are_told_apart(tmp_path, encoding):
    assert_is_the_table(read(tmp_path, SWEEPS, encoding))


@pytest.mark.parametrize(
    "text", [SHIFTS, "T,aT\nC,-\n40,0.0316227766\n20,1\n", "T,ln aT\nC,1\n40,-3.4538776394910684\n20,0\n"]
)
def test_shift_factors_become_decimal_logarithms(tmp_path, text):
    found = read(tmp_path, text)
    np.testing.assert_allclose(found.log10_aT, [-1.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.temperature, [40.0, 20.0])


def test_an_empty_cell_is_no_reading(tmp_path):
    found = read(tmp_path, SWEEPS.replace("1,1100,90,", "1,1100,,"))
    assert np.isnan(found.loss_modulus.values).tolist() == [False, True, False, False]
    assert found.attrs["empty_cells"] == 1


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (SWEEPS.replace("1100", "11oo"), 4, "expected a number"),
        (SWEEPS.replace("1,600,130", "1,600,130,7"), 6, "found 6 cells, expected 5"),
        (SWEEPS.replace("Hz, MPa", "s, MPa"), 2, 'f is in "?.?s.*Hz or rad/s'),
        (SWEEPS.replace("Hz, MPa, MPa, C, -\n", ""), 1, "expected a unit of"),
        (
            SWEEPS.replace("E_loss", "E_stor"),
            1,
            "found frequency, storage modulus, temperature; no loss modulus, tan δ",
        ),
        (SWEEPS.replace("E_loss", "E_stor").replace("E_stor,T", "E_stor,E_loss"), 1, "several columns hold the same"),
        (SHIFTS.replace("log_aT", "colour"), 1, "no line names the columns: expected frequency, temperature, storage"),
        ("T,log_aT\nC,-\n", 1, "no row of numbers"),
        (SWEEPS.rstrip("\n").removesuffix("0.1,1") + "0", 6, "no line end and fewer cells"),
        ("T,aT\nC,-\n40,-0.5\n20,1\n", None, "zero or negative"),
    ],
)
def test_a_fault_is_named_with_its_line(tmp_path, text, line, message):
    with pytest.raises(SourceError, match=message.replace('"?.?', ".")) as caught:
        read(tmp_path, text)
    assert caught.value.line == line


@pytest.mark.parametrize(("unit", "coldest"), [("K", "-20.1"), ("C", "-400.5"), ("degF", "-460")])
def test_a_temperature_below_absolute_zero_has_another_unit(tmp_path, unit, coldest):
    with pytest.raises(SourceError, match=f'table.csv:2: T is in "{unit}" and holds {coldest}, below absolute zero'):
        read(tmp_path, SWEEPS.replace("MPa, C", f"MPa, {unit}").replace("20.1", coldest))


def test_a_cut_last_line_is_dropped_on_request(tmp_path):
    with pytest.warns(UserWarning, match="dropped"):
        found = read(tmp_path, SWEEPS.rstrip("\n"), allow_incomplete=True)
    assert found.sizes["sample"] == 3


MANY = "f,E_stor,E_loss,T,Set\nHz, MPa, MPa, C, -\n" + "".join(
    f"{f},{1000 - 100 * k},{90 + k},{20 * k + 20},{k}\n" for k in range(3) for f in (0.1, 1, 10)
)


@pytest.mark.parametrize(
    ("row", "damaged"),
    [
        ("1,1000,90,20,0", "11000,90,20,0"),
        ("1,1000,90,20,0", "1,100090,20,0"),
        ("1,1000,90,20,0", "1,1000,90,20"),
        ("1,1000,90,20,0", "1"),
        ("1,900,91,40,1", "1900,91,40,1"),
    ],
)
def test_a_row_that_lost_a_cell_is_invalid_as_a_whole(tmp_path, row, damaged):
    """Two numbers that became one would otherwise be a frequency of 11 kHz at 90 MPa."""
    whole = read(tmp_path, MANY)
    line = MANY.splitlines().index(row) + 1
    with pytest.warns(UserWarning, match=rf"line {line}: 1 of 9 rows hold fewer than 5 cells"):
        found = read(tmp_path, MANY.replace(f"\n{row}\n", f"\n{damaged}\n"))
    at = line - 3
    assert np.flatnonzero(found.is_valid.values == 0).tolist() == [at]
    assert found.interval.values.tolist() == whole.interval.values.tolist()
    for name in ("frequency", "storage_modulus", "loss_modulus", "temperature"):
        assert np.isnan(found[name].values[at])
        expected = np.delete(whole[name].values, at)
        np.testing.assert_array_equal(np.delete(found[name].values, at), expected)


def test_an_empty_cell_and_a_column_that_no_row_has_are_no_lost_cells(tmp_path):
    found = read(tmp_path, MANY.replace("\n1,1000,90,20,0", "\n1,,90,20,0"))
    assert found.is_valid.values.all()
    assert np.isnan(found.storage_modulus.values).sum() == 1
    trimmed = "\n".join(line.rsplit(",", 1)[0] for line in MANY.splitlines()[2:]) + "\n"
    found = read(tmp_path, "\n".join(MANY.splitlines()[:2]) + "\n" + trimmed)
    assert found.is_valid.values.all()
    assert found.sizes["sample"] == 9


def test_a_file_that_was_cut_between_two_lines_is_told(tmp_path):
    cut = "\n".join(MANY.splitlines()[:-2]) + "\n"
    with pytest.warns(UserWarning, match="the last set holds 1 rows, all others 3; the file may"):
        found = read(tmp_path, cut)
    assert found.attrs["incomplete"] == 1
    assert "incomplete" not in read(tmp_path, MANY).attrs


def test_the_content_tells_the_reader(tmp_path):
    for text in (SWEEPS, SHIFTS):
        path = tmp_path / "anything.dat"
        path.write_text(text, encoding="utf-8")
        assert instruments.identify(path) == "plain_table"


def test_a_whole_last_line_without_an_end_is_kept_and_told(tmp_path):
    with pytest.warns(UserWarning, match="kept, as no cell is missing"):
        assert_is_the_table(read(tmp_path, SWEEPS.rstrip("\n")))


@pytest.mark.parametrize(
    "line", ["x,y,z", "Time,Temperature", "T,E", "no delimiter", "Time, s\tPosition (z), mm\tFz, N"]
)
def test_other_tables_are_not_claimed(line):
    assert _layout.headings_of(line) is None


@pytest.mark.skipif(not SAMPLES.exists(), reason="the sample files lie beside the checkout only")
def test_the_published_samples_read():
    sweeps = instruments.read(SAMPLES / "backsheet_tension_21_temperatures.csv")
    assert len(json.loads(sweeps.attrs["tests"])) == 21
    assert float(sweeps.storage_modulus[0]) == pytest.approx(8097.175545e6)
    shifts = instruments.read(SAMPLES / "backsheet_published_shift_factors.csv")
    assert float(shifts.log10_aT[0]) == -11.7
    assert shifts.sizes["sample"] == 21

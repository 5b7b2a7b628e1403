"""Tables with faults: a note or a refusal with its place, never numbers in the wrong column."""

import json
from pathlib import Path

import numpy as np
import pytest

import instruments
from instruments import tables
from labpipe.errors import SourceError
from tests.instruments.tables_of_sweeps import ALL, F, read, table

SAMPLES = Path(__file__).parents[2] / "../shared/samples/dma"
SWEEPS = """f,E_stor,E_loss,T,Set
Hz, MPa, MPa, C, -
0.1,1000,100,20.1,0
1,1100,90,20.2,0
0.1,500,120,40.0,1
1,600,130,40.1,1
"""
MANY = "f,E_stor,E_loss,T,Set\nHz, MPa, MPa, C, -\n" + "".join(
    f"{f},{1000 - 100 * k},{90 + k},{20 * k + 20},{k}\n" for k in range(3) for f in (0.1, 1, 10)
)


def assert_is_the_table(found):
    np.testing.assert_allclose(found.frequency, [0.1, 1, 0.1, 1], rtol=1e-12)
    np.testing.assert_allclose(found.storage_modulus, [1e9, 1.1e9, 5e8, 6e8], rtol=1e-12)
    np.testing.assert_allclose(found.loss_modulus, [1e8, 9e7, 1.2e8, 1.3e8], rtol=1e-12)
    np.testing.assert_allclose(found.temperature, [20.1, 20.2, 40.0, 40.1], rtol=1e-12)


def test_rows_of_a_set_are_found_wherever_they_stand(tmp_path):
    lines = SWEEPS.splitlines()
    for order in ((2, 3, 4, 5), (2, 4, 3, 5)):
        found = read(tmp_path, "\n".join([*lines[:2], *(lines[k] for k in order)]) + "\n")
        assert_is_the_table(found)
        assert [entry["rows"] for entry in json.loads(found.attrs["tests"])] == [2, 2]


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (SWEEPS.replace("1100", "11oo"), 4, "expected a number"),
        (SWEEPS.replace("1,600,130", "1,600,130,7"), 6, "found 6 cells, expected 5"),
        (SWEEPS.replace("Hz, MPa", "s, MPa"), 2, "f is in 's', expected a unit of Hz or rad/s"),
        (SWEEPS.replace("Hz, MPa, MPa, C, -\n", ""), 1, "f has no unit, expected a unit of"),
        (SWEEPS.replace("E_loss", "E_stor"), 1, "found frequency, storage modulus, temperature; no loss modulus"),
        (SWEEPS.replace("f,E_stor,E_loss,T,Set", "f,E_stor,E_loss,E_stor,Set").replace("C, -", "MPa, -"), 1, "differ"),
        ("T,colour\nC, -\n40,-1.5\n20,0\n", 1, "no line names the columns: expected frequency, temperature, storage"),
        ("T,log_aT\nC,-\n", 1, "no row of numbers"),
        (SWEEPS.rstrip("\n").removesuffix("0.1,1") + "0", 6, "no line end and fewer cells"),
        ("T,aT\nC,-\n40,-0.5\n20,1\n", None, "zero or negative"),
        ("f E' E'' T\nHz MPa MPa C\n" + "1 2 3\n" * 3, 1, "the headings name 4 columns, the rows hold 3 numbers"),
        (SWEEPS.replace("C, -", "K, -").replace("20.1", "-20.1"), 2, 'T is in "K" and holds -20.1, below absolute'),
    ],
)
def test_a_fault_is_named_with_its_line(tmp_path, text, line, message):
    (tmp_path / "table.csv").write_text(text, "utf-8")
    with pytest.raises(SourceError, match=message) as caught:
        tables.read(tmp_path / "table.csv")
    assert caught.value.line == line


def test_a_refusal_holds_the_line_to_copy(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table("drive,E' (MPa),E'' (MPa)", *ALL[:3]), "utf-8")
    with pytest.raises(SourceError, match="no frequency") as caught:
        tables.read(path)
    assert 'columns = { storage_modulus = "E\' (MPa)", loss_modulus = "E\'\' (MPa)" }' in caught.value.hint
    path.write_text(table("f,E' (MPa),E'' (MPa)", *ALL[:3]), "utf-8")
    with pytest.raises(SourceError, match="f has no unit") as caught:
        tables.read(path)
    copied = caught.value.hint.partition("columns = ")[2]
    assert tables.read(path, columns=copied).frequency.values == pytest.approx(F)


def test_a_last_line_without_an_end_is_kept_or_dropped(tmp_path):
    with pytest.warns(UserWarning, match="kept, as no cell is missing"):
        assert_is_the_table(read(tmp_path, SWEEPS.rstrip("\n")))
    with pytest.warns(UserWarning, match="dropped"):
        found = read(tmp_path, SWEEPS.rstrip("\n"), allow_incomplete=True)
    assert found.sizes["sample"] == 3


@pytest.mark.parametrize(("row", "damaged"), [("1,1000,90,20,0", "11000,90,20,0"), ("1,900,91,40,1", "1900,91,40,1")])
def test_a_row_that_lost_a_cell_is_invalid_as_a_whole(tmp_path, row, damaged):
    """Two numbers that became one would otherwise be a frequency of 11 kHz at 90 MPa."""
    whole = read(tmp_path, MANY)
    line = MANY.splitlines().index(row) + 1
    with pytest.warns(UserWarning, match=rf"line {line}: 1 of 9 rows hold fewer than 5 cells"):
        found = read(tmp_path, MANY.replace(f"\n{row}\n", f"\n{damaged}\n"))
    at = line - 3
    assert np.flatnonzero(found.is_valid.values == 0).tolist() == [at]
    for name in ("frequency", "storage_modulus", "loss_modulus", "temperature"):
        assert np.isnan(found[name].values[at])
        np.testing.assert_array_equal(np.delete(found[name].values, at), np.delete(whole[name].values, at))


def test_rows_without_a_number_of_their_own_and_of_frequency_zero_are_no_readings(tmp_path):
    text = "Point,f (Hz),E' (MPa),E'' (MPa)\n1,0.1,9,1\n2,1,10,1\n3,0,0,0\nMean,0.55,9.5,1\n"
    with pytest.warns(UserWarning, match="frequency of zero or below|no numbers") as caught:
        found = read(tmp_path, text)
    assert found.is_valid.values.tolist() == [1, 1, 0, 0]
    said = " ".join(str(w.message) for w in caught)
    assert "1 of 4 rows have a frequency of zero" in said
    assert "line 5: 'Point' holds cells that are no numbers" in said


def test_several_specimens_in_a_table_are_refused(tmp_path):
    text = "Sample," + table("f (Hz),E' (MPa),E'' (MPa),T (°C)", *ALL)
    lines = text.splitlines()
    text = "\n".join([lines[0], *(f"{'A' if k < 6 else 'B'},{row}" for k, row in enumerate(lines[1:]))]) + "\n"
    with pytest.raises(SourceError, match=r"Sample names 2 specimens \('A, B'\)"):
        read(tmp_path, text)
    for count in (F.size, 4):  # of the rows, or of the readings of each isotherm
        numbered = "\n".join([lines[0], *(f"{k % count},{row}" for k, row in enumerate(lines[1:]))]) + "\n"
        assert read(tmp_path, numbered).sizes["sample"] == F.size


@pytest.mark.skipif(not SAMPLES.exists(), reason="the sample files lie beside the checkout only")
def test_the_published_samples_read():
    sweeps = instruments.read(SAMPLES / "backsheet_tension_21_temperatures.csv")
    assert len(json.loads(sweeps.attrs["tests"])) == 21
    assert float(sweeps.storage_modulus[0]) == pytest.approx(8097.175545e6)
    shifts = instruments.read(SAMPLES / "backsheet_published_shift_factors.csv")
    assert float(shifts.log10_aT[0]) == -11.7
    assert shifts.sizes["sample"] == 21
    book = instruments.read(SAMPLES.parent / "workbooks/ta_dma_frequency_sweeps.xlsx")
    for name in ("storage_modulus", "loss_modulus", "frequency", "temperature"):
        np.testing.assert_allclose(book[name], sweeps[name], rtol=1e-9)
